"""A study on disk: rows, hashes, which episodes need not be made again, and what is replaced."""

import io
import subprocess
import sys
from dataclasses import fields, replace
from hashlib import sha256
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml

from siren_ros.errors import InputError
from siren_ros.running.studies.episode_row import EpisodeRow, Status, manifest_bytes, path_of, rows_of_manifest
from siren_ros.running.studies.matrix import PlannedEpisode
from siren_ros.running.studies.run_study import finished_row
from siren_ros.running.studies.study_folder import (
    LocalFolder,
    attempt_folder,
    hashes_of_bag,
    is_finished,
    read_table,
    write_study,
    write_table,
)
from siren_ros.simulation.scenario.episode import EpisodeRequest

PLANNED = PlannedEpisode("S2_L2_seed3", "S2_L2", EpisodeRequest("S2", "L2", 3), -1, "ab" * 32)
_KNOWN = {"retry_reasons": ("crashed", "hung"), "versions": {"siren": "1"}, "predicate_holds": True}
ROW = EpisodeRow.planned(PLANNED, Status.COMPLETE, **_KNOWN)


def bag_in(folder: Path, content: bytes = b"storage") -> Path:
    folder.mkdir(parents=True)
    (folder / "bag_0.mcap").write_bytes(content)
    (folder / "metadata.yaml").write_text("meta: 1\n")
    return folder


@pytest.fixture
def study(tmp_path: Path) -> LocalFolder:
    return LocalFolder(tmp_path / "study")


def test_a_bag_goes_to_its_place_and_its_row_next_to_it(study: LocalFolder, tmp_path: Path) -> None:
    study.take(bag_in(tmp_path / "scratch" / "bag"), ROW)
    assert ROW.path == path_of("S2_L2", "S2_L2_seed3") == "episodes/S2_L2/S2_L2_seed3"
    assert (tmp_path / "study" / ROW.path / "bag_0.mcap").read_bytes() == b"storage"
    assert not (tmp_path / "scratch" / "bag").exists()
    assert study.row_of(ROW.path) == ROW
    assert study.row_of("episodes/S2_L2/other") is None


def test_a_later_bag_replaces_an_earlier_one(study: LocalFolder, tmp_path: Path) -> None:
    study.take(bag_in(tmp_path / "one"), ROW)
    (tmp_path / "study" / ROW.path / "left").touch()
    study.take(bag_in(tmp_path / "two", b"later"), replace(ROW, attempts=2))
    names = sorted(path.name for path in (tmp_path / "study" / ROW.path).iterdir())
    assert names == ["bag_0.mcap", "metadata.yaml"]
    assert study.row_of(ROW.path) == replace(ROW, attempts=2)


def test_finished_is_who_is_complete_and_has_the_bytes_of_its_row(study: LocalFolder, tmp_path: Path) -> None:
    hashes = hashes_of_bag(bag_in(tmp_path / "bag"))
    assert hashes == (sha256(b"storage").hexdigest(), sha256(b"meta: 1\n").hexdigest())
    whole = replace(ROW, mcap_sha256=hashes[0], metadata_sha256=hashes[1])
    assert not is_finished(study, whole), "the bag is not there"
    study.take(tmp_path / "bag", whole)
    assert is_finished(study, whole)
    for status in (Status.FAILED, Status.REFUSED, Status.CRASHED):
        assert not is_finished(study, replace(whole, status=status))
    assert not is_finished(study, replace(whole, mcap_sha256=""))
    assert not is_finished(study, replace(whole, metadata_sha256="0" * 64))
    (tmp_path / "study" / whole.path / "bag_0.mcap").write_bytes(b"changed")
    assert not is_finished(study, whole)


@pytest.fixture
def row(study: LocalFolder, tmp_path: Path) -> EpisodeRow:
    """Of an episode whose bag is in the study, with its row next to it."""
    bag = bag_in(tmp_path / "bag")
    storage, metadata = hashes_of_bag(bag)
    study.take(bag, EpisodeRow.planned(PLANNED, Status.COMPLETE, mcap_sha256=storage, metadata_sha256=metadata))
    return study.row_of(ROW.path)


