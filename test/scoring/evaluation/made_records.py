"""Records made of formulas, and their samples: a few vehicles on given tracks, on a given map."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from hand_made_record import actor_states

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, ScoredSamples, samples_of
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, ActorStates


@dataclass(frozen=True)
class Track:
    """x, y, vx, vy, yaw over consecutive steps from ``first_step`` on, shape ``(K, 5)``."""

    states: Floats
    first_step: int = 0
    length_m: float = 4.6
    is_emv: bool = False
    actor_class: ActorClass = ActorClass.SEDAN
    accel_mps2: float = 0.0
    without: frozenset[int] = field(default_factory=frozenset)
    """Steps at which nothing was recorded."""


def moving(x_m, y_m, speed_mps, accel_mps2=0.0, yaw_rad=0.0, steps=201, **more: Any) -> Track:
    """A straight track of constant acceleration."""
    time = np.arange(steps) * STEP_S
    along = speed_mps * time + 0.5 * accel_mps2 * time**2
    speed = speed_mps + accel_mps2 * time
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    columns = (x_m + along * cos, y_m + along * sin, speed * cos, speed * sin, np.full(steps, yaw_rad))
    return Track(np.stack(columns, axis=1), accel_mps2=accel_mps2, **more)


def record_with(tracks: Mapping[int, Track], network: RoadNetwork, template: str = "S2") -> EpisodeRecord:
    """The record of vehicles on given tracks; SUMO said nothing about them."""
    actors = {}
    for key, track in tracks.items():
        body = track.actor_class, track.length_m, 1.8, 1.5, (90, 90, 90)
        actors[key] = ActorDescription(key, f"v{key}", *body, is_emv=track.is_emv)
    steps = max(track.first_step + len(track.states) for track in tracks.values())
    about = template, EmergencyLevel.L2, 0, "made", "0" * 64, steps * STEP_S, "none", "paper"
    description = EpisodeDescription(*about, emv_ids=())
    states = tuple(_states(tracks, step) for step in range(steps))
    return EpisodeRecord(description, network, actors, states, (), {}, (), None, complete=True, topics={})


def samples_in(tracks: Mapping[int, Track], network: RoadNetwork, window: HistoryWindow | None = None) -> ScoredSamples:
    """All samples of the record of given tracks."""
    return samples_of(record_with(tracks, network), window or HistoryWindow(), Population.ALL)


def _states(tracks: Mapping[int, Track], step: int) -> ActorStates:
    there = {
        key: track.states[step - track.first_step]
        for key, track in sorted(tracks.items())
        if 0 <= step - track.first_step < len(track.states) and step not in track.without
    }
    poses = np.array(list(there.values())).reshape(-1, 5).T
    told = dict(zip(("x_m", "y_m", "vx_mps", "vy_mps", "yaw_rad"), poses, strict=True))
    return actor_states(step, actor_id=list(there), accel_mps2=[tracks[key].accel_mps2 for key in there], **told)
