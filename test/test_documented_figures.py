"""Figures and parameters that one page shows and another page or the code has."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest
from repository import REPOSITORY

from docsite.code_tables import TABLES, with_rows
from siren_ros.judging.verify import verify_episode
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.reproduction.documents import filled, marks_in, unmarked_figures, write_blocks
from siren_ros.reproduction.parts import read_parts
from siren_ros.reproduction.results import PartResult, read_results
from siren_ros.ros.node_configs import CosimConfig
from siren_ros.ros.parameters import defaults_of

README: Final = REPOSITORY / "README.md"
RECORDING: Final = REPOSITORY / "docs" / "recording.md"
EPISODE: Final = REPOSITORY / "docs" / "episode.md"


RESULTS: Final = REPOSITORY / "docs" / "results.json"
DOCUMENTS: Final = sorted([*REPOSITORY.glob("*.md"), *(REPOSITORY / "docs").rglob("*.md")])
README_RESULTS: Final = REPOSITORY / "tools" / "docsite" / "readme_results.md"
CONSTANTS: Final = {
    "docs/datasets.md": {"1.25"},
    "docs/detection.md": {"0.11"},
    "docs/environment.md": {"17.7"},
    "docs/library.md": {"1.26"},
    "docs/paper.md": {"0.68", "1.24", "1.28", "1.29"},
    "docs/predictors.md": {"3.10"},
    "docs/sensors.md": {"0.67"},
    "docs/studies.md": {"2.55"},
}
"""Numbers of a document that equal a figure of the results by chance: constants, versions, values of cited sources."""


@pytest.fixture(scope="module")
def results() -> dict[str, PartResult]:
    return read_results(RESULTS)


def shown_figures(results: dict[str, PartResult]) -> dict[str, str]:
    """The figures as the documents show them, with a mark of each."""
    texts = [with_rows(path.read_text(encoding="utf-8")) for path in (*DOCUMENTS, README_RESULTS)]
    marks = [
        f"{{{{{part}.{name}{f':{form}' if form else ''}}}}}" for text in texts for part, name, form in marks_in(text)
    ]
    return {filled(mark, results, "mark"): mark for mark in marks}


@pytest.mark.parametrize("path", [*DOCUMENTS, README_RESULTS], ids=lambda path: path.name)
def test_each_mark_names_a_figure_of_the_results(path: Path, results: dict[str, PartResult]) -> None:
    assert "{{" not in filled(with_rows(path.read_text(encoding="utf-8")), results, path.name)


def test_the_results_of_the_readme_are_those_of_the_file(results: dict[str, PartResult], tmp_path: Path) -> None:
    copy = tmp_path / "README.md"
    copy.write_text(README.read_text(encoding="utf-8"), encoding="utf-8")
    source = tmp_path / README_RESULTS.relative_to(REPOSITORY)
    source.parent.mkdir(parents=True)
    source.write_text(README_RESULTS.read_text(encoding="utf-8"), encoding="utf-8")
    assert not write_blocks(copy, results), "siren reproduce writes README.md"


def test_documents_hold_no_measured_figure_as_text(results: dict[str, PartResult]) -> None:
    shown = shown_figures(results)
    assert len(shown) > 100
    by_hand = []
    for path in DOCUMENTS:
        text = re.sub(
            r"<!-- results: .*?<!-- end of results -->", "", path.read_text(encoding="utf-8"), flags=re.DOTALL
        )
        name = path.relative_to(REPOSITORY).as_posix()
        measured = {figure: mark for figure, mark in shown.items() if figure not in CONSTANTS.get(name, ())}
        by_hand += [f"{name}:{line}" for line in unmarked_figures(text, measured)]
    assert not by_hand


NO_FIGURES = {"episodes", "pictures"}
NOT_RUN = {"learning", "train_driver"}
"""Parts that wait for their first run; the documents show no figure of them."""


def test_every_part_of_the_results_is_a_part_of_the_reproduction(results: dict[str, PartResult]) -> None:
    parts = read_parts(REPOSITORY / "params" / "reproduction.yaml", REPOSITORY)
    assert set(results) <= set(parts)
    assert set(parts) - set(results) <= NO_FIGURES | NOT_RUN


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
    assert "<!-- table of checks -->" in RECORDING.read_text(encoding="utf-8")
    documented = re.findall(r"^\| `(\w+)` \| \w", TABLES["checks"](), re.MULTILINE)
    assert documented == [part.name for part in verify_episode(record_of()).checks]
