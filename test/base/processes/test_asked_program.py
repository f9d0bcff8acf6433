"""Tests of programs that are asked line by line: they answer in turn, and what they must not do is refused."""

import os
import sys
import time
from pathlib import Path

import pytest

from siren_ros.base.processes.asked_program import asked_program, container_words, isolation
from siren_ros.errors import InputError

ECHO = "import sys\nfor line in sys.stdin:\n    print(line.strip()[::-1], flush=True)\n"
HIDES_FILES = "without other files" in isolation()


def asked(folder: Path, source: str, *lines: str, answer_s: float = 20.0, memory_mb: int = 1024) -> list[str]:
    """What a Python program answers to some lines."""
    (folder / "run.py").write_text(source)
    with asked_program(
        ["python3", "run.py"], folder, answer_s=answer_s, memory_mb=memory_mb, processor_s=20.0, readable=[folder]
    ) as ask:
        return [ask(line).strip() for line in lines]


def test_a_program_answers_line_by_line(tmp_path: Path) -> None:
    long = "ab" * 200_000  # more than a pipe holds
    assert asked(tmp_path, ECHO, "one", long, "three") == ["eno", long[::-1], "eerht"]


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("import sys\nsys.stdin.readline()\nraise SystemExit('no idea')", "it ended.*no idea"),
        ("import time\ntime.sleep(60)", "no answer within 1 s"),
        ("import sys\nsys.stdin.readline()\nsys.stdin.readline()\nprint('ahead', flush=True)", "no answer within 1 s"),
        ("import sys\nsys.stdin.readline()\nprint('a\\nb', flush=True)", "more than one line"),
        ("import sys\nsys.stdin.readline()\nx = bytearray(2**31)\nprint('large', flush=True)", "it ended.*MemoryError"),
    ],
)
def test_a_program_that_does_not_keep_to_the_limits_is_refused(source: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=why):
        asked(tmp_path, source, "question", answer_s=1.0)


def test_what_a_program_started_ends_with_it(tmp_path: Path) -> None:
    source = (
        "import os, subprocess, sys\nfor line in sys.stdin:\n"
        "    child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60.0)'])\n"
        "    print(child.pid, os.environ['HOME'], flush=True)\n"
    )
    child, home = asked(tmp_path, source, "question")[0].split()
    assert not Path(home).exists()
    while (state := Path(f"/proc/{child}/stat")).exists():  # until the time limit of the test
        if state.read_text().rsplit(")", 1)[1].split()[0] == "Z":  # ended, but not yet awaited
            break
        time.sleep(0.05)


@pytest.mark.skipif(not HIDES_FILES, reason="the kernel has no Landlock")
def test_a_program_sees_neither_other_files_nor_other_processes(tmp_path: Path) -> None:
    secret, folder = tmp_path / "secret", tmp_path / "own"
    secret.write_text("the truth")
    folder.mkdir()
    source = f"""
import os, sys
places = [{str(secret)!r}, f"/proc/{{os.getppid()}}/mem", f"/proc/{{os.getppid()}}/environ", "run.py"]
for line in sys.stdin:
    found = []
    for place in places:
        try:
            open(place, "rb").read(1)
            found.append(place)
        except OSError:
            pass
    try:
        os.truncate({str(secret)!r}, 0)
        found.append("truncated")
    except OSError:
        pass
    print(found, set(os.environ) - {{"LC_CTYPE"}}, flush=True)
"""
    (said,) = asked(folder, source, "question")
    assert said.startswith("['run.py']")
    assert secret.read_text() == "the truth"
    assert str(tmp_path) not in said
    assert sys.executable not in said


@pytest.mark.skipif(not HIDES_FILES, reason="the kernel has no Landlock")
def test_a_program_of_the_system_that_is_a_link_reads_the_folders_of_its_installation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An interpreter that lies in a prefix of its own, with its library."""
    links, told, library = tmp_path / "bin", tmp_path / "own/bin/told", tmp_path / "own/library"
    for folder in (links, told.parent):
        folder.mkdir(parents=True)
    library.write_text("known")
    told.write_text(f"#!/bin/sh\nread line\ncat {library}\necho\nread line\n")
    told.chmod(0o755)
    (links / "told").symlink_to(told)
    monkeypatch.setattr(os, "defpath", f"{links}{os.pathsep}{os.defpath}")
    with asked_program(["told"], links, answer_s=20.0, memory_mb=1024, processor_s=20.0, readable=[links]) as ask:
        assert ask("question") == "known\n"


def test_a_container_has_no_network_and_reads_two_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name, **_: "/usr/bin/podman" if name == "podman" else None)
    words = container_words("python:3.12", tmp_path / "own", tmp_path / "maps", 512, 60.0)
    assert words[:4] == ["/usr/bin/podman", "run", "--rm", "-i"]
    assert words[words.index("--network") + 1] == "none"
    assert words[words.index("--memory") + 1] == "512m"
    assert words[words.index("--ulimit") + 1] == "cpu=61"
    assert words[words.index("--cap-drop") + 1] == "ALL"
    assert "--read-only" in words
    assert [word for word in words if word.startswith(str(tmp_path))] == [
        f"{tmp_path}/own:/submission:ro",
        f"{tmp_path}/maps:/read:ro",
    ]
    monkeypatch.setattr("shutil.which", lambda *_, **__: None)
    with pytest.raises(InputError, match="docker or podman"):
        container_words("python:3.12", tmp_path, tmp_path, 512, 60.0)
