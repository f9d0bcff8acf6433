"""The same arithmetic on every x86-64 processor with AVX2 and FMA, so that the same episode has the same bytes there.

numpy and OpenBLAS choose among implementations by the processor, and their results differ in the last bit. The packages
of programs call ``pin_arithmetic`` before numpy is loaded; the library itself leaves its user's numpy alone.
"""

import os
from collections.abc import Collection, MutableMapping
from pathlib import Path
from typing import Final

_AVX512_OF_NUMPY: Final = {
    "AVX512F": ("avx512f",),
    "AVX512CD": ("avx512cd",),
    "AVX512_KNL": ("avx512er", "avx512pf"),
    "AVX512_KNM": ("avx512_4fmaps", "avx512_4vnniw"),
    "AVX512_SKX": ("avx512vl", "avx512bw", "avx512dq"),
    "AVX512_CLX": ("avx512_vnni",),
    "AVX512_CNL": ("avx512ifma", "avx512vbmi"),
    "AVX512_ICL": ("avx512_vbmi2", "avx512_bitalg", "avx512_vpopcntdq"),
}
"""numpy's groups of instructions beyond AVX2 (numpy's reference, "CPU/SIMD optimizations"), and the processor flags in
Linux's names that each one needs. numpy warns about a disabled group that the processor does not have."""


def pin_arithmetic(environment: MutableMapping[str, str] = os.environ, flags: Collection[str] | None = None) -> None:
    """Set the variables that numpy and OpenBLAS read when they load; those that are set already stay.

    Args:
        environment: Of this process.
        flags: What the processor can do, in Linux's names; read from ``/proc/cpuinfo`` where None.
    """
    able = set(_processor_flags() if flags is None else flags)
    # Idle threads of OpenBLAS spin after every large product and take a core from the cameras.
    environment.setdefault("OPENBLAS_NUM_THREADS", "1")
    if able >= {"avx2", "fma"}:
        environment.setdefault("OPENBLAS_CORETYPE", "Haswell")
    if beyond := [group for group, needed in _AVX512_OF_NUMPY.items() if able.issuperset(needed)]:
        environment.setdefault("NPY_DISABLE_CPU_FEATURES", " ".join(beyond))


def _processor_flags(cpuinfo: Path = Path("/proc/cpuinfo")) -> list[str]:
    """Flags of the first processor; none where the file is missing or of another architecture."""
    try:
        lines = cpuinfo.read_text().splitlines()
    except OSError:
        return []
    return next((line.partition(":")[2].split() for line in lines if line.startswith("flags")), [])
