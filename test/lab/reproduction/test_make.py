"""The parts of a reproduction: read from their file, and made."""

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.lab.reproduction.make import (
    FigureFile,
    Part,
    Reproduction,
    TargetFile,
    inputs_sha256,
    read_parts,
)
from siren_ros.lab.reproduction.results import read_results

PARTS = """
code:
  world: [src]
parts:
- name: town
  about: two episodes
  minutes: 12
  code: [world]
  commands: ["make --out {out}"]
  figures:
  - {file: scores.json, keep: ["S1.*"], prefix: own}
- name: models
  about: errors
  minutes: 200
  needs: [town]
  code: [world]
  files: [outside.txt]
  commands: ["score {town} --out {out}"]
  made:
  - {from: curve.png, to: docs/curve.png}
"""


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "a.py").write_text("1", encoding="utf-8")
    return tmp_path


def parts_of(repository: Path, text: str = PARTS) -> dict[str, Part]:
    file = repository / "parts.yaml"
    file.write_text(text, encoding="utf-8")
    return read_parts(file, repository)


def test_parts_are_read_in_their_order(repository: Path) -> None:
    parts = parts_of(repository)
    assert list(parts) == ["town", "models"]
    assert parts["town"].figures == (FigureFile("scores.json", ("S1.*",), "own"),)
    assert parts["models"].targets == (TargetFile("curve.png", "docs/curve.png"),)
    assert parts["models"].missing(repository) == ("outside.txt",)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("needs: [town]", "needs: [city]", "a part that stands above"),
        ("world: [src]", "world: [gone]", "a file or folder of the repository"),
        ("name: models", "name: town", "each part once"),
        ("code: [world]\n  files", "code: [moon]\n  files", "one of world"),
        ("minutes: 200", "hours: 200", "minutes"),
    ],
)
def test_mistakes_are_named(repository: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parts_of(repository, PARTS.replace(old, new))


def test_the_hash_follows_code_commands_files_and_needs(repository: Path) -> None:
    part = parts_of(repository)["models"]
    (repository / "outside.txt").write_text("x", encoding="utf-8")
    before = inputs_sha256(part, repository, ["n"])
    assert inputs_sha256(part, repository, ["n"]) == before
    assert inputs_sha256(part, repository, ["m"]) != before
    (repository / "src" / "__pycache__").mkdir()
    (repository / "src" / "__pycache__" / "a.pyc").write_text("cache", encoding="utf-8")
    assert inputs_sha256(part, repository, ["n"]) == before
    (repository / "outside.txt").write_text("y", encoding="utf-8")
    changed = inputs_sha256(part, repository, ["n"])
    assert changed != before
    (repository / "src" / "a.py").write_text("2", encoding="utf-8")
    assert inputs_sha256(part, repository, ["n"]) not in {before, changed}
    (repository / "src" / "a.py").rename(repository / "src" / "b.py")
    assert inputs_sha256(part, repository, ["n"]) not in {before, changed}


COUNTS = """
import json, pathlib, sys
out, value = pathlib.Path(sys.argv[1]), sys.argv[2]
with open("runs.txt", "a") as runs: print(out.name, file=runs)
(out / "scores.json").write_text(json.dumps({"value": float(value)}))
(out / "picture.png").write_text(value)
"""


@pytest.fixture
def work(tmp_path: Path) -> Reproduction:
    repository = tmp_path / "repository"
    (repository / "src").mkdir(parents=True)
    (repository / "src" / "a.py").write_text("1", encoding="utf-8")
    (repository / "counts.py").write_text(COUNTS, encoding="utf-8")
    return Reproduction(repository, tmp_path / "out", repository / "results.json", 2)


def part(name: str, *needs: str, code: str = "src", **changes: object) -> Part:
    commands = (f"{sys.executable} counts.py {{out}} {{workers}}",)
    figures = (FigureFile("scores.json", ("value",), ""),)
    values = {"commands": commands, "files": (), "figures": figures, "targets": (), **changes}
    return Part(name, "a part", 90.0, needs, (code,), **values)  # type: ignore[arg-type] # the rest stands in `changes`


def parts(*of: Part) -> dict[str, Part]:
    return {part.name: part for part in of}


def runs(work: Reproduction) -> list[str]:
    """The parts whose command has run, in order."""
    file = work.repository / "runs.txt"
    return file.read_text(encoding="utf-8").split() if file.exists() else []


def make(work: Reproduction, table: dict[str, Part], *only: str) -> tuple[list[str], list[str]]:
    said: list[str] = []
    return work.make(work.plan(table, only), said.append), said


WAITS = """
import pathlib, signal, sys, time
file = pathlib.Path("temporary")
def end(*_):
    file.unlink()
    sys.exit()
signal.signal(signal.SIGTERM, end)
file.touch()
time.sleep(60.0)
"""


def test_a_command_that_is_interrupted_is_asked_to_end(work: Reproduction) -> None:
    (work.repository / "waits.py").write_text(WAITS, encoding="utf-8")
    file = work.repository / "temporary"

    def interrupt() -> None:
        while not file.exists():  # until the time limit of the test
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    interrupting = threading.Thread(target=interrupt)
    interrupting.start()
    with pytest.raises(KeyboardInterrupt):
        make(work, parts(part("a", commands=(f"{sys.executable} waits.py",))))
    interrupting.join()
    assert not file.exists()


def test_parts_are_made_once_and_their_figures_kept(work: Reproduction) -> None:
    """What the second part puts into the repository is an input of the third one."""
    (work.repository / "picture.png").write_text("old", encoding="utf-8")
    second = part("b", "a", targets=(TargetFile("picture.png", "picture.png"),))
    table = parts(part("a"), second, part("c", code="picture.png"))
    failed, said = make(work, table)
    assert failed == []
    assert said[:3] == [f"{name}                a part: 90 min" for name in "abc"]
    assert said[3] == "3 of 3 parts to make, 4.5 h on two cores"
    result = read_results(work.results)["b"]
    assert result.figures == {"value": 2.0}
    assert result.commands == table["b"].commands
    assert (work.repository / "picture.png").read_text(encoding="utf-8") == "2"
    failed, said = make(work, table)
    assert "0 of 3 parts to make, 0 min on two cores" in said
    assert runs(work) == ["a", "b", "c"]


def test_a_pattern_stands_for_files_whose_folders_name_the_figures(work: Reproduction) -> None:
    commands = tuple(f"mkdir -p {{out}}/{name}" for name in ("rain/0", "rain/1", "fog/0"))
    commands += tuple(
        f"{sys.executable} counts.py {{out}}/{name} {n}" for n, name in ((1, "rain/0"), (3, "rain/1"), (4, "fog/0"))
    )
    about = {"ratios": ("more=of.rain.1/of.fog.0",), "means": ("rain=of.rain.?",)}
    sources = (FigureFile("*/?/scores.json", ("value",), "of", ("value",), **about),)
    make(work, parts(part("a", commands=commands, figures=sources)))
    of_a = {"of.rain.0": 1.0, "of.rain.1": 3.0, "of.fog.0": 4.0, "rain": 2.0, "more": 0.75}
    assert read_results(work.results)["a"].figures == of_a
    for name, wrong in (("ratios", "x=a/b"), ("means", "x=b.*")):
        source = FigureFile("scores.json", ("value",), "", **{name: (wrong,)})
        assert "x=" in make(work, parts(part("b", figures=(source,))))[0][0]


def test_changed_code_makes_the_part_and_those_that_need_it_again(work: Reproduction) -> None:
    (work.repository / "other").mkdir()
    table = parts(part("a"), part("b", "a", code="other"), part("c", code="other"))
    make(work, table, "b")
    assert runs(work) == ["a", "b"], "only what is asked for and what it needs"
    with pytest.raises(InputError, match="one or several of a, b, c"):
        work.plan(table, ("d",))
    make(work, table)
    (work.repository / "src" / "a.py").write_text("2", encoding="utf-8")
    make(work, table)
    assert runs(work) == ["a", "b", "c", "a", "b"]


def test_a_folder_that_is_gone_is_made_again_where_it_is_read(work: Reproduction) -> None:
    table = parts(part("a"), part("b", "a"))
    make(work, table)
    (work.out / "a" / "inputs_sha256").unlink()
    assert not any(step.due for step in work.plan(table))
    changed = parts(part("a"), part("b", "a", figures=(), commands=("true",)))
    assert [step.due for step in work.plan(changed)] == [True, True]


def test_a_failing_part_stops_only_those_that_need_it(work: Reproduction) -> None:
    bad = part("a", commands=(f"{sys.executable} -c 'print(\"reason\"); exit(3)'",))
    failed, _ = make(work, parts(bad, part("b", "a"), part("c")))
    assert [line.split(":")[0] for line in failed] == ["a", "b"]
    assert "exit code 3: " in failed[0]
    assert failed[0].endswith("reason")
    assert runs(work) == ["c"]
    assert list(read_results(work.results)) == ["c"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"commands": ("no_such_program",)}, "No such file"),
        ({"commands": ("true",)}, "scores.json cannot be read"),
        ({"figures": (FigureFile("*/scores.json", ("value",), ""),)}, "*/scores.json was not written"),
        ({"targets": (TargetFile("film.mp4", "film.mp4"),)}, "film.mp4 was not written"),
    ],
)
def test_what_a_part_lacks_is_named(work: Reproduction, changes: dict[str, object], message: str) -> None:
    failed, _ = make(work, parts(part("a", **changes)))
    assert message in failed[0]


def test_interrupted_work_goes_on_and_stale_work_goes(work: Reproduction) -> None:
    table = parts(part("a", commands=("false",), figures=()))
    make(work, table)
    (work.out / "a" / "half.json").write_text(json.dumps(1), encoding="utf-8")
    make(work, table)
    assert (work.out / "a" / "half.json").exists()
    (work.repository / "src" / "a.py").write_text("2", encoding="utf-8")
    make(work, table)
    assert not (work.out / "a" / "half.json").exists()


def test_parts_without_their_files_are_skipped_with_the_reason(work: Reproduction) -> None:
    failed, said = make(work, parts(part("a", files=("../maps/x.xodr",)), part("b", "a")))
    assert failed == []
    assert runs(work) == []
    assert said[0].endswith("skipped, as ../maps/x.xodr is not there; CONTRIBUTING.md says where it comes from")
    assert said[1].endswith("skipped, as a is not there")
