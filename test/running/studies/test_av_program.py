"""How long ``cosim`` and the program that drives its AV are waited for."""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator

import pytest

from siren_ros.running.studies import av_program

Child = Callable[[str], "subprocess.Popen[str]"]


@pytest.fixture
def child() -> Iterator[Child]:
    started: list[subprocess.Popen[str]] = []

    def start(code: str) -> subprocess.Popen[str]:
        started.append(subprocess.Popen([sys.executable, "-c", code], text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


LASTS = "import time; time.sleep(600)"


@pytest.mark.parametrize("ends", ["", "raise SystemExit(3)"])
def test_an_episode_that_ends_gives_its_code(child: Child, ends: str) -> None:
    assert av_program.wait_for_episode(child(ends), child(LASTS), 60.0) == (3 if ends else 0)


@pytest.mark.timeout(60)
def test_an_episode_is_not_waited_for_once_its_driver_has_failed(child: Child, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program that does not start would cost two minutes in each episode of an exam."""
    monkeypatch.setattr(av_program, "TOLD_S", 0.5)
    cosim = child(LASTS)
    assert av_program.wait_for_episode(cosim, child("raise SystemExit(2)"), 600.0) is None
    assert cosim.poll() is None


def test_a_driver_that_has_ended_well_ends_no_episode(child: Child, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(av_program, "TOLD_S", 0.0)
    driver = child("")
    driver.wait()
    assert av_program.wait_for_episode(child("import time; time.sleep(1)"), driver, 60.0) == 0


def test_an_episode_that_takes_too_long_gives_no_code(child: Child) -> None:
    assert av_program.wait_for_episode(child(LASTS), child(LASTS), 0.5) is None


def test_a_programs_words_are_shown_without_escape_codes() -> None:
    with tempfile.TemporaryFile("w+", encoding="utf-8") as words:
        words.write("one\n\x1b[31mred\x1b[0m\n")
        assert av_program.lines_of(words) == ["one", r"\x1b[31mred\x1b[0m"]
