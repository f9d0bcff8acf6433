"""Rows of scores as files and data frames, how they are found, and the order of submissions."""

import json
from dataclasses import replace
from itertools import product

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from datasets.made_bag import BagSpec, write_made_bag
from made_video_sets import small_video_set
from scipy import stats

from siren_ros.base.tables import NOTHING, Interval
from siren_ros.cli.leaderboard import submissions_in
from siren_ros.cli.main import main
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.risk.scoring import balanced_accuracy, correct_by_class, score_answers
from siren_ros.scoring.evaluation.risk.video_set import write_set
from siren_ros.scoring.evaluation.scores import Score, Scores, csv_of, leaderboard, standings
from siren_ros.scoring.evaluation.statistics import BlockSums
from siren_ros.simulation.scenario.episode import EpisodeIdentity, split_of

SURE = Interval(2.0, 1.0, 3.0, 6)
VALUES = (
    Score("cv", "all", "all", "ade_m", SURE, 12),
    Score("cv", "template", "S1", "ade_m", Interval(1.5, 1.5, 1.5, 2), 5),
    Score("idm", "template", "S1", "fde_m", NOTHING, 0),
)


def test_values_have_the_same_columns_in_each_task():
    assert csv_of(VALUES).splitlines() == [
        "model,kind,group,metric,value,low,high,episodes,samples",
        "cv,all,all,ade_m,2.0,1.0,3.0,6,12",
        "cv,template,S1,ade_m,1.5,,,2,5",
        "idm,template,S1,fde_m,,,,0,0",
    ]
    assert csv_of([]) == "model,kind,group,metric,value,low,high,episodes,samples\n"
    row = Score("L1", "template", "S1", "emv_delay_s", SURE, 6, "L0", p_value=0.02, p_adjusted=0.04, cut_off=1)
    head, line = csv_of([row], differences=True).splitlines()
    assert head == "model,kind,group,metric,value,low,high,episodes,samples,against,p,p_holm,cut_off"
    assert line == "L1,template,S1,emv_delay_s,2.0,1.0,3.0,6,6,L0,0.02,0.04,1"


def test_rows_are_found_by_what_they_are_of():
    scores = Scores.of_json(json.loads(json.dumps({"rows": [row.json() for row in VALUES]})))
    assert scores.models == ("cv", "idm")
    assert scores.groups() == (("all", "all"), ("template", "S1"))
    assert scores.groups("template", "level") == (("template", "S1"),)
    assert scores.interval("cv", "all", "all", "ade_m") == SURE
    assert scores.value("cv", "template", "S1", "ade_m") == 1.5
    assert not scores.interval("cv", "template", "S1", "ade_m").bounded
    assert scores.value("idm", "template", "S1", "fde_m") is None
    assert scores.value("idm", "all", "all", "ade_m") is None
    assert scores.interval("idm", "all", "all", "ade_m") == NOTHING


def sums(values):
    values = np.array(values, dtype=float)
    return BlockSums(values, np.ones(len(values)), np.zeros(len(values), dtype=np.intp))


BASE = np.linspace(1.0, 2.0, 10)


def test_five_submissions_are_ranked_by_what_they_are_worth():
    """Means 1.5, 1.5, 1.75, 2.5 and 2.5: ties keep the order of the names, whichever way is better."""
    given = {
        "e": sums(BASE[::-1] + 1.0),
        "d": sums(BASE + 1.0),
        "b": sums(BASE),
        "c": sums(BASE + 0.25),
        "a": sums(BASE),
    }
    rows = standings(given, "error", less_is_better=True)
    assert [row.model for row in rows][:5] == ["a", "b", "c", "d", "e"]
    assert [row.value for row in rows][:5] == pytest.approx([1.5, 1.5, 1.75, 2.5, 2.5])
    others = standings(given, "score", less_is_better=False)
    assert [row.model for row in others][:5] == ["d", "e", "c", "a", "b"]
    assert standings({}, "error", less_is_better=True) == ()


@pytest.mark.parametrize("other", [sums(BASE[:-1]), replace(sums(0.0 * BASE), count=0.0 * BASE)], ids=["fewer", "none"])
def test_other_blocks_are_refused(other):
    with pytest.raises(InputError, match="same samples"):
        standings({"a": sums(BASE), "b": other}, "error", less_is_better=True)


