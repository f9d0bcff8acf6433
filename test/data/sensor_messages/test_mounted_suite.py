"""Which messages go out at which step, and which steps are reported, where sensing trails and where it does not."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest
from hand_made_record import actor_states
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.measurements import Transform, from_tf
from siren_ros.data.interfaces.messages import decode_cdr, typestore
from siren_ros.data.sensor_messages.mounted_suite import TrailingSensing
from siren_ros.data.sensor_messages.sensor_topics import AV, EMV, Carrier, row_of_carrier
from siren_ros.errors import EpisodeError
from siren_ros.sensing.rig import Observations, Sensing
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, ActorStates

ACTORS = {k: ActorDescription(k, f"v{k}", ActorClass.SEDAN, 4.6, 1.8, 1.4, (0, 0, 0)) for k in (1, 2)}


def states_at(step: int, *ids: int) -> ActorStates:
    return actor_states(step, actor_id=ids)


@dataclass
class RecordedSuite:
    """A suite that writes down what it is asked for."""

    carrier: Carrier = EMV
    carrier_id: int = 1
    in_background: bool = True
    log: list[tuple[str, int]] = field(default_factory=list)

    @property
    def rig(self) -> Any:
        return SimpleNamespace(begin=self._begin)

    @property
    def messages(self) -> Any:
        return SimpleNamespace(carrier_id=self.carrier_id, of_step=self._of_step)

    def _begin(self, states: ActorStates, actors: Any, signals: Any, carrier_id: int) -> Sensing:
        assert (actors, signals, carrier_id) == (ACTORS, (), self.carrier_id)
        self.log.append(("begin", states.step))

        def finish() -> Observations:
            self.log.append(("finish", states.step))
            return Observations(states.step, (), (), None)

        return Sensing(self.in_background, finish)

    def _of_step(self, states: ActorStates, seen: Observations) -> Iterator[tuple[Any, int]]:
        assert seen.step == states.step
        self.log.append(("messages", states.step))
        yield topics.GROUND_TRUTH.of_carrier(self.carrier.name), states.step

    def locate(self, states: ActorStates) -> Any:
        row_of_carrier(states, self.carrier_id)
        base = Transform("map", self.carrier.frame("base_link"), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        return (base,), (topics.ODOMETRY.of_carrier(self.carrier.name), states.step)


@pytest.fixture(name="sensing")
def _sensing() -> Callable[..., tuple[TrailingSensing, RecordedSuite]]:
    def build(*, trails: bool, in_background: bool = True) -> tuple[TrailingSensing, RecordedSuite]:
        suite = RecordedSuite(in_background=in_background)
        return TrailingSensing([suite], trails=trails), suite

    return build


def label_steps(published: Iterable[tuple[Any, Any]]) -> list[int]:
    """Steps of the measurements that go out."""
    return [message for topic, message in published if topic == topics.GROUND_TRUTH]


@pytest.mark.parametrize(("trails", "in_background"), [(False, True), (True, False)])
def test_measurements_go_out_at_once_where_nothing_trails(sensing, trails, in_background):
    trailing, _ = sensing(trails=trails, in_background=in_background)
    for step in range(3):
        assert label_steps(trailing.step(states_at(step, 1), ACTORS, ())) == [step]
        assert not trailing.under_way
        assert list(trailing.finished_steps(0.5)) == [(step, 0.5)]


def test_a_trailing_step_goes_out_after_the_next_has_begun(sensing):
    trailing, suite = sensing(trails=True)
    assert label_steps(trailing.step(states_at(0, 1), ACTORS, ())) == []
    assert trailing.under_way
    assert label_steps(trailing.step(states_at(1, 1), ACTORS, ())) == [0]
    assert suite.log == [("begin", 0), ("finish", 0), ("begin", 1), ("messages", 0)]
    assert label_steps(trailing.finish()) == [1]
    assert label_steps(trailing.finish()) == []
    assert not trailing.under_way


def test_the_time_spent_is_reported_with_the_step_that_is_out(sensing):
    trailing, _ = sensing(trails=True)
    list(trailing.step(states_at(0, 1), ACTORS, ()))
    assert list(trailing.finished_steps(0.25)) == []
    list(trailing.step(states_at(1, 1), ACTORS, ()))
    assert list(trailing.finished_steps(0.5)) == [(0, 0.75)]
    list(trailing.finish())
    assert list(trailing.finished_steps(0.125)) == [(1, 0.125)]
    assert list(trailing.finished_steps(0.125)) == []


@given(pauses=st.lists(st.booleans(), min_size=1, max_size=12), trails=st.booleans())
def test_every_step_is_published_and_reported_once_and_in_order(pauses, trails):
    suite = RecordedSuite()
    trailing = TrailingSensing([suite], trails=trails)
    published: list[int] = []
    reported: list[int] = []
    for step, pause in enumerate([*pauses, True]):
        messages = list(trailing.step(states_at(step, 1), ACTORS, ()))
        assert [message for topic, message in messages if topic == topics.ODOMETRY] == [step], "at once"
        assert sum(topic == topics.TF for topic, _ in messages) == 1
        published += label_steps(messages)
        if pause:  # the next step is late
            published += label_steps(trailing.finish())
        reported += [finished for finished, _ in trailing.finished_steps(0.0)]
        assert reported == published
        assert len(published) >= step + 1 - trails
    assert published == list(range(len(pauses) + 1))


def test_both_carriers_begin_before_either_is_waited_for():
    log: list[tuple[str, int]] = []
    suites = [RecordedSuite(log=log), RecordedSuite(AV, 2, log=log)]
    trailing = TrailingSensing(suites, trails=False)
    published = list(trailing.step(states_at(4, 1, 2), ACTORS, ()))
    assert log == [("begin", 4)] * 2 + [("finish", 4)] * 2 + [("messages", 4)] * 2
    by_carrier = ["/emv/odom", "/av/odom", "/emv/ground_truth", "/av/ground_truth"]
    assert [topic.name for topic, _ in published] == ["/tf", "/siren/markers", *by_carrier]
    frames = from_tf(decode_cdr(typestore(), topics.TF, published[0][1]))
    assert [frame.child for frame in frames] == ["base_link", "av/base_link"]


def test_a_carrier_that_has_left_the_map_is_an_error(sensing):
    trailing, suite = sensing(trails=True)
    with pytest.raises(EpisodeError, match="actor 1, is not on the map at step 7"):
        list(trailing.step(states_at(7, 2), ACTORS, ()))
    assert suite.log == []
