"""Where traffic keeps left, an episode is judged as its mirror image where it keeps right."""

from dataclasses import replace

import hand_made_record as hand
import numpy as np
import pytest
from judging.test_turned_records import at_junction, queues

from siren_ros.scoring.judging.outcome import av_response
from siren_ros.scoring.judging.predicates import evaluate_predicate
from siren_ros.scoring.judging.verdict import Part, verdict_of, with_sides_exchanged
from siren_ros.simulation.scenario.scenario import DECLARED_PREDICATES


def judged_by(record, name):
    thresholds = {key: low for key, (low, _) in DECLARED_PREDICATES[name].thresholds.items()}
    about = {"predicate": {"name": name, "thresholds": thresholds}}
    return replace(record, description=replace(record.description, parameters=about))


@pytest.mark.parametrize(
    ("record", "name"),
    [(queues(), "queues_split"), (at_junction(), "red_crossing"), (at_junction(), "red_same_direction")],
    ids=["S1", "S4", "S3"],
)
def test_verdicts_are_the_same(record, name):
    own = judged_by(record, name)
    verdict, image = evaluate_predicate(own), evaluate_predicate(own.mirrored())
    assert image.measures() == verdict.measures()
    assert image.holds is verdict.holds


def test_a_turn_to_the_left_on_the_shoulder_counts_where_traffic_keeps_left():
    way = np.arange(600) * 0.25
    record = hand.hand_made(hand.crossing(), {hand.EMV: hand.Driven(hand.ON_SHOULDER, way)})
    verdict = evaluate_predicate(judged_by(record.mirrored(), "shoulder_turn"))
    assert verdict.holds
    assert "to the left" in verdict.text
    assert verdict.measures() == evaluate_predicate(judged_by(record, "shoulder_turn")).measures()


def test_words_for_sides_change_places_and_verbs_stay():
    part = Part("queue", 1.0, 1.0, True, ">=", "3 on the left, 2 on the right")
    verdict = with_sides_exchanged(verdict_of((part,), "6 civilians left the lane; the EMV turned right nowhere"))
    assert verdict.parts[0].detail == "3 on the right, 2 on the left"
    assert verdict.text == "6 civilians left the lane; the EMV turned left nowhere"


def test_the_avs_way_to_the_kerb_is_to_the_left():
    x_m = hand.RIGHT_X_M
    aside = hand.line((x_m, -120.0), (x_m, -86.0), (x_m + 2.0, -82.0), (x_m + 2.0, 110.0))
    vehicles = {
        hand.EMV: hand.Driven(hand.line((3.5, -120.0), (3.5, 110.0)), hand.at_speed(0.0, 10.0, 300)),
        2: hand.Driven(aside, hand.at_speed(30.0, 3.0, 300)),
    }
    record = hand.hand_made(hand.crossing(), vehicles)
    record = replace(record, description=replace(record.description, parameters={"av": {"actor_id": 2, "name": "v2"}}))
    assert av_response(record).moved_right_m > 0.5
    assert av_response(record.mirrored()) == av_response(record)
