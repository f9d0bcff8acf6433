"""Scenes for the tests of predictors: a crossroads with other lanes or a signal, seen from anywhere."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from made_records import Track, samples_in
from synthetic_episode import rotate

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.geometry import Polyline
from siren_ros.scoring.evaluation.prediction.samples import SampleBatch
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import Lights


def batch_of(tracks: Mapping[int, Track], network: RoadNetwork) -> SampleBatch:
    """All samples of the record of given tracks, without their future."""
    return samples_in(tracks, network).batch


def with_lines(
    network: RoadNetwork, lines: Mapping[int, npt.ArrayLike], angle_rad: float = 0.0, shift_m: npt.ArrayLike = 0.0
) -> RoadNetwork:
    """The network with other centre lines of some lanes, all turned about the origin and then shifted."""
    lanes = tuple(
        replace(lane, centre=Polyline.through(rotate(np.asarray(points), angle_rad) + shift_m))
        for lane in network.lanes
        for points in [lines.get(lane.index, lane.centre.points)]
    )
    return replace(network, lanes=lanes)


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
    actors = batch.actors
    elsewhere = replace(
        actors,
        xy_m=np.where(actors.observed[..., None], rotate(actors.xy_m, angle_rad) + shift_m, 0.0),
        velocity_mps=rotate(actors.velocity_mps, angle_rad),
        yaw_rad=np.where(actors.observed, actors.yaw_rad + angle_rad, 0.0),
    )
    return replace(batch, network=with_lines(batch.network, {}, angle_rad, shift_m), actors=elsewhere)
