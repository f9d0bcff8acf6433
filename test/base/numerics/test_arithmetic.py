"""Arithmetic of the library: sums, units, changed structures."""

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from siren_ros.base.numerics import units
from siren_ros.base.numerics.arithmetic import UnpinnedArithmeticWarning, pin_arithmetic
from siren_ros.base.numerics.arrays import chances, drawn, random_stream
from siren_ros.base.numerics.changed import changed

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


def test_what_lies_beyond_avx2_is_switched_off_group_by_group():
    environment = {}
    missing = pin_arithmetic(environment, _CASCADE_LAKE, (1, 26))
    assert environment == missing
    assert environment == {
        "OPENBLAS_NUM_THREADS": "1",
        "OPENBLAS_CORETYPE": "Haswell",
        "NPY_DISABLE_CPU_FEATURES": "AVX512F AVX512CD AVX512_SKX AVX512_CLX",
    }


@pytest.mark.parametrize(
    ("version", "groups"),
    [
        ((2, 2), "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL"),
        ((2, 3), "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR"),
        ((2, 4), "X86_V4 AVX512_ICL AVX512_SPR"),
        ((2, 5), "X86_V4 AVX512_ICL AVX512_SPR"),
    ],
)
def test_groups_have_the_names_of_the_installed_numpy(version, groups):
    environment = {}
    pin_arithmetic(environment, _SAPPHIRE_RAPIDS, version)
    assert environment["NPY_DISABLE_CPU_FEATURES"] == groups


@pytest.mark.parametrize("flags", [["avx2", "fma"], [], ["avx", "sse4_2"], ["avx2"]])
def test_a_processor_without_more_than_avx2_keeps_all_it_has_and_is_asked_for_nothing_that_it_lacks(flags):
    environment = {}
    pin_arithmetic(environment, flags)
    core_type = {"OPENBLAS_CORETYPE": "Haswell"} if "fma" in flags else {}
    assert environment == {"OPENBLAS_NUM_THREADS": "1", **core_type}


def test_what_the_user_chose_stays():
    chosen = {"OPENBLAS_NUM_THREADS": "4", "OPENBLAS_CORETYPE": "Zen", "NPY_DISABLE_CPU_FEATURES": ""}
    environment = dict(chosen)
    assert (pin_arithmetic(environment, _CASCADE_LAKE), environment) == ({}, chosen)


@pytest.mark.parametrize(
    "package", ["siren_ros", "siren_ros.cli.main", "siren_ros.simulation.roads.road_network", "siren_nodes.cosim"]
)
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


def test_never_lies_longer_before_a_start_than_an_episode_lasts():
    assert units.NEVER + units.steps_from_s(3600.0 * 24.0) < 0


def test_twenty_steps_make_a_second():
    assert (units.STEP_NS, units.STEP_S, units.STEPS_PER_S) == (50_000_000, 0.05, 20)
    assert [units.steps_from_s(duration) for duration in (0.0, 0.05, 0.5, 1.0, 0.12, 0.13)] == [0, 1, 10, 20, 2, 3]


@pytest.mark.parametrize("step", [0, 1, 7, 10**6])
def test_step_and_time_are_inverse(step):
    assert units.time_ns_of_step(step) == step * 50_000_000
    assert units.step_of_time_ns(units.time_ns_of_step(step)) == step


@pytest.mark.parametrize("time_ns", [1, units.STEP_NS - 1, units.STEP_NS + 1])
def test_a_time_beside_the_steps_is_refused(time_ns):
    with pytest.raises(ValueError, match="not a multiple"):
        units.step_of_time_ns(time_ns)


@pytest.mark.parametrize(
    ("time_ns", "text"),
    [(0, "0"), (2_000_000_000, "2"), (2_000_000_001, "2.000000001"), (150_000_000, "0.15"), (-50_000_000, "-0.05")],
)
def test_seconds_are_told_to_the_nanosecond(time_ns, text):
    assert units.exact_s(time_ns) == text


def test_kilometres_per_hour():
    assert units.mps_from_kmh(36.0) == pytest.approx(10.0)


def test_a_stream_depends_on_seed_purpose_and_index_alone():
    def first(*key):
        return random_stream(*key).random(4).tolist()

    assert first(3, "demand", 5) == first(3, "demand", 5)
    keys = [(3, "demand", 5), (4, "demand", 5), (3, "driver", 5), (3, "demand", 6), (5, "demand", 3), (3, "demand")]
    assert len({tuple(first(*key)) for key in keys}) == len(keys)
    assert first(3, "demand") == first(3, "demand", 0)
    assert np.mean(random_stream(1, "mean").random(10_000)) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("weights", [(1.0,), (0.3, 0.0, 0.7), (5.0, 1.0, 2.5, 0.1), tuple(range(1, 30))])
def test_choices_by_weight_are_those_of_numpy_and_take_as_much_from_the_generator(weights):
    own, numpys = random_stream(7, "choice"), random_stream(7, "choice")
    shares = np.array(weights) / np.sum(weights)
    ends = chances(weights)
    assert [drawn(ends, own) for _ in range(300)] == [numpys.choice(len(weights), p=shares) for _ in range(300)]
    assert own.random() == numpys.random()


@dataclass(frozen=True)
class Place:
    x_m: float
    y_m: float = 0.0
    name: str = ""


def test_the_given_fields_change_and_the_structure_itself_does_not():
    place = Place(1.0, name="a")
    moved = changed(place, x_m=2.0, name="b")
    assert moved == replace(place, x_m=2.0, name="b")
    assert place == Place(1.0, name="a")
    assert changed(moved) == moved


def test_a_field_that_does_not_exist_is_refused():
    with pytest.raises(TypeError, match="Place has no field z_m"):
        changed(Place(1.0), z_m=3.0)
