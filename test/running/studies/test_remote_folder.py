import copy
from dataclasses import replace
from pathlib import Path
from uuid import uuid4

import pytest

pytest.importorskip("fsspec", reason="needs the extra cluster: ./env --with cluster")

from recorded_episode import quick_template

from siren_ros.errors import InputError
from siren_ros.running.studies.episode_row import Status
from siren_ros.running.studies.matrix import Study
from siren_ros.running.studies.run_study import LocalWorkers, run_study
from siren_ros.running.studies.study_folder import LocalFolder, RemoteFolder, folder_at, read_table

STUDY = Study((quick_template("S2"),), ("L0", "own"), duration_s=0.5)


def test_a_study_behind_a_url_is_made_and_resumed(tmp_path: Path) -> None:
    url = f"memory://studies/{uuid4().hex}"
    folder = folder_at(url)
    assert isinstance(folder, RemoteFolder)
    result = run_study(STUDY, folder, LocalWorkers(2))
    assert [row.status for row in result.rows] == [Status.COMPLETE] * 2
    assert read_table(folder) == tuple(sorted(result.rows, key=lambda row: row.episode))
    assert run_study(STUDY, folder, LocalWorkers(1)).kept == 2
    (first, second) = result.rows
    local = run_study(replace(STUDY, levels=("L0",)), LocalFolder(tmp_path), LocalWorkers(1)).rows[0]
    assert folder.hashes_of(first.path) == (local.mcap_sha256, local.metadata_sha256)
    folder.write(f"{second.path}/{second.episode}_0.mcap", b"half of it")  # an upload that was cut off
    assert run_study(STUDY, folder, LocalWorkers(2)).kept == 1
    assert folder.hashes_of(second.path) == (second.mcap_sha256, second.metadata_sha256)


def test_local_urls_and_paths(tmp_path: Path) -> None:
    folder = folder_at(f"file://{tmp_path}/study")
    folder.write("a/b.json", b"content")
    assert (tmp_path / "study" / "a" / "b.json").read_bytes() == b"content"
    assert isinstance(folder_at(str(tmp_path)), LocalFolder)


def test_another_process_opens_the_same_place() -> None:
    folder = folder_at("memory://studies/x")
    again = copy.copy(folder)  # as pickle does it
    assert again is not folder
    assert again.place == folder.place


@pytest.mark.parametrize("url", ["nowhere://x", "s4://bucket"])
def test_a_url_that_nobody_knows_is_refused(url: str) -> None:
    with pytest.raises(InputError, match="URL"):
        folder_at(url)
