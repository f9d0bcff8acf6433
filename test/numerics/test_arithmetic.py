"""Programs compute the same on every processor; the library leaves its user's numpy alone."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from siren_ros.numerics.arithmetic import pin_arithmetic

_CASCADE_LAKE = ["fpu", "avx2", "fma", "avx512f", "avx512cd", "avx512vl", "avx512bw", "avx512dq", "avx512_vnni"]
_READ_OFF = """
import ctypes, {first}
import numpy as np
from numpy.core._multiarray_umath import __cpu_dispatch__, __cpu_features__

with open("/proc/self/maps") as maps:
    blas = next(line.split()[-1] for line in maps if "numpy.libs" in line and "openblas" in line)
core_name = ctypes.CDLL(blas).openblas_get_corename64_
core_name.restype = ctypes.c_char_p
print(core_name().decode(), [name for name in __cpu_dispatch__ if name.startswith("AVX512") and __cpu_features__[name]])
"""


def test_what_lies_beyond_avx2_is_switched_off_group_by_group() -> None:
    environment: dict[str, str] = {}
    pin_arithmetic(environment, _CASCADE_LAKE)
    assert environment == {
        "OPENBLAS_NUM_THREADS": "1",
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX",
    }


def test_a_processor_that_has_no_more_than_avx2_keeps_all_it_has() -> None:
    environment: dict[str, str] = {}
    pin_arithmetic(environment, ["avx2", "fma"])
    assert environment == {"OPENBLAS_NUM_THREADS": "1", "OPENBLAS_CORETYPE": "Haswell"}


@pytest.mark.parametrize("flags", [[], ["avx", "sse4_2"], ["avx2"]])
def test_older_and_other_processors_are_asked_for_nothing_that_they_lack(flags: list[str]) -> None:
    environment: dict[str, str] = {}
    pin_arithmetic(environment, flags)
    assert environment == {"OPENBLAS_NUM_THREADS": "1"}


def test_what_the_user_chose_stays() -> None:
    chosen = {"OPENBLAS_NUM_THREADS": "4", "OPENBLAS_CORETYPE": "Zen", "NPY_DISABLE_CPU_FEATURES": ""}
    environment = dict(chosen)
    pin_arithmetic(environment, _CASCADE_LAKE)
    assert environment == chosen


@pytest.mark.parametrize("package", ["siren_nodes.cosim", "siren_ros.cli.main", "siren_ros.benchmarks.episode"])
def test_programs_have_it_by_the_time_numpy_is_loaded(package: str) -> None:
    if "avx2" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has no AVX2; its bytes are its own")
    assert _read_off(package) == "Haswell []"


def test_the_library_alone_sets_nothing() -> None:
    done = _run("import os, siren_ros.roads.road_network; print('OPENBLAS_CORETYPE' in os.environ)")
    assert done == "False"


def _read_off(package: str) -> str:
    return _run(_READ_OFF.format(first=package))


def _run(program: str) -> str:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("OPENBLAS_", "NPY_"))}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.strip()