def test_standings_and_their_table_are_what_students_t_and_all_exchanges_of_signs_say():
    """Three submissions of six blocks, all different; b is near a, c is far from both."""
    a, near = np.array([1.0, 2.0, 4.0, 5.0, 8.0, 10.0]), np.array([0.5, -0.1, 1.0, 0.75, -0.25, 0.2])
    given = {"c": a + np.array([3.0, 4.0, 3.5, 4.5, 2.0, 2.5]), "a": a, "b": a + near}

    def row(model, values, against="", p_values=(1.0, 1.0)):
        mean, half = values.mean(), stats.t.ppf(0.975, 5) * values.std(ddof=1) / np.sqrt(6.0)
        bounds = [pytest.approx(number) for number in (mean, mean - half, mean + half)]
        return (model, "all", "all", "error", *bounds, 6, 6, against, *map(pytest.approx, p_values))

    def p_value(values):
        means = [abs((values * signs).mean()) for signs in product((1.0, -1.0), repeat=6)]
        return np.mean(np.array(means) >= abs(values.mean()) - 1e-12)

    for less_is_better, (best, second, last) in ((True, "abc"), (False, "cba")):
        rows = standings({name: sums(values) for name, values in given.items()}, "error", less_is_better=less_is_better)
        apart = [given[name] - given[best] for name in (second, last)]
        p_values = [p_value(values) for values in apart]
        assert p_values[0] > p_values[1] if less_is_better else p_values == [2.0 / 64.0] * 2
        holm = [max(2.0 * p_values[1], p_values[0]), 2.0 * p_values[1]]
        expected = [row(name, given[name]) for name in (best, second, last)]
        expected += [
            row(name, values, best, (p, adjusted))
            for name, values, p, adjusted in zip((second, last), apart, p_values, holm, strict=True)
        ]
        got = [
            (
                r.model,
                r.kind,
                r.group,
                r.metric,
                r.interval.value,
                r.interval.low,
                r.interval.high,
                r.interval.blocks,
                r.samples,
                r.against,
                r.p_value,
                r.p_adjusted,
            )
            for r in rows
        ]
        assert got == expected
        table = leaderboard(rows, "films")
        assert table.head == ("rank", "submission", "error", "films", "difference", "p")
        assert table.caption.startswith("error; differences to the best with 95 % intervals, p of exchanged films")
        assert table.rows == (
            ("1", best, rows[0].interval, 6, None, None),
            ("2", second, rows[1].interval, 6, rows[3].interval, rows[3].p_adjusted),
            ("3", last, rows[2].interval, 6, rows[4].interval, rows[4].p_adjusted),
        )


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
    board = json.loads(out.read_text())["rows"]
    assert [(row["model"], row["value"]) for row in board] == [("knows", 1.0), ("guesses", pytest.approx(1 / 3))]
    (folder / "knows.csv").write_text("video,class\n")
    with pytest.raises(InputError, match="each name once"):
        submissions_in(folder, (".json", ".csv"))
    with pytest.raises(InputError, match="a folder with submissions"):
        submissions_in(folder, (".parquet",))


def test_the_command_ranks_predictions_and_names_those_that_cannot_be_scored(tmp_path, typestore, capsys):
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
    board = json.loads(out.read_text())
    assert [row["model"] for row in board["rows"]] == ["near", "far"]
    assert [row["value"] for row in board["rows"]] == pytest.approx([0.0, 1.0], abs=1e-9)
    (episode,) = board["scored_on"]
    assert (episode["bag"], episode["template"], episode["seed"]) == ("S2_drive", "S2", 0)
    assert episode["split"] == split_of(EpisodeIdentity.of(read_episode(bag).description)).value
    whole = {name: len(digest) for name, digest in {**board["submissions"], "bag": episode["sha256"]}.items()}
    assert whole == {"far": 64, "near": 64, "bag": 64}

    far = pq.read_table(folder / "far.parquet")
    pq.write_table(far.slice(1), folder / "lacks.parquet")
    pq.write_table(far.set_column(6, "y", [[[float("nan")] * len(xy[0])] * len(samples)]), folder / "nan.parquet")
    (folder / "torn.parquet").write_bytes(b"PAR1")
    huge = [[1e200] * len(xy[0])] * len(samples)
    pq.write_table(far.set_column(6, "y", [huge]), folder / "huge.parquet")
    capsys.readouterr()
    assert main(["leaderboard", "prediction", str(folder), str(bag), "--out", str(out), "--workers", "1"]) == 1
    printed = capsys.readouterr()
    board = json.loads(out.read_text())
    assert set(board["refused"]) == {"huge", "lacks", "nan", "torn"}
    assert all(f"{name} is not ranked" in printed.err for name in board["refused"])
    assert "0" * 20 not in printed.err


def test_the_command_ranks_detections(tmp_path, typestore):
    bag = write_made_bag(tmp_path / "S2_drive", typestore, BagSpec())
    nothing = tmp_path / "submitted/nothing"
    nothing.mkdir(parents=True)
    for number in range(19):
        (nothing / f"{number:06d}.txt").write_text("")
    out = tmp_path / "board.json"
    words = "leaderboard", "detection", str(nothing.parent), str(bag), "--out", str(out), "--workers", "1"
    assert main([*words]) == 0
    board = json.loads(out.read_text())["rows"]
    assert [(row["model"], row["value"]) for row in board] == [("nothing", 0.0)]
