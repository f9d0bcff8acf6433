"""Answers, references, controls and severities, and their scores."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.made_records import Track, moving, record_with
from scipy import stats

from siren_ros.base.tables import Table
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk import sequence_model as controls_module
from siren_ros.scoring.evaluation.risk.labels import (
    DEFINITIONS,
    Camera,
    Evidence,
    Moments,
    RiskClass,
    RiskThresholds,
    SeenEncroachment,
    evidence_of,
    label_of,
)
from siren_ros.scoring.evaluation.risk.report import (
    PAPER_BALANCE,
    PAPER_SCORES,
    scores_as_json,
    table_of_changes,
    table_of_severity,
    tables_of,
)
from siren_ros.scoring.evaluation.risk.scoring import (
    SCORES,
    ModelScores,
    Severity,
    accuracy,
    balanced_accuracy,
    checked_answers,
    confusion,
    f1,
    macro_f1,
    majority,
    oracle,
    precision,
    read_answers,
    read_severities,
    recall,
    score_answers,
    score_severities,
    severities_of,
    severity_of,
    template_means,
)
from siren_ros.scoring.evaluation.risk.sequence_model import CHANGES, Control, load_sequence_model, sequence_answers
from siren_ros.scoring.evaluation.risk.video_set import VideoSet, changes_of_labels
from siren_ros.scoring.evaluation.risk.vlm.pipeline import questions_about
from siren_ros.sensing.specification import Mount

NORMAL, NEAR_MISS, COLLISION = RiskClass


def test_counts_are_label_by_answer_and_an_unreadable_one_is_wrong_and_of_no_class() -> None:
    counts = confusion([NORMAL, NORMAL, NEAR_MISS, COLLISION], [NORMAL, COLLISION, None, NEAR_MISS])
    assert counts.tolist() == [[1, 0, 1, 0], [0, 0, 0, 1], [0, 1, 0, 0]]
    with_none = confusion([NORMAL, NORMAL], [NORMAL, None])
    shares = accuracy(with_none), recall(with_none, NORMAL), precision(with_none, NORMAL)
    assert [share.value for share in shares] == [0.5, 0.5, 1.0]


def test_closed_forms() -> None:
    counts = np.array([[6, 2, 0, 2], [1, 3, 1, 0], [0, 1, 4, 0]])
    assert accuracy(counts).value == pytest.approx(13 / 20)
    assert precision(counts, NORMAL).value == pytest.approx(6 / 7)
    assert recall(counts, NORMAL).value == pytest.approx(6 / 10)
    assert precision(counts, NEAR_MISS).value == pytest.approx(3 / 6)
    assert recall(counts, NEAR_MISS).value == pytest.approx(3 / 5)
    assert f1(counts, COLLISION).value == pytest.approx(2 * 4 / (5 + 5))
    assert balanced_accuracy(counts).value == pytest.approx((0.6 + 0.6 + 0.8) / 3)
    assert macro_f1(counts).value == pytest.approx((12 / 17 + 6 / 11 + 8 / 10) / 3)


def test_what_divides_by_nothing_is_not_valid() -> None:
    counts = confusion([NORMAL, NEAR_MISS], [NORMAL, NORMAL])
    assert not precision(counts, COLLISION).valid
    assert not recall(counts, COLLISION).valid
    assert not precision(counts, NEAR_MISS).valid
    assert recall(counts, NEAR_MISS).valid
    assert not any(score(np.zeros((3, 4), dtype=np.int64)).valid for score in SCORES.values())


@pytest.mark.parametrize(
    ("model", "counts"),
    [
        ("MiniCPM-V-4.5-8B", [[49, 0, 25], [5, 0, 20], [3, 0, 3]]),
        ("Qwen3.5-9B", [[74, 0, 0], [25, 0, 0], [6, 0, 0]]),
        ("Gemma3-12B", [[9, 55, 10], [1, 19, 5], [0, 6, 0]]),
        ("LLaVA-Llama3-8B", [[0, 74, 0], [0, 24, 1], [0, 6, 0]]),
        ("Blaifa-InternVL3.5-8B", [[32, 41, 1], [5, 18, 2], [1, 5, 0]]),
    ],
)
def test_the_papers_table_from_counts(model: str, counts: list[list[int]]) -> None:
    """The paper's numbers give the right answers and the answers of each class, not how the wrong ones are spread."""
    matrix = np.concatenate((counts, np.zeros((3, 1), dtype=np.int64)), axis=1)
    assert tuple(matrix.sum(axis=1)) == PAPER_BALANCE
    for name, value in PAPER_SCORES[model].items():
        assert 100.0 * SCORES[name](matrix).value == pytest.approx(100.0 * value, abs=0.005), name


