"""Which episodes of a study need not be made again."""

from dataclasses import replace
from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.scenario.episode import EpisodeRequest
from siren_ros.studies.episode_row import EpisodeRow, Status
from siren_ros.studies.matrix import PlannedEpisode
from siren_ros.studies.run_study import finished_row
from siren_ros.studies.study_folder import LocalFolder, hashes_of_bag

PLANNED = PlannedEpisode("S2_L2_seed3", "S2_L2", EpisodeRequest("S2", "L2", 3), -1, "ab" * 32)


def bag_in(folder: Path, content: bytes = b"storage") -> Path:
    folder.mkdir(parents=True)
    (folder / "bag_0.mcap").write_bytes(content)
    (folder / "metadata.yaml").write_text("meta: 1\n")
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> LocalFolder:
    """A study with the bag of the episode, and its row next to it."""
    bag = bag_in(tmp_path / "bag")
    storage, metadata = hashes_of_bag(bag)
    row = EpisodeRow.planned(PLANNED, Status.COMPLETE, mcap_sha256=storage, metadata_sha256=metadata)
    study = LocalFolder(tmp_path / "study")
    study.take(bag, row)
    return study


@pytest.fixture
def row(folder: LocalFolder) -> EpisodeRow:
    stored = folder.row_of("episodes/S2_L2/S2_L2_seed3")
    assert stored is not None
    return stored


def test_a_row_of_the_table_whose_bag_is_whole(folder: LocalFolder, row: EpisodeRow) -> None:
    known = replace(row, attempts=7)
    assert finished_row(PLANNED, folder, known) == known


def test_a_row_next_to_the_bag_where_the_table_lacks_it_or_is_older(folder: LocalFolder, row: EpisodeRow) -> None:
    assert finished_row(PLANNED, folder, None) == row
    for old in (replace(row, mcap_sha256="0" * 64), replace(row, status=Status.CRASHED)):
        assert finished_row(PLANNED, folder, old) == row


def test_what_is_not_there_or_was_changed_is_made_again(folder: LocalFolder, row: EpisodeRow, tmp_path: Path) -> None:
    other = replace(PLANNED, name="S2_L2_seed4")
    assert finished_row(other, folder, None) is None
    (tmp_path / "study" / row.path / "bag_0.mcap").write_bytes(b"changed")
    assert finished_row(PLANNED, folder, row) is None
    assert finished_row(PLANNED, folder, None) is None


def test_an_episode_of_other_inputs_is_no_episode_of_this_study(folder: LocalFolder, row: EpisodeRow) -> None:
    changed = replace(PLANNED, inputs_sha256="cd" * 32)
    for known in (row, None):
        with pytest.raises(InputError, match="S2_L2_seed3 made from other inputs"):
            finished_row(changed, folder, known)