def test_a_row_of_the_table_whose_bag_is_whole(study: LocalFolder, row: EpisodeRow) -> None:
    known = replace(row, attempts=7)
    assert finished_row(PLANNED, study, known) == known


def test_a_row_next_to_the_bag_where_the_table_lacks_it_or_is_older(study: LocalFolder, row: EpisodeRow) -> None:
    for known in (None, replace(row, mcap_sha256="0" * 64), replace(row, status=Status.CRASHED)):
        assert finished_row(PLANNED, study, known) == row


def test_what_is_not_there_or_was_changed_is_made_again(study: LocalFolder, row: EpisodeRow, tmp_path: Path) -> None:
    assert finished_row(replace(PLANNED, name="S2_L2_seed4"), study, None) is None
    (tmp_path / "study" / row.path / "bag_0.mcap").write_bytes(b"changed")
    assert finished_row(PLANNED, study, row) is None
    assert finished_row(PLANNED, study, None) is None


def test_an_episode_of_other_inputs_is_no_episode_of_this_study(study: LocalFolder, row: EpisodeRow) -> None:
    for known in (row, None):
        with pytest.raises(InputError, match="S2_L2_seed3 made from other inputs"):
            finished_row(replace(PLANNED, inputs_sha256="cd" * 32), study, known)


def test_hashes_of_what_is_no_bag_are_empty(tmp_path: Path, study: LocalFolder) -> None:
    assert study.hashes_of("nowhere") == ("", "")
    (tmp_path / "empty").mkdir()
    assert hashes_of_bag(tmp_path / "empty") == ("", "")
    two = bag_in(tmp_path / "two")
    (two / "bag_1.mcap").touch()
    assert hashes_of_bag(two)[0] == ""
    assert hashes_of_bag(two)[1] != ""


def test_a_scratch_folder_is_gone_however_the_attempt_ends(study: LocalFolder, tmp_path: Path) -> None:
    with attempt_folder(study) as scratch:
        (scratch / "file").touch()
        assert scratch.is_relative_to(tmp_path / "study")
        with attempt_folder(study) as other:
            assert other != scratch
    assert not scratch.exists()

    def fail() -> None:
        with attempt_folder(study) as failing:
            kept.append(failing)
            raise RuntimeError

    kept: list[Path] = []
    with pytest.raises(RuntimeError):
        fail()
    assert not kept[0].exists()


KILLED = """
import os, signal, sys
from pathlib import Path
from siren_ros.running.studies.study_folder import LocalFolder
print(LocalFolder(Path(sys.argv[1])).scratch(), flush=True)
sys.stdin.read()
"""


def test_what_killed_processes_left_is_removed_and_what_is_under_way_stays(study: LocalFolder, tmp_path: Path) -> None:
    command = [sys.executable, "-c", KILLED, str(tmp_path / "study")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        theirs = Path(other.stdout.readline().strip())
        (theirs / ".bag.partial").mkdir()
        older = theirs.with_name(f"{2**22 + 1}-0123456789ab")
        older.mkdir()
        with attempt_folder(study) as ours:
            study.clear_scratch()
            assert (ours.exists(), theirs.exists(), older.exists()) == (True, True, False)
        other.kill()
    study.clear_scratch()
    assert not theirs.parent.exists()


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[1]", b"7", b"{}", b"\xff", b"[" * 100_000, b'{"status": "complete"}']
)
def test_a_damaged_row_is_none(study: LocalFolder, content: bytes) -> None:
    study.note(ROW)
    study.write(f"{ROW.path}.json", content)
    assert study.row_of(ROW.path) is None


def test_files_are_replaced_as_a_whole(study: LocalFolder, tmp_path: Path) -> None:
    assert study.read("a/b.json") is None
    study.write("a/b.json", b"one")
    study.write("a/b.json", b"two")
    assert study.read("a/b.json") == b"two"
    assert [path.name for path in (tmp_path / "study" / "a").iterdir()] == ["b.json"]


def test_a_study_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="a folder that can be written"):
        write_study(LocalFolder(tmp_path / "file"), {"seeds": 1})