def test_references(small_set: VideoSet) -> None:
    most, best = (score_answers("x", small_set, answers(small_set)) for answers in (majority, oracle))
    assert most.scores["accuracy"].value == 0.5
    assert most.scores["balanced_accuracy"].value == pytest.approx(1 / 3)
    assert not most.scores["precision_collision"].valid
    assert best.scores["accuracy"].value == best.scores["macro_f1"].value == 1.0
    assert (best.scores["accuracy"].low, best.scores["accuracy"].high) == pytest.approx((0.6097, 1.0), abs=1e-4)
    assert 0.0 <= most.scores["accuracy"].low < 0.5 < most.scores["accuracy"].high <= 1.0
    one_of_each = {key: video for key, video in small_set.videos.items() if video.template == "S6"}
    assert set(majority(replace(small_set, videos=one_of_each)).values()) == {NORMAL}, "the least severe of equal ones"


def test_only_answered_videos_count(small_set: VideoSet) -> None:
    found = score_answers("x", small_set, {"S4_000": RiskClass.NORMAL, "S6_005": None})
    assert (found.answered, found.videos) == (2, 6)
    assert found.scores["accuracy"].value == 0.5
    assert found.by_template["S4"].tolist() == [[1, 0, 0, 0], [0] * 4, [0] * 4]
    assert found.by_template["S6"][RiskClass.COLLISION].tolist() == [0, 0, 0, 1]
    assert (found.by_template["S4"] + found.by_template["S6"] == found.overall).all()


FIRST = np.array([[6, 2, 0, 0], [1, 3, 0, 1], [0, 0, 0, 0]])
SECOND = np.array([[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 4, 0]])


def scores(name: str, first: np.ndarray = FIRST, second: np.ndarray = SECOND) -> ModelScores:
    """Of S1 and S6."""
    return ModelScores(name, 24, int((first + second).sum()), first + second, {"S1": first, "S6": second})


def tables(*models: ModelScores, compare_paper: bool = False) -> dict[str, Table]:
    return {table.key: table for table in tables_of(scores_as_json(models), compare_paper=compare_paper)}


def test_scores_in_percent_and_the_papers_below_them() -> None:
    """Of 20 videos 16 are right. Recalls 8/10, 4/6, 4/4; precisions 8/9, 4/6, 4/4; F1 16/19, 8/12, 1."""
    found = tables(scores("m"), compare_paper=True)
    overall, of_classes = ({row[0]: row[1:] for row in found[key].cells()} for key in ("scores", "classes"))
    assert overall["m"][:2] == ("20/24", "80.00 [58.40, 91.93]")
    assert [cell.split()[0] for cell in overall["m"][2:]] == ["82.22", "83.63"]
    in_percent = "88.89 80.00 84.21 66.67 66.67 66.67 100.00 100.00 100.00"
    assert [cell.split()[0] for cell in of_classes["m"]] == in_percent.split()
    assert [place for place, cell in enumerate(of_classes["m"]) if "[" in cell] == [2, 5, 8], "intervals of F1"
    assert overall["Qwen3.5-9B (paper)"] == ("105", "70.48", "–", "–")
    assert of_classes["Qwen3.5-9B (paper)"] == ("70.48", "–", "82.68", "0.00", "–", "0.00", "0.00", "–", "0.00")
    assert len(overall) == len(of_classes) == 1 + len(PAPER_SCORES)
    few = tables(scores("m", np.zeros_like(FIRST), np.diag([2, 1, 1, 0])[:3]))["scores"]
    assert few.cells()[0][2] == "100.00 [–]", "four videos"
    assert few.has_unbounded


