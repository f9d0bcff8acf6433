"""Scenes for the tests of the predictor: a crossroads with a signal, seen from anywhere."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from made_records import Track, samples_in

from siren_ros.evaluation.prediction.samples import SampleBatch
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.geometry import Polyline
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.world.actors import Lights


def batch_of(tracks: Mapping[int, Track], network: RoadNetwork) -> SampleBatch:
    """All samples of the record of given tracks, without their future."""
    return samples_in(tracks, network).batch


def with_signal(network: RoadNetwork, letters: str) -> RoadNetwork:
    """The crossroads with a signal: link n is the movement n, whose letter does not matter here."""
    movements = tuple(
        replace(movement, signal_id="signal", signal_link=link) for link, movement in enumerate(network.connections)
    )
    assert len(letters) == len(movements)
    return replace(network, connections=movements)


def showing(batch: SampleBatch, letters: str) -> SampleBatch:
    """The batch with the signal showing the same at every frame."""
    codes = np.tile(np.frombuffer(letters.encode(), dtype=np.uint8), (len(batch.step), 1))
    return replace(batch, signals={"signal": codes})


def lit(batch: SampleBatch, actor_id: int, lights: Lights) -> SampleBatch:
    """The batch with one actor showing lights."""
    shown = np.where(batch.actors.actor_id == actor_id, np.uint8(lights), batch.actors.lights)
    return replace(batch, actors=replace(batch.actors, lights=shown))


def moved(batch: SampleBatch, angle_rad: float, shift_m: Floats) -> SampleBatch:
    """The whole scene turned about the origin, and then shifted."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[cos, -sin], [sin, cos]])
    actors, network = batch.actors, batch.network
    lanes = tuple(
        replace(lane, centre=Polyline.through(lane.centre.points @ turn.T + shift_m)) for lane in network.lanes
    )
    return replace(
        batch,
        network=replace(network, lanes=lanes),
        actors=replace(
            actors,
            xy_m=np.where(actors.observed[..., None], actors.xy_m @ turn.T + shift_m, 0.0),
            velocity_mps=actors.velocity_mps @ turn.T,
            yaw_rad=np.where(actors.observed, actors.yaw_rad + angle_rad, 0.0),
        ),
    )
