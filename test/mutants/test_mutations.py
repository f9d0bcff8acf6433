"""Mutants of a source: operators, places, what counts as noticed, and the report."""

import subprocess

import pytest

from mutants.baseline import Baseline, baseline_from
from mutants.mutations import changed_lines, mutants_of, sample
from mutants.places import changed_lines_since, files_below, folder_of, mirror_of

SOURCE = "def area(a, b):\n    return a * b\n\n\ndef gap(a, b):\n    return a - b if a > b else 0\n"


def test_only_the_lines_that_are_asked_for():
    assert {mutant.line for mutant in mutants_of("f.py", SOURCE)} == {2, 6}
    assert {mutant.line for mutant in mutants_of("f.py", SOURCE, {6, 7})} == {6}
    assert mutants_of("f.py", SOURCE, {1}) == []


def test_a_seed_draws_the_same_sample_each_time_and_another_seed_another_one():
    every = mutants_of("f.py", SOURCE * 8)
    first = sample(every, 10, 1)
    assert first == sample(every, 10, 1)
    assert first != sample(every, 10, 2)
    assert len(set(first)) == 10
    assert set(first) <= set(every)
    assert [mutant.line for mutant in first] == sorted(mutant.line for mutant in first)
    assert sample(every, None, 1) == sample(every, 10_000, 2)
    assert set(sample(every, None, 1)) == set(every)


def changes(source):
    return {changed_lines(mutant, source)[1] for mutant in mutants_of("code.py", source)}


@pytest.mark.parametrize(
    ("source", "changed"),
    [
        ("x = a - b", "x = a + b"),
        ("x = a * b", "x = a / b"),
        ("x = a < b", "x = a <= b"),
        ("x = a < b", "x = a >= b"),
        ("x = gap_m < b", "x = gap_m >= b"),
        ("x = step < end_step", "x = step <= end_step"),
        ("SPEED_MPS: Final = 50.0 / 3.6", "SPEED_MPS: Final = 50.0 * 3.6"),
        ("x = -a", "x = +a"),
        ("x = not a", "x =  a"),
        ("x = a and b", "x = a or b"),
        ("f(True)", "f(False)"),
        ("f(3)", "f( 4)"),
        ("x = np.minimum(a, b)", "x = np.maximum(a, b)"),
        ("x = all(a)", "x = any(a)"),
        ("x = replace(unit, count=0, side=side)", "x = replace(unit, side=side)"),
    ],
)
def test_mistakes_of_a_tired_programmer_are_made(source, changed):
    assert changed in changes(source)


@pytest.mark.parametrize(
    "source",
    [
        "class Config:\n    width_m: float = 3.5",
        "def number(a: int | None) -> int | None: ...",
        "@dataclass(frozen=True)\nclass A: ...",
        "raise ValueError(f'{a + 1}')",
        "def min(a): ...",
        "def number(a, *, b): ...",
        "zip(a, b, strict=True)",
        "minimum = maximum",
        "LENGTH_M: Final = 3.5",
        "read(section.number('length_m', 0.5, 9.0))",
    ],
)
def test_settings_annotations_and_messages_are_left_alone(source):
    assert not changes(source)


def test_each_change_gives_another_program_and_says_where():
    source = "def f(a, b):\n    return max(a - b, 2.0) if a < b else -b\n"
    mutants = mutants_of("code.py", source)
    assert {mutant.line for mutant in mutants} == {2}
    texts = [mutant.text(source) for mutant in mutants]
    assert len(set(texts)) == len(texts)
    assert source not in texts
    for text in texts:
        compile(text, "code.py", "exec")


@pytest.mark.parametrize("source", ["x = gap_m < b", "x = seen.speed_mps[row] < limit", "x = share < 0.5"])
def test_whether_a_limit_counts_as_inside_is_left_alone_where_measured_numbers_are_compared(source):
    assert source.replace("<", "<=") not in changes(source)
    assert source.replace("<", ">=") in changes(source)


def git(root, *arguments):
    identity = ["-c", "user.name=t", "-c", "user.email=t@example.org"]
    subprocess.run(["git", *identity, *arguments], cwd=root, check=True, capture_output=True)


@pytest.mark.parametrize(
    ("file", "package", "tests", "mirror"),
    [
        ("lib/a/b/x/c.py", "lib/a/b", "test/a/b", "test/a/b/x/test_c.py"),
        ("lib/a/b/c.py", "lib/a/b", "test/a/b", "test/a/b/test_c.py"),
        ("lib/a/c.py", "lib/a", "test/a", "test/a/test_c.py"),
        ("lib/c.py", "lib/c.py", "test/test_c.py", "test/test_c.py"),
    ],
)
def test_the_tests_of_a_file_are_in_the_folder_of_the_same_name(file, package, tests, mirror):
    assert (folder_of(file).package, folder_of(file).tests, mirror_of(file)) == (package, tests, mirror)


def test_files_below_folders_without_those_of_packages(tmp_path):
    for name in ("a/__init__.py", "a/one.py", "a/b/two.py", "c.py", "a/text.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert files_below(tmp_path, ["a"]) == ["a/b/two.py", "a/one.py"]
    assert files_below(tmp_path, ["c.py", "a/one.py"]) == ["a/one.py", "c.py"]
    with pytest.raises(FileNotFoundError, match="nowhere"):
        files_below(tmp_path, ["nowhere"])


def test_lines_of_a_change_are_those_of_the_present_text(tmp_path):
    git(tmp_path, "init", "-q")
    file = tmp_path / "a.py"
    file.write_text("one\ntwo\nthree\nfour\n")
    (tmp_path / "b.py").write_text("one\n")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "first")
    file.write_text("zero\none\nTWO\nthree\n")
    (tmp_path / "b.py").unlink()
    assert changed_lines_since(tmp_path, "HEAD") == {"a.py": {1, 3}}
    with pytest.raises(ValueError, match="nowhere"):
        changed_lines_since(tmp_path, "nowhere")


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
