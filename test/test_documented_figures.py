"""Figures and parameters that one page shows and another page or the code has."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from repository import REPOSITORY

from docsite.code_tables import TABLES
from siren_ros.judging.verify import verify_episode
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.ros.node_configs import CosimConfig
from siren_ros.ros.parameters import defaults_of

README: Final = REPOSITORY / "README.md"
BEHAVIOUR: Final = REPOSITORY / "docs" / "behaviour.md"
PREDICTOR: Final = REPOSITORY / "docs" / "siren_predictor.md"
RECORDING: Final = REPOSITORY / "docs" / "recording.md"
EPISODE: Final = REPOSITORY / "docs" / "episode.md"


def rows(page: Path) -> list[list[str]]:
    """The cells of every row of the page's tables."""
    lines = (line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| "))
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_the_results_of_the_readme_are_those_of_the_pages() -> None:
    holds = {cells[0][:2]: cells[1] for cells in rows(BEHAVIOUR) if re.fullmatch(r"S\d, L\d", cells[0])}
    first_table = PREDICTOR.read_text(encoding="utf-8").partition("| mean |")[0].splitlines()
    errors = {
        line[2:4]: [cell.strip() for cell in line.split("|")[3:6]] for line in first_table if line.startswith("| S")
    }
    shown = {cells[0][1:3]: cells[2:] for cells in rows(README) if cells[0].startswith("[S")}
    assert list(shown) == ["S1", "S2", "S3", "S4", "S5", "S6", "S7"]
    assert shown == {name: [holds[name], *errors[name]] for name in shown}, (
        "README's results come from behaviour.md and siren_predictor.md"
    )


def parameters_of_cosim() -> dict[str, str]:
    """The default that the page of the episode shows for each parameter, where its table of ``cosim`` is filled in."""
    assert "<!-- table of cosim -->" in EPISODE.read_text(encoding="utf-8")
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in TABLES["cosim"]().splitlines()[2:]]
    return {name.strip("`"): default.strip("`") for name, default, meaning in cells if meaning}


def test_the_page_of_the_episode_has_every_parameter_of_cosim() -> None:
    assert set(parameters_of_cosim()) == set(defaults_of(CosimConfig))


def test_the_page_of_the_episode_has_the_defaults_of_cosim() -> None:
    defaults = {name: str(value).lower() for name, value in defaults_of(CosimConfig).items() if value not in ("", [])}
    said = {name: default.lower() for name, default in parameters_of_cosim().items() if default}
    assert said == defaults


def test_the_page_of_the_recording_has_every_check_of_verify(record_of: Callable[..., EpisodeRecord]) -> None:
    table = RECORDING.read_text(encoding="utf-8").partition("## What `verify` checks")[2].partition("\n## ")[0]
    documented = re.findall(
        r"`(\w+)`", " ".join(line.split("|")[1] for line in table.splitlines() if line.startswith("|"))
    )
    assert sorted(documented) == sorted(part.name for part in verify_episode(record_of()).checks)
