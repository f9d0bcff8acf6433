"""``siren generate risk``: its options, a small set, and going on after an interruption."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from evaluation.made_video_sets import small_video_set
from processes.stand_in import processes_of

from siren_ros.cli.generate_risk import balance_of
from siren_ros.cli.main import main, parser
from siren_ros.running.studies.risk_set import make_set
from siren_ros.running.studies.risk_set.candidate import Candidate, Rendered, VideoPlace, make_video
from siren_ros.running.studies.risk_set.search import Balance
from siren_ros.scoring.evaluation.risk.labels import DEFINITIONS, RiskClass, RiskThresholds
from siren_ros.scoring.evaluation.risk.video_set import read_set, write_set
from siren_ros.scoring.evaluation.risk.vlm.pipeline import masks_of, video_frames


def asked(*words: str) -> Balance:
    return balance_of(parser().parse_args(["generate", "risk", "--out", "x", *words]))


def test_without_options_it_is_the_papers_set() -> None:
    assert asked() == Balance((74, 25, 6), 15)
    assert asked("--templates", "S4", "S6", "--per-template", "21") == Balance((30, 10, 2), 21), "of fewer, its shares"
    assert asked("--templates", "S6", "--balance", "0,0,50") == Balance((0, 0, 50), 50)
    assert asked("--balance", "126,112,63", "--within-templates") == Balance((126, 112, 63), 43, within=True)


@pytest.mark.parametrize(
    ("words", "said"),
    [(["--balance", "1,2"], "three counts"), (["--workers", "0"], "whole number"), (["--templates", "S9"], "S9")],
)
def test_words_that_mean_nothing(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["generate", "risk", "--out", "x", *words])
    assert caught.value.code == 2
    assert said in capsys.readouterr().err


def test_a_set_is_made_and_goes_on(tmp_path, siren, monkeypatch) -> None:
    """The film that is missing is made once more, and nothing else; by a stand-in, since it takes as long again."""
    words = ["generate", "risk", "--out", str(tmp_path), "--templates", "S2", "--balance", "1,0,0", "--workers", "1"]
    assert "1 / 0 / 0" in siren(words).out
    videos = read_set(tmp_path)
    ((key, video),) = videos.videos.items()
    assert video.label.risk is RiskClass.NORMAL
    first, last = video_frames(tmp_path / video.file, (0, 189), 190)
    assert first.shape == (600, 800, 3)
    assert (first != last).any()
    (mask,) = masks_of(tmp_path / "masks" / f"{key}.npz", (94,))
    assert mask.shape == (600, 800)
    contents = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    film = tmp_path / video.file
    film.write_bytes(b"")
    again = []

    def make(
        retries: int, work: object, place: VideoPlace, candidate: Candidate, thresholds: RiskThresholds
    ) -> Rendered:
        again.append((retries, work, place, candidate.request.to_json(), candidate.first_step, thresholds))
        film.write_bytes(contents[film])
        return Rendered(190, 0)

    monkeypatch.setattr(make_set, "attempt_processes", processes_of(make))
    assert main(words) == 0
    place = VideoPlace(tmp_path, key)
    assert again == [(2, make_video, place, video.request, video.first_step, DEFINITIONS["near_crash"])]
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == contents
    assert "one of the same request" in siren([*words[:-2], "--seed", "1"], 2).err
    card = json.loads(tmp_path.joinpath("dataset.json").read_text())
    assert card["counts"] == [1, 0, 0]


def test_labels_are_derived_again(tmp_path: Path, siren) -> None:
    write_set(small_video_set(tmp_path))
    out = siren(["label", str(tmp_path), "--time-to-collision-s", "0.8", "--out", str(tmp_path / "other")]).out
    assert "S4_002: Near-Miss -> Normal" in out
    assert "S6_005" not in out, "touching is a collision whatever the thresholds"
    assert out.splitlines()[-1].startswith("5 / 0 / 1")
    other = read_set(tmp_path / "other")
    assert other.thresholds.time_to_collision_s == 0.8
    assert other.videos["S6_005"].file == "../videos/S6_005.mp4"
    assert main(["label", str(tmp_path), "--time-to-collision-s", "-1"]) == 2
    siren(["label", str(tmp_path), "--near-miss", "near_crash", "--gap-m", "7", "--out", str(tmp_path / "third")])
    assert read_set(tmp_path / "third").thresholds == replace(DEFINITIONS["near_crash"], gap_m=7.0)


def test_the_table_of_thresholds_changes_nothing(tmp_path: Path, siren) -> None:
    write_set(small_video_set(tmp_path))
    before = (tmp_path / "videos.json").read_bytes()
    lines = siren(["label", str(tmp_path), "--table"]).out.splitlines()
    (row,) = [line.split() for line in lines if line.startswith("time_to_collision_s") and " 0.75 " in line]
    assert row[1:] == ["0.75", "5", "0", "1", "2"]
    assert (tmp_path / "videos.json").read_bytes() == before