def test_rows_are_of_the_whole_set_and_of_its_templates() -> None:
    rows = {(row.kind, row.group, row.metric): row for row in scores("m").rows}
    assert list(rows) == [
        (kind, group, score)
        for kind, group in (("all", "all"), ("template", "S1"), ("template", "S6"))
        for score in SCORES
    ]
    accuracy = rows["all", "all", "accuracy"]
    assert (accuracy.model, accuracy.samples, accuracy.interval.blocks) == ("m", 20, 20)
    assert (accuracy.value, accuracy.interval.low, accuracy.interval.high) == pytest.approx(
        (0.8, 0.583983, 0.919342), abs=1e-6
    )
    assert (rows["template", "S1", "accuracy"].value, rows["template", "S1", "accuracy"].samples) == (9 / 13, 13)
    assert rows["template", "S1", "recall_collision"].value is None, "there are none"
    assert rows["template", "S6", "precision_collision"].value == 1.0


def test_json_and_confusion_matrices() -> None:
    found = scores_as_json([scores("m")])
    assert (found["task"], found["classes"]) == ("risk", ["Normal", "Near-Miss", "Collision"])
    assert found["rows"] == [row.json() for row in scores("m").rows]
    by_template = {"S1": FIRST.tolist(), "S6": SECOND.tolist()}
    expected = {"videos": 24, "answered": 20, "confusion": (FIRST + SECOND).tolist()}
    assert found["models"]["m"] == {**expected, "confusion_by_template": by_template}
    shown = tables(scores("m"), scores("oracle"))
    overall, by_template = shown["confusion"].cells(), shown["confusion_by_template"].cells()
    assert overall[:2] == [("m", "Normal", "8", "2", "0", "0"), ("m", "Near-Miss", "1", "4", "0", "1")]
    assert [by_template[row] for row in (0, 3)] == [
        ("m", "S1", "Normal", "6", "2", "0", "0"),
        ("m", "S6", "Normal", "2", "0", "0", "0"),
    ]
    assert len(overall) == len(by_template) == 6, "by template not of the oracle"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", '{"S1_000": "Normal", "S1_001": "near-miss", "S1_002": "unreadable"}'),
        ("a.csv", "class,video\nNormal,S1_000\nNear-Miss,S1_001\nunreadable,S1_002\n"),
    ],
)
def test_both_formats(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    assert read_answers(path) == {"S1_000": RiskClass.NORMAL, "S1_001": RiskClass.NEAR_MISS, "S1_002": None}


@pytest.mark.parametrize(
    ("name", "text", "named"),
    [
        ("a.json", '{"S1_000": "Crash"}', "Crash"),
        ("a.json", '{"S1_000": "Normal", "S1_000": "Normal"}', "S1_000"),
        ("a.json", '["Normal"]', "video and class"),
        ("a.json", '{"S1_000": 1}', "video and class"),
        ("a.json", "{", "video and class"),
        ("a.json", '{"S1_000": [1]}', "video and class"),
        ("a.csv", f"video,class\n{'x' * 200_000},Normal\n", "field limit"),
        ("a.csv", "id,label\nS1_000,Normal\n", "columns"),
        ("a.csv", "video,class\nS1_000\n", "S1_000"),
    ],
)
def test_what_is_refused(tmp_path: Path, name: str, text: str, named: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=named):
        read_answers(path)
    with pytest.raises(InputError, match="No such file"):
        read_answers(tmp_path / "none.json")


def test_answers_belong_to_the_set() -> None:
    answers = {"b": RiskClass.NORMAL}
    assert checked_answers(answers, ["b"], allow_missing=False) == answers
    with pytest.raises(InputError, match="2 unknown videos, first c"):
        checked_answers({**answers, "d": None, "c": None}, ["b"], allow_missing=True)
    with pytest.raises(InputError, match="2 videos without an answer, first a"):
        checked_answers(answers, ["c", "b", "a"], allow_missing=False)
    assert checked_answers(answers, ["c", "b", "a"], allow_missing=True) == answers


PICTURES = [np.full((4, 6, 3), value, dtype=np.uint8) for value in range(9)]


def shown(control, key="S4_000"):
    return [int(picture[0, 0, 0]) for picture in CHANGES[control](PICTURES, key)]


def test_what_is_taken_away():
    assert shown(Control.BLANK) == [128] * 9
    assert shown(Control.ONE_FRAME) == [4] * 9
    assert sorted(shown(Control.SHUFFLED)) == list(range(9)) != shown(Control.SHUFFLED)
    assert shown(Control.SHUFFLED) == shown(Control.SHUFFLED)
    assert shown(Control.SHUFFLED) != shown(Control.SHUFFLED, "S4_001")
    assert Control.TEXT_ONLY not in CHANGES


def test_questions_keep_their_text(drawn):
    video = drawn.videos["S4_002"]

    def asked(control):
        return questions_about(drawn.folder, video, marked=False, control=control)

    plain = asked(None)
    for control in (Control.BLANK, Control.SHUFFLED):
        changed = asked(control)
        assert [one.text for one in changed] == [one.text for one in plain]
        assert [len(one.pictures) for one in changed] == [8, 1]
    assert asked(Control.BLANK)[0].pictures != plain[0].pictures
    (single,) = asked(Control.ONE_FRAME)
    assert single.pictures == (plain[0].pictures[4],)
    assert "9.4 s" in single.text
    (dense,) = questions_about(drawn.folder, video, marked=True, control=Control.DENSE)
    assert len(dense.pictures) == 95
    assert "outlined" not in dense.text
    assert [(one.text, one.pictures) for one in asked(Control.TEXT_ONLY)] == [(one.text, ()) for one in plain]


@dataclass
class _Brightest:
    """Answers by the mean of all pictures, and notes the order of what it saw."""

    seen: list = field(default_factory=list)

    def answer(self, frames):
        self.seen.append(frames.copy())
        return int(frames.mean() > 100)


def test_the_sequence_model_sees_the_changed_films_and_reads_each_once(drawn, monkeypatch):
    read, opened = controls_module.read_small_frames, []
    monkeypatch.setattr(
        controls_module, "read_small_frames", lambda path, *rest: opened.append(path) or read(path, *rest)
    )
    model = _Brightest()
    answers = sequence_answers(drawn, model, [Control.BLANK, Control.ONE_FRAME])
    assert {control: set(given) for control, given in answers.items()} == {key: set(drawn.videos) for key in answers}
    assert len(opened) == len(set(opened)) == len(drawn.videos)
    assert {film.shape for film in model.seen} == {(95, 60, 160)}
    assert all((film == film[0]).all() for film in model.seen)
    assert sum(bool((film == 128).all()) for film in model.seen) == len(drawn.videos)
    assert len({*sequence_answers(drawn, load_sequence_model(), [Control.BLANK])[Control.BLANK].values()}) == 1
    assert sequence_answers(drawn, model, []) == {}


def test_numbers_of_a_video(small_set):
    """Slow closing does not count."""
    kinds = {key: severity_of(video.evidence, RiskThresholds()) for key, video in small_set.videos.items()}
    assert kinds["S4_000"] == Severity(3.0, 0.0)
    assert kinds["S4_002"] == Severity(pytest.approx(0.9), 0.0)
    assert kinds["S6_005"] == Severity(0.0, 3.5)
    moments = small_set.videos["S4_002"].evidence.moments
    slow = replace(moments, closing_mps=np.full(len(moments), 0.5))
    assert severity_of(Evidence(slow, (), ()), RiskThresholds()).least_ttc_s == 3.0


def test_the_truth_has_no_error_and_a_constant_has_no_rank(small_set):
    scores = score_severities(small_set, severities_of(small_set))
    assert (scores["least_ttc_s"][0].value, scores["least_ttc_s"][1]) == (0.0, pytest.approx(1.0))
    assert scores["contact_mps"][0].blocks == 1
    constant = dict.fromkeys(small_set.videos, Severity(1.0, 0.0))
    scores = score_severities(small_set, constant)
    truth = [value.least_ttc_s for value in severities_of(small_set).values()]
    errors, found = np.abs(np.array(truth) - 1.0), scores["least_ttc_s"][0]
    half = stats.t.ppf(0.975, 5) * np.std(errors, ddof=1) / np.sqrt(6.0)
    assert [found.value, found.low, found.high] == pytest.approx(errors.mean() + np.array([0.0, -half, half]))
    assert scores["least_ttc_s"][1] is None
    assert scores["contact_mps"][0].value == 3.5


def test_the_template_tells_its_mean(small_set):
    truth, means = severities_of(small_set), template_means(small_set)
    of_s4 = [truth[key].least_ttc_s for key in ("S4_000", "S4_001", "S4_002")]
    assert means["S4_001"].least_ttc_s == pytest.approx(np.mean(of_s4))
    assert means["S6_003"].contact_mps == pytest.approx(3.5 / 3.0)
    assert table_of_severity(small_set, {"x": truth}).rows[0][0] == "template_prior"


@pytest.mark.parametrize(
    ("name", "text", "found"),
    [
        ("a.json", '{"a": {"class": "Normal", "least_ttc_s": 1.5, "contact_mps": 0.0}}', {"a": Severity(1.5, 0.0)}),
        ("a.csv", "video,class,least_ttc_s,contact_mps\na,Normal,1.5,0\n", {"a": Severity(1.5, 0.0)}),
        ("a.json", '{"a": "Normal"}', {}),
        ("a.csv", "video,class\na,Normal\n", {}),
        ("a.json", '{"a": {"least_ttc_s": NaN, "contact_mps": 0}}', "finite"),
        ("a.csv", "video,least_ttc_s,contact_mps\nb,nan,0\n", "finite"),
        ("a.json", '{"a": {"least_ttc_s": 1}}', "numbers"),
        ("a.csv", "video,least_ttc_s,contact_mps\nb,x,0\n", "numbers"),
    ],
)
def test_guesses_are_read_from_both_formats(tmp_path, name, text, found):
    path = tmp_path / name
    path.write_text(text)
    if isinstance(found, dict):
        assert read_severities(path) == found
    else:
        with pytest.raises(InputError, match=found):
            read_severities(path)


def test_labels_change_with_their_thresholds(small_set):
    """Two near-misses by a TTC of 0.9 to 1.2 s, DRAC 3 m/s²: half of 1.5 s makes them normal."""
    rows = {(row.name, row.value): row for row in changes_of_labels(small_set)}
    now = rows["as they are", 1.0]
    assert (now.counts, now.changed) == ((3, 2, 1), 0)
    half = rows["time_to_collision_s", 0.75]
    assert (half.counts, half.changed) == ((5, 0, 1), 2)
    assert rows["gap_m", 15.0].changed == 0
    assert {row.counts[RiskClass.COLLISION] for row in rows.values()} == {1}
    assert any("as they are" in line for line in table_of_changes(small_set).text())


NOTHING = Moments(*(np.zeros(0) for _ in range(7)))
CAMERA = Camera(Mount(2.0, 0.0, 1.5), 1.75)
EMV, CAR = 1, 5


@pytest.mark.parametrize(
    ("time_s", "braked", "needed", "near"),
    [
        (0.6, 0.0, 0.0, False),
        (0.6, 3.39, 8.44, False),
        (0.6, 3.4, 0.0, True),
        (0.6, 0.0, 8.45, True),
        (1.0, 9.0, 9.0, False),
        (0.6, None, None, True),
    ],
)
def test_a_controlled_passing_is_normal(time_s, braked, needed, near):
    evidence = Evidence(NOTHING, (SeenEncroachment(5, 50, time_s, braked, needed),), ())
    label = label_of(evidence, DEFINITIONS["near_crash"])
    assert label.risk is (RiskClass.NEAR_MISS if near else RiskClass.NORMAL)
    assert label_of(evidence, DEFINITIONS["paper"]).risk is (RiskClass.NEAR_MISS if time_s < 1.0 else RiskClass.NORMAL)


def crossing(emv_mps, car_mps, later_s, accel_mps2=0.0, road=None):
    """The EMV drives along x through the origin at 3 s and the car along y so many seconds before it."""
    tracks = {
        EMV: moving(-3.0 * emv_mps, 0.0, emv_mps, accel_mps2=accel_mps2, steps=121, is_emv=True),
        CAR: moving(0.0, -(3.0 - later_s) * car_mps, car_mps, yaw_rad=np.pi / 2, steps=121),
    }
    return evidence_of(record_with(tracks, road), EMV, CAMERA, (0, 121)).encroachments


@pytest.mark.parametrize("emv_mps", [4.0, 8.0, 16.0])
def test_the_needed_braking_at_constant_speed_is_half_the_speed_by_the_pet(emv_mps, straight_road):
    (found,) = crossing(emv_mps, 8.0, 1.6, road=straight_road)
    assert found.time_s > 0.1
    assert found.needed_mps2 == pytest.approx(emv_mps / (2.0 * found.time_s))
    assert found.braked_mps2 == 0.0


def test_the_hardest_braking_of_both_counts(straight_road):
    (found,) = crossing(12.0, 8.0, 1.6, accel_mps2=-2.0, road=straight_road)
    assert found.braked_mps2 == pytest.approx(2.0)
    (gaining,) = crossing(8.0, 8.0, 1.6, accel_mps2=1.0, road=straight_road)
    assert gaining.braked_mps2 == 0.0


@pytest.mark.parametrize(("braked", "near"), [(0.0, False), (3.39, False), (3.4, True), (np.nan, True)])
@pytest.mark.parametrize("measures", [(1.0, 8.0, 2.0, 15.0), (2.0, 8.0, 5.0, 8.0)], ids=["TTC", "DRAC"])
def test_a_course_that_nobody_has_to_leave_is_normal(braked, near, measures):
    columns = (np.full(6, value) for value in (*measures, braked))
    evidence = Evidence(Moments(np.arange(6), np.full(6, CAR), *columns), (), ())
    label = label_of(evidence, DEFINITIONS["near_crash"])
    assert label.risk is (RiskClass.NEAR_MISS if near else RiskClass.NORMAL)
    assert label_of(evidence, DEFINITIONS["paper"]).risk is RiskClass.NEAR_MISS


@pytest.mark.parametrize("driver", [EMV, CAR])
@pytest.mark.parametrize(("step", "counts"), [(5, range(45)), (30, range(60)), (60, range(60)), (61, range(0))])
def test_braking_counts_from_two_seconds_before_until_they_would_touch(straight_road, driver, step, counts):
    """The EMV comes to a car at 10 m/s and reaches it at step 60; one of the two brakes at one step."""
    tracks = {EMV: moving(0.0, 0.0, 10.0, steps=81, is_emv=True), CAR: moving(34.6, 0.0, 0.0, steps=81)}
    record = record_with(tracks, straight_road)
    record.states[step].accel_mps2[record.states[step].actor_id == driver] = -4.0
    moments = evidence_of(record, EMV, CAMERA, (0, 81)).moments
    before = moments.step < 60
    assert moments.time_to_collision_s[before] == pytest.approx(3.0 - 0.05 * moments.step[before])
    assert moments.braked_mps2[before].tolist() == [4.0 if step in counts else 0.0 for step in moments.step[before]]


@pytest.mark.parametrize("braked_mps2", [0.0, 5.0])
def test_an_oncoming_car_that_ends_its_turn_is_normal(straight_road, braked_mps2):
    """It comes in its own lane, and for a moment its turn leads to the EMV's; it may have braked for the turn."""
    steps, lane_m = 81, 3.5
    angle = np.clip(0.5 * (1.0 - np.arange(steps) * 0.05), 0.0, None)
    yaw = np.pi + angle
    x = 42.0 + np.concatenate(([0.0], np.cumsum(8.0 * 0.05 * np.cos(yaw))[:-1]))
    y = np.concatenate(([0.0], np.cumsum(8.0 * 0.05 * np.sin(yaw))[:-1]))
    y += lane_m - y[-1]
    turning = Track(np.stack((x, y, 8.0 * np.cos(yaw), 8.0 * np.sin(yaw), yaw), axis=1))
    record = record_with({EMV: moving(0.0, 0.0, 14.0, steps=steps, is_emv=True), CAR: turning}, straight_road)
    record.states[0].accel_mps2[record.states[0].actor_id == CAR] = -braked_mps2
    evidence = evidence_of(record, EMV, CAMERA, (0, steps))
    assert len(evidence.moments), "it points at the EMV"
    assert not evidence.encroachments
    assert label_of(evidence, DEFINITIONS["near_crash"]).risk is RiskClass.NORMAL
    assert label_of(evidence, DEFINITIONS["paper"]).risk is RiskClass.NEAR_MISS
