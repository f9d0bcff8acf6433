"""An exam on a map with left-hand traffic: the edge of the road is on the left there."""

import numpy as np
import pytest

from siren_ros.base.numerics.units import steps_from_s
from siren_ros.reports.exam.grading import Grade, examine
from siren_ros.reports.exam.rulebook import load_rulebook
from siren_ros.running.generation.closed_loop import closed_loop, driven, record_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.seated import answers_of
from siren_ros.scoring.evaluation.yielding.encounters import lane_offsets
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.mirrored_net import mirrored_net
from siren_ros.simulation.scenario.episode import EpisodeRequest

UNTIL_PASSED_S = 16.0
"""The EMV has passed the driver."""


@pytest.fixture(scope="module")
def left_hand_town(tmp_path_factory):
    file = tmp_path_factory.mktemp("maps") / "left.net.xml"
    file.write_bytes(mirrored_net(compile_map(None).read_bytes()))
    return str(file)


def drive(driver, town):
    """The record of an episode, and who drove."""
    setup = set_up_episode(EpisodeRequest("S2", "L2", 0, town, sensors="none", av="civilian"))
    loop = closed_loop(setup, steps_from_s(UNTIL_PASSED_S))
    steps = [step for step, _ in driven(loop, answers_of(setup, driver_of(driver)))]
    return record_of(setup, steps), setup.description.av_id


@pytest.mark.parametrize(("driver", "broken"), [("lawful-california", set()), ("wrong-side-california", {"side"})])
def test_the_lawful_side_is_the_left_one(left_hand_town, driver, broken):
    record, av_id = drive(driver, left_hand_town)
    assert record.network.left_hand
    marks = {mark.clause.clause_id: mark.grade for mark in examine(record, av_id, load_rulebook("california")).marks}
    assert {clause for clause, grade in marks.items() if grade in {Grade.MINOR, Grade.MAJOR}} == broken
    assert marks["right_edge"] is Grade.PASS  # of the mirror image
    lateral_m = lane_offsets(record, record.track(av_id)).lateral_m
    assert np.sign(lateral_m[np.argmax(np.abs(lateral_m))]) == (-1.0 if broken else 1.0)  # left is positive
