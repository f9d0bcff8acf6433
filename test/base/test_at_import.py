"""Arithmetic that is the same on every processor, and modules of the lab under the short names that users type."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import siren_ros  # noqa: F401 - its import makes the short names known
from siren_ros.base.at_import import UnpinnedArithmeticWarning, allow_short_names, pin_arithmetic


@pytest.mark.parametrize("below", ["benchmarks.sensors", "learning", "learning.options", "training.settings"])
def test_a_module_is_the_same_under_both_names(below: str) -> None:
    module = import_module(f"siren_ros.{below}")
    assert module is import_module(f"siren_ros.lab.{below}")
    assert module.__name__ == module.__spec__.name == f"siren_ros.lab.{below}"


def test_short_names_are_known_once_start_a_program_and_are_refused_where_nothing_is_there() -> None:
    for name in ("siren_ros.benchmarks.no_such_module", "siren_ros.learnin", "siren_ros.reproduction"):
        with pytest.raises(ModuleNotFoundError, match=name.split(".")[-1]):
            import_module(name)
    finders = list(sys.meta_path)
    allow_short_names()
    assert sys.meta_path == finders
    command = [sys.executable, "-m", "siren_ros.benchmarks.sensors", "--help"]
    assert "usage" in subprocess.run(command, check=True, capture_output=True, text=True).stdout


_CASCADE_LAKE = ["fpu", "avx2", "fma", "avx512f", "avx512cd", "avx512vl", "avx512bw", "avx512dq", "avx512_vnni"]
_SAPPHIRE_RAPIDS = [
    *_CASCADE_LAKE,
    *("avx512ifma", "avx512vbmi", "avx512_vbmi2", "avx512_bitalg", "avx512_vpopcntdq", "avx512_fp16"),
]
_READ_OFF = """
import ctypes, {first}
import numpy as np
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

with open("/proc/self/maps") as maps:
    blas = next(line.split()[-1] for line in maps if "numpy.libs" in line and "openblas" in line)
library = ctypes.CDLL(blas)
name_of_1_26, name_of_2 = "openblas_get_corename64_", "scipy_openblas_get_corename64_"
core_name = getattr(library, name_of_1_26 if hasattr(library, name_of_1_26) else name_of_2)
core_name.restype = ctypes.c_char_p
names = [name for name in __cpu_dispatch__ if name.startswith(("AVX512", "X86_V4")) and __cpu_features__[name]]
print(core_name().decode(), names)
"""


@pytest.mark.parametrize(
    ("flags", "version", "groups"),
    [
        (_CASCADE_LAKE, (1, 26), "AVX512F AVX512CD AVX512_SKX AVX512_CLX"),
        (_SAPPHIRE_RAPIDS, (2, 2), "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL"),
        (_SAPPHIRE_RAPIDS, (2, 3), "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR"),
        *((_SAPPHIRE_RAPIDS, (2, minor), "X86_V4 AVX512_ICL AVX512_SPR") for minor in (4, 5)),
    ],
)
def test_what_lies_beyond_avx2_is_switched_off_by_the_names_of_the_installed_numpy(flags, version, groups):
    environment = {}
    assert pin_arithmetic(environment, flags, version) == environment
    haswell = {"OPENBLAS_NUM_THREADS": "1", "OPENBLAS_CORETYPE": "Haswell"}
    assert environment == {**haswell, "NPY_DISABLE_CPU_FEATURES": groups}


@pytest.mark.parametrize("named", ["flags", "Features"])  # the second by processors of another architecture
@pytest.mark.parametrize("flags", ["avx2 fma", "", "avx sse4_2", "avx2"])
def test_a_processor_without_more_than_avx2_keeps_all_it_has_and_is_asked_for_nothing_that_it_lacks(
    flags, named, monkeypatch
):
    monkeypatch.setattr(
        Path, "read_text", lambda _: f"processor\t: 0\n{named}\t: {flags}\n{named}\t: avx2 fma avx512f\n"
    )
    environment = {}
    pin_arithmetic(environment, numpy_version=(2, 4))
    core_type = {"OPENBLAS_CORETYPE": "Haswell"} if "fma" in flags and named == "flags" else {}
    assert environment == {"OPENBLAS_NUM_THREADS": "1", **core_type}


def test_what_the_user_chose_stays():
    chosen = {"OPENBLAS_NUM_THREADS": "4", "OPENBLAS_CORETYPE": "Zen", "NPY_DISABLE_CPU_FEATURES": ""}
    environment = dict(chosen)
    assert (pin_arithmetic(environment, _CASCADE_LAKE), environment) == ({}, chosen)


@pytest.mark.parametrize("package", ["siren_ros.simulation.roads.road_network", "siren_nodes.cosim"])
def test_the_library_and_programs_of_ros_have_it_by_the_time_numpy_is_loaded(package):
    if package.startswith("siren_nodes"):
        pytest.importorskip("rclpy")
    if "avx2" not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor has no AVX2; its bytes are its own")
    assert _run(_READ_OFF.format(first=package)) == "Haswell []"


_IMPORTS = """
import warnings

with warnings.catch_warnings(record=True) as noted:
    warnings.simplefilter("always")
    import {first}
    import {second}
    import siren_ros.errors
print(*(warning.category.__name__ for warning in noted))
"""


@pytest.mark.parametrize(
    ("first", "second", "variables", "warned"),
    [
        ("numpy", "siren_ros", {}, UnpinnedArithmeticWarning.__name__),
        *[("numpy", "siren_ros", pin_arithmetic({}), ""), ("siren_ros", "numpy", {}, "")],
    ],
)
def test_who_loads_numpy_first_without_the_variables_is_warned_once(first, second, variables, warned):
    assert _run(_IMPORTS.format(first=first, second=second), **variables) == warned


def _run(program, **variables):
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("OPENBLAS_", "NPY_"))}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment | variables, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()
