"""Episodes run as a user runs them: the program cosim in a process of its own, with its own DDS domain."""

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from faulty_episodes import Episode, Start
from live_episodes import Domain, Run

DOMAIN = Domain(subprocess.Popen)
FAULTY_DOMAIN = Domain()


@pytest.fixture(scope="session")
def cosim() -> Callable[..., Run]:
    """Runs an episode to its end."""
    return DOMAIN.run


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts episodes that something happens to, in the test's folder; all their processes are gone afterwards."""
    started: list[Episode] = []

    def begin(*parameters: str, **options: object) -> Episode:
        started.append(Episode(FAULTY_DOMAIN, tmp_path, *parameters, **options))  # type: ignore[arg-type] # forwarded
        return started[-1]

    yield begin
    for episode in started:
        episode.kill_all()
