import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from datasets.made_bag import BagSpec, write_made_bag
from made_video_sets import small_video_set

from siren_ros.cli.leaderboard import submissions_in
from siren_ros.cli.main import main
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.leaderboard import standings, table_of
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.risk.scoring import balanced_accuracy, correct_by_class, score_answers
from siren_ros.scoring.evaluation.risk.video_set import write_set
from siren_ros.scoring.evaluation.statistics import BlockSums


def sums(values):
    values = np.array(values, dtype=float)
    return BlockSums(values, np.ones(len(values)), np.zeros(len(values), dtype=np.intp))


BASE = np.linspace(1.0, 2.0, 10)


def test_the_best_comes_first():
    given = {"b": sums(BASE + 0.5), "a": sums(BASE), "c": sums(BASE + 1.0)}
    assert [row.name for row in standings(given, less_is_better=True)] == ["a", "b", "c"]
    assert [row.name for row in standings(given, less_is_better=False)] == ["c", "b", "a"]
    assert standings({}, less_is_better=True) == ()


def test_a_clear_difference_is_found_and_none_is_not():
    """Ten blocks that all differ one way: 2 of 1024 exchanges are as far; alternating signs: half of them."""
    rows = standings(
        {"best": sums(BASE), "worse": sums(BASE + 0.5), "same": sums(BASE + 1e-3 + np.tile([0.1, -0.1], 5))},
        less_is_better=True,
    )
    assert [row.name for row in rows] == ["best", "same", "worse"]
    assert rows[0].to_best is None
    assert rows[2].to_best.p_value == pytest.approx(2 / 1024)
    assert rows[2].p_adjusted == pytest.approx(4 / 1024)
    assert rows[2].to_best.difference.value == pytest.approx(0.5)
    assert rows[1].p_adjusted > 0.5


def test_other_blocks_are_refused():
    with pytest.raises(InputError, match="same samples"):
        standings({"a": sums(BASE), "b": sums(BASE[:-1])}, less_is_better=True)


def test_the_table_names_every_row():
    table = table_of(standings({"a": sums(BASE), "b": sums(BASE + 1.0)}, less_is_better=True), "error", "episodes")
    assert [row[:2] for row in table.rows] == [("1", "a"), ("2", "b")]
    assert any("1.500" in line for line in table.text())


def test_sums_by_class_have_the_balanced_accuracy_as_their_mean(tmp_path):
    videos = small_video_set(tmp_path)
    labels = {key: video.label.risk for key, video in videos.videos.items()}
    answers = {key: risk if number % 2 else None for number, (key, risk) in enumerate(sorted(labels.items()))}
    wanted = balanced_accuracy(score_answers("x", videos, answers).overall).value
    assert correct_by_class(videos, answers).value() == pytest.approx(wanted)


def test_the_command_ranks_files_of_answers(tmp_path, capsys):
    videos = small_video_set(tmp_path / "set")
    (tmp_path / "set").mkdir()
    write_set(videos)
    folder = tmp_path / "submitted"
    folder.mkdir()
    truth = {key: video.label.risk.title for key, video in videos.videos.items()}
    (folder / "knows.json").write_text(json.dumps(truth))
    rows = "\n".join(f"{key},Normal" for key in truth)
    (folder / "guesses.csv").write_text(f"video,class\n{rows}\n")
    (folder / "notes.txt").write_text("no submission")
    out = tmp_path / "board.json"
    assert main(["leaderboard", "risk", str(folder), str(tmp_path / "set"), "--out", str(out)]) == 0
    assert "knows" in capsys.readouterr().out
    board = json.loads(out.read_text())["standings"]
    assert [(row["name"], row["value"]["value"]) for row in board] == [
        ("knows", 1.0),
        ("guesses", pytest.approx(1 / 3)),
    ]
    (folder / "knows.csv").write_text("video,class\n")
    with pytest.raises(InputError, match="each name once"):
        submissions_in(folder, (".json", ".csv"))
    with pytest.raises(InputError, match="a folder with submissions"):
        submissions_in(folder, (".parquet",))


def test_the_command_ranks_predictions(tmp_path, typestore):
    """Two submissions to a drive: the truth, and the truth one metre to the left."""
    bag = write_made_bag(tmp_path / "S2_drive", typestore, BagSpec(steps=262, sensed=False))
    samples = samples_of(read_episode(bag), HistoryWindow(), Population.REGION)
    folder = tmp_path / "submitted"
    folder.mkdir()
    for name, shift in (("far", 1.0), ("near", 0.0)):
        xy = samples.future_xy_m + np.array([0.0, shift])
        columns = {
            "episode": ["S2_drive"] * len(samples),
            "actor": samples.batch.actor_id,
            "step": samples.batch.sample_step,
            "mode": np.zeros(len(samples), dtype=np.int64),
            "probability": np.ones(len(samples)),
            "x": list(xy[..., 0]),
            "y": list(xy[..., 1]),
        }
        pq.write_table(pa.table(columns), folder / f"{name}.parquet")
    out = tmp_path / "board.json"
    assert main(["leaderboard", "prediction", str(folder), str(bag), "--out", str(out), "--workers", "1"]) == 0
    board = json.loads(out.read_text())["standings"]
    assert [row["name"] for row in board] == ["near", "far"]
    assert [row["value"]["value"] for row in board] == pytest.approx([0.0, 1.0], abs=1e-9)


def test_the_command_ranks_detections(tmp_path, typestore):
    """Nothing found, in two formats; what is wrong with a file is said."""
    bag = write_made_bag(tmp_path / "S2_drive", typestore, BagSpec())
    folder = tmp_path / "submitted"
    (folder / "nothing").mkdir(parents=True)
    for number in range(19):
        (folder / "nothing" / f"{number:06d}.txt").write_text("")
    out = tmp_path / "board.json"
    assert main(["leaderboard", "detection", str(folder), str(bag), "--out", str(out), "--workers", "1"]) == 0
    board = json.loads(out.read_text())["standings"]
    assert [(row["name"], row["value"]["value"]) for row in board] == [("nothing", 0.0)]