def test_rows_are_read_back_and_others_refused() -> None:
    content = ROW.to_json()
    short = {key: value for key, value in content.items() if key not in {"versions", "retry_reasons", "attempts"}}
    row = EpisodeRow.from_json({**short, "unknown": 1})
    assert (row.versions, row.retry_reasons, row.attempts) == ({}, (), 1)
    for wrong in ({**content, "status": "lost"}, {key: value for key, value in content.items() if key != "template"}):
        with pytest.raises(InputError, match="a row of a study's table"):
            EpisodeRow.from_json(wrong)


ASKED = """
{group: g, template: own/S1.yaml, level: L3, seed: 5, map: maps/b.net.xml, preset: calm, sensors: roof, look: fog,
 values: a.b=12.0, inputs_sha256: i0}"""
KNOWN = """
{attempts: 3, retry_reasons: [hung, crashed], steps: 801, simulated_s: 40.05, predicate_holds: false,
 predicate: it stood, bag: episodes/g/e2, bag_bytes: 5000000000, mcap_sha256: m0, metadata_sha256: y0, map_sha256: n0,
 measures: '{"collisions": 2, "people.met": 4, "people.cyclists.near": 1, "peoples": 9.5}', site: made,
 setup_s: 1.25, run_s: 2.5, process_s: 4.75, cpu_s: 3.125, begun_at: at six, worker: h.7}"""
BARE = """
{episode: e1, draw: -1, status: crashed, reason: "", attempts: 1, retry_reasons: [], steps: 0, simulated_s: 0.0,
 predicate_holds: null, predicate: "", measures: "{}", bag: "", bag_bytes: 0, mcap_sha256: "", metadata_sha256: "",
 map_sha256: "", site: asked, setup_s: 0.0, run_s: 0.0, process_s: 0.0, cpu_s: 0.0, begun_at: "", worker: "",
 versions: "{}"}"""


def test_a_row_has_everything_of_its_episode_in_every_file(study: LocalFolder) -> None:
    asked, known = yaml.safe_load(ASKED), yaml.safe_load(KNOWN)
    request = {key: value for key, value in asked.items() if key not in {"group", "inputs_sha256"}}
    planned = PlannedEpisode("e2", "g", EpisodeRequest(**request, site="asked"), 6, "i0")
    given = known | {"retry_reasons": ("hung", "crashed"), "versions": {"b": "2", "a": "1"}}
    whole = EpisodeRow.planned(planned, Status.COMPLETE, "why", **given)
    bare = EpisodeRow.planned(replace(planned, name="e1", draw=-1), Status.CRASHED)
    told = asked | known | {"episode": "e2", "draw": 6, "status": "complete", "reason": "why"}
    assert whole.to_json() == told | {"versions": {"b": "2", "a": "1"}}
    assert EpisodeRow.from_json(whole.to_json()) == whole
    assert (whole.map_name, whole.path, whole.collisions, bare.collisions) == ("b", "episodes/g/e2", 2, 0)
    assert (whole.people, bare.people) == ({"met": 4, "cyclists.near": 1}, {})
    assert whole.shortcomings == ("the interaction did not happen", "2 collisions")
    assert read_table(study) == ()
    write_table(study, [whole, bare])
    assert read_table(study) == (bare, whole)
    content = manifest_bytes([bare, whole])
    assert content == manifest_bytes([whole, bare]) == study.read("manifest.parquet")
    table = pq.read_table(io.BytesIO(content), use_threads=False)
    assert table.to_pylist() == [asked | yaml.safe_load(BARE), told | {"versions": '{"a": "1", "b": "2"}'}]
    assert {*table.schema.names} == {field.name for field in fields(EpisodeRow)}
    with pytest.raises(InputError, match="table"):
        rows_of_manifest(b"PAR1, or not")
