import json
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.labels import Evidence, RiskClass, RiskThresholds
from siren_ros.scoring.evaluation.risk.severity import (
    Severity,
    read_severities,
    score_severities,
    severities_of,
    severity_of,
    template_means,
)
from siren_ros.scoring.evaluation.risk.tables import table_of_changes, table_of_severity
from siren_ros.scoring.evaluation.risk.video_set import changes_of_labels


def test_numbers_of_a_video(small_set):
    kinds = {key: severity_of(video.evidence, RiskThresholds()) for key, video in small_set.videos.items()}
    assert kinds["S4_000"] == Severity(3.0, 0.0)
    assert kinds["S4_002"] == Severity(pytest.approx(0.9), 0.0)
    assert kinds["S6_005"] == Severity(0.0, 3.5)


def test_slow_closing_does_not_count(small_set):
    evidence = small_set.videos["S4_002"].evidence
    slow = replace(evidence.moments, closing_mps=np.full(len(evidence.moments), 0.5))
    assert severity_of(Evidence(slow, (), ()), RiskThresholds()).least_ttc_s == 3.0


def test_the_truth_has_no_error_and_a_constant_has_no_rank(small_set):
    scores = score_severities(small_set, severities_of(small_set))
    assert (scores["least_ttc_s"].error.value, scores["least_ttc_s"].rank_correlation) == (0.0, pytest.approx(1.0))
    assert scores["contact_mps"].error.blocks == 1
    constant = dict.fromkeys(small_set.videos, Severity(1.0, 0.0))
    scores = score_severities(small_set, constant)
    truth = [value.least_ttc_s for value in severities_of(small_set).values()]
    assert scores["least_ttc_s"].error.value == pytest.approx(np.mean(np.abs(np.array(truth) - 1.0)))
    assert scores["least_ttc_s"].rank_correlation is None
    assert scores["contact_mps"].error.value == 3.5


def test_the_template_tells_its_mean(small_set):
    truth, means = severities_of(small_set), template_means(small_set)
    of_s4 = [truth[key].least_ttc_s for key in ("S4_000", "S4_001", "S4_002")]
    assert means["S4_001"].least_ttc_s == pytest.approx(np.mean(of_s4))
    assert means["S6_003"].contact_mps == pytest.approx(3.5 / 3.0)
    assert table_of_severity(small_set, {"x": truth}).rows[0][0] == "template_prior"


@pytest.mark.parametrize("suffix", ["json", "csv"])
def test_guesses_are_read_from_both_formats(tmp_path, suffix):
    path = tmp_path / f"a.{suffix}"
    given = {"a": {"class": "Normal", "least_ttc_s": 1.5, "contact_mps": 0.0}}
    rows = "video,class,least_ttc_s,contact_mps\na,Normal,1.5,0\n"
    path.write_text(json.dumps(given) if suffix == "json" else rows)
    assert read_severities(path) == {"a": Severity(1.5, 0.0)}
    path.write_text('{"a": "Normal"}' if suffix == "json" else "video,class\na,Normal\n")
    assert read_severities(path) == {}
    path.write_text(
        json.dumps({"a": {"least_ttc_s": float("nan"), "contact_mps": 0}})
        if suffix == "json"
        else rows + "b,Normal,nan,0\n"
    )
    with pytest.raises(InputError, match="finite"):
        read_severities(path)
    path.write_text('{"a": {"least_ttc_s": 1}}' if suffix == "json" else rows + "b,Normal,x,0\n")
    with pytest.raises(InputError, match="numbers"):
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
