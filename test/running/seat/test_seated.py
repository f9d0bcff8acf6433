"""The controller for a ROS program, on the messages of a recorded episode, without ROS."""

from dataclasses import replace
from typing import ClassVar

import pytest
from hand_made_record import EMV, Driven, at_speed, crossing, hand_made, line

import siren_ros
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.data.interfaces import topics
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.seated import SeatedDriver, answers_of

DRIVER = "lawful-california"


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[str, bytes]]:
    """Topics and bytes of an episode that the driver has driven without ROS, in the order of time."""
    bag = tmp_path_factory.mktemp("driven") / "bag"
    setup = set_up_episode(siren_ros.EpisodeRequest(av="civilian", sensors="none", duration_s=2.0))
    record_episode(setup, bag, answers_of(setup, driver_of(DRIVER)))
    with open_bag(bag) as opened:
        return [(message.topic, bytes(message.cdr)) for message in opened.messages(opened.type_names)]


def driven_by(controller: siren_ros.AvController, messages: list[tuple[str, bytes]]) -> list[bytes]:
    answers = [controller.take(topic, cdr) for topic, cdr in messages if topic in controller.INPUTS]
    return [answer for answer in answers if answer is not None]


def test_the_answers_have_the_bytes_of_the_driver_without_ros(messages: list[tuple[str, bytes]]) -> None:
    controller = siren_ros.AvController(DRIVER)
    assert (controller.ready, controller.ended) == (False, False)
    recorded = [cdr for topic, cdr in messages if topic == controller.OUTPUT[0]]
    assert len(recorded) == 40
    assert driven_by(controller, messages) == recorded
    assert (controller.ready, controller.ended) == (True, True)


def test_a_driver_of_ones_own_gets_sights_and_gives_controls(messages: list[tuple[str, bytes]]) -> None:
    class Counts:
        start = 0

        def step(self, state: int, sight: siren_ros.Sight) -> tuple[int, siren_ros.AvControl]:
            assert sight.step == state
            return state + 1, siren_ros.AvControl(sight.step, brake=1.0)

    answers = driven_by(siren_ros.AvController(Counts()), messages)
    assert len(answers) == 40
    assert answers != [cdr for topic, cdr in messages if topic == topics.AV_CONTROL.name]


def test_a_driver_knows_how_far_it_has_come_on_a_way_that_leads_back() -> None:
    """100 m to the north, 20 m aside and back: it looks for its place around the last one."""

    class Notes:
        start = 0
        places_m: ClassVar[list[float]] = []

        def step(self, state: int, sight: siren_ros.Sight) -> tuple[int, siren_ros.AvControl]:
            self.places_m.append(sight.s_m)
            return state + 1, siren_ros.AvControl(sight.step)

    way = Polyline.through(line((5.25, -120.0), (5.25, -20.0), (25.25, -20.0), (25.25, -120.0))).resampled(2.0)
    car = Driven(way.points, at_speed(0.0, 20.0, 220))
    record = hand_made(crossing(), {EMV: car, 2: car})
    seated = SeatedDriver(Notes(), record.network, way, 2)
    for states, traffic in zip(record.states, record.traffic, strict=True):
        seated.answer(states, replace(traffic, spawned=tuple(record.actors.values()) if states.step == 0 else ()))
    assert Notes.places_m == pytest.approx([float(one) for one in car.arc_m], abs=0.1)


def test_drivers_and_topics_that_do_not_exist_are_named() -> None:
    with pytest.raises(siren_ros.InputError, match="driver: 'nobody'"):
        siren_ros.AvController("nobody")
    with pytest.raises(siren_ros.InputError, match=r"topic: '/clock' .*/siren/episode"):
        siren_ros.AvController(DRIVER).take("/clock", b"")
