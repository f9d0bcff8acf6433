"""Which tests can notice a change of a line."""

import pytest

from mutants.baseline import Baseline, baseline_from

NAMES = ("test/a/test_other.py::test_quick", "test/a/test_code.py::test_slow", "test/a/test_code.py::test_quick")
BASELINE = Baseline(
    seconds=dict(zip(NAMES, (0.1, 2.0, 0.2), strict=True)),
    left_out=[],
    lines={
        "lib/a/code.py": {1: [], 4: [NAMES[0], NAMES[1]], 5: [NAMES[1], "test/a/test_code.py::test_left_out"]},
        "lib/a/loops.py": {1: [], 2: []},
    },
    loaded=[],
    environment={},
)


@pytest.mark.parametrize(
    ("file", "line", "tests"),
    [
        ("lib/a/code.py", 4, [NAMES[1], NAMES[0]]),
        ("lib/a/code.py", 5, [NAMES[1]]),
        ("lib/a/code.py", 1, [NAMES[2], NAMES[1], NAMES[0]]),
        ("lib/a/code.py", 9, [NAMES[2], NAMES[1], NAMES[0]]),
        ("lib/a/loops.py", 7, [NAMES[2], NAMES[1], NAMES[0]]),
        ("lib/a/never_loaded.py", 7, [NAMES[2], NAMES[1], NAMES[0]]),
    ],
)
def test_the_mirrored_files_tests_come_first_and_count_always_for_lines_that_are_not_traced(file, line, tests):
    assert BASELINE.tests_for(file, line, "test/a/test_code.py") == tests


def test_slow_and_failing_tests_are_left_out():
    answer = {
        "seconds": {"one": 0.5, "two": 3.0, "three": 0.1},
        "failed": ["three"],
        "lines": {"lib/a/code.py": {"4": ["one"]}},
        "loaded": ["numpy"],
        "environment": {"OPENBLAS_NUM_THREADS": "1", "PYTEST_VERSION": "9"},
    }
    baseline = baseline_from(answer, slow_s=2.0)
    assert baseline.seconds == {"one": 0.5}
    assert baseline.left_out == ["three", "two"]
    assert baseline.lines == {"lib/a/code.py": {4: ["one"]}}
    assert baseline.environment == {"OPENBLAS_NUM_THREADS": "1"}
