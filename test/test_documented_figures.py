"""Figures and parameters that one page shows and another page or the code has."""

import re
from collections.abc import Callable
from typing import Final

import pytest
from repository import REPOSITORY

from docsite.code_tables import TABLES
from docsite.documents import documents_of, figure_of, figures_by_hand, sources_in
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.lab.reproduction.make import read_parts
from siren_ros.lab.reproduction.results import PartResult, read_results
from siren_ros.scoring.judging.verify import verify_episode

DOCUMENTS: Final = documents_of(REPOSITORY)
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
    return read_results(REPOSITORY / "docs" / "results.json")


def test_documents_hold_no_measured_figure_without_its_source(results: dict[str, PartResult]) -> None:
    texts = {path: path.read_text(encoding="utf-8") for path in DOCUMENTS}
    sources = {figure_of(results, "", source): source for text in texts.values() for source in sources_in(text)}
    assert len(sources) > 100
    by_hand = []
    for path, text in texts.items():
        name = path.relative_to(REPOSITORY).as_posix()
        measured = {figure: source for figure, source in sources.items() if figure not in CONSTANTS.get(name, ())}
        by_hand += [f"{name}: {figure}" for figure in figures_by_hand(text, measured)]
    assert not by_hand


NO_FIGURES = {"episodes", "pictures"}
NOT_RUN = {"learning", "train_driver"}
"""Parts that wait for their first run; the documents show no figure of them."""


def test_every_part_of_the_results_is_a_part_of_the_reproduction(results: dict[str, PartResult]) -> None:
    parts = read_parts(REPOSITORY / "params" / "reproduction.yaml", REPOSITORY)
    assert set(results) <= set(parts)
    assert set(parts) - set(results) <= NO_FIGURES | NOT_RUN


def test_the_page_of_the_recording_has_every_check_of_verify(record_of: Callable[..., EpisodeRecord]) -> None:
    documented = re.findall(r"^\| `(\w+)` \| \w", TABLES["checks"](), re.MULTILINE)
    assert documented == [part.name for part in verify_episode(record_of()).checks]
