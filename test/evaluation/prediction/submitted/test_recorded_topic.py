"""What a program may have said wrong on the topic; a live one is in ``test/nodes/test_predictor_under_test.py``."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.datasets.sources.episode_source import EpisodeSource
from siren_ros.errors import BagError, InputError
from siren_ros.evaluation.prediction.protocol.samples import Population, SampleBatch, samples_of
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.evaluation.prediction.submitted.recorded_topic import read_recorded_predictions
from siren_ros.interfaces.programs.predictions import to_predicted_paths
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.world.predicted_paths import PredictedPaths


@dataclass(frozen=True)
class Message:
    content: Any

    def read(self) -> Any:
        return self.content


@dataclass(frozen=True)
class Bag:
    """A bag that holds predictions alone."""

    said: list[PredictedPaths]
    topic: str = "/predictions"
    path: Path = Path("bags/judged")

    @property
    def bag(self) -> "Bag":
        return self

    @property
    def type_names(self) -> dict[str, str]:
        return {self.topic: "siren_msgs/msg/PredictedPaths"}

    def messages(self, topics: set[str]) -> Iterator[Message]:
        assert topics == {self.topic}
        return (Message(to_predicted_paths(one)) for one in self.said)


@pytest.fixture(scope="module")
def batch(straight_road: RoadNetwork) -> SampleBatch:
    tracks = {1: moving(0.0, -5.25, 5.0, steps=199), 12: moving(30.0, -1.75, 6.0, steps=199)}
    return samples_of(record_with(tracks, straight_road), HistoryWindow(), Population.ALL).batch


def everything_said(points: int = 60) -> list[PredictedPaths]:
    """Two paths for each vehicle at each frame of the episode, those without a whole window included."""
    times = 0.1 * np.arange(1, points + 1)
    found = []
    for step in range(0, 200, 2):
        now = 0.05 * step
        start = np.array([[5.0 * now, -5.25], [30.0 + 6.0 * now, -1.75]])
        velocity = np.array([[5.0, 0.0], [6.0, 0.0]])
        path = start[:, None] + times[:, None] * velocity[:, None]
        xy_m = np.repeat(path, 2, axis=0)
        xy_m[1::2, :, 1] += 1.0
        ids = np.array([1, 1, 12, 12], dtype=np.uint32)
        found.append(PredictedPaths(step, ids, np.array([0.25, 0.75, 0.5, 0.5]), xy_m))
    return found


def read(said: list[PredictedPaths], allow_missing: bool = False) -> Any:
    return read_recorded_predictions(cast("EpisodeSource", Bag(said)), allow_missing)


def test_samples_are_taken_and_others_left_out(batch: SampleBatch) -> None:
    rows, hypotheses = read(everything_said()).meet(batch)
    assert rows.tolist() == list(range(len(batch)))
    first = hypotheses.select(batch.actors.actor_id[batch.target] == 1)
    assert np.allclose(first.probability, [0.75, 0.25])
    assert np.allclose(first.xy_m[:, 0, :, 1], -4.25)
    assert np.allclose(first.xy_m[:, 0, -1, 0] - batch.xy_m[batch.actors.actor_id[batch.target] == 1, 0], 25.0)


def test_a_frame_without_predictions_is_missing(batch: SampleBatch) -> None:
    said = everything_said()
    at = next(number for number, one in enumerate(said) if one.step == 70)
    said[at] = replace(said[at], actor_id=said[at].actor_id[:0], probability=np.zeros(0), xy_m=np.zeros((0, 60, 2)))
    with pytest.raises(InputError, match=r"/predictions of bags/judged: 2 of 40 samples .* is actor 1 at step 70"):
        read(said).meet(batch)
    assert len(read(said, allow_missing=True).meet(batch)[0]) == 38


def test_a_program_that_said_nothing(batch: SampleBatch) -> None:
    with pytest.raises(InputError, match="40 of 40 samples have no prediction"):
        read([]).meet(batch)
    assert len(read([], allow_missing=True).meet(batch)[0]) == 0


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"probability": np.array([0.25, 0.25, 0.5, 0.5])}, "1 of 200 samples have probabilities of another sum"),
        ({"probability": np.array([np.nan, 0.75, 0.5, 0.5])}, "1 of 400 probabilities are not finite"),
        ({"xy_m": np.full((4, 60, 2), np.inf)}, "4 of 400 paths are not finite.* actor 1, step 6"),
        ({"xy_m": np.zeros((4, 31, 2))}, "4 of 400 paths of another horizon; .* actor 1 at step 6 with 31 points"),
    ],
)
def test_wrong_messages_are_refused_with_their_number(change: dict[str, Any], told: str) -> None:
    said = everything_said()
    said[3] = replace(said[3], **change)
    with pytest.raises(InputError, match=told):
        read(said)


def test_a_bag_without_the_topic() -> None:
    with pytest.raises(BagError, match="a bag with the topic /predictions"):
        read_recorded_predictions(cast("EpisodeSource", Bag(everything_said(), topic="/other")), allow_missing=False)
