"""Exports ``trajectory.csv`` in the paper's layout (supplement, "Data Formats and Coordinate Conventions").

One row per actor per logged frame at 10 Hz, in CARLA's world frame: left-handed, x forward, y right,
z up, yaw in degrees increasing clockwise, so ``y = −y_map``, ``vy = −vy_map`` and ``yaw = −yaw_map``.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats, Ids
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.datasets.files import FileWriter, link
from siren_ros.data.datasets.formats import EpisodePart, EpisodeReport
from siren_ros.data.interfaces.conversions import from_actor_states, from_traffic_state
from siren_ros.data.interfaces.topics import ACTORS, TRAFFIC
from siren_ros.data.record.episode_source import EpisodeSource
from siren_ros.data.record.tracks import LOG_PERIOD_STEPS
from siren_ros.data.recording.bag_reader import damage_refused
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError
from siren_ros.simulation.scenario.interaction_region import region_members
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, ActorStates

COLUMNS: Final = ("step", "timestamp", "actor_id", "type_id", "x", "y", "z", "yaw", "vx", "vy", "speed_mps", "is_emv")
_DECIMALS: Final = 4
HEAD: Final = ",".join(COLUMNS) + "\n"
FILE_NAME: Final = "trajectory.csv"


def type_id_of(actor_class: ActorClass) -> str:
    """Type id in the form of CARLA's blueprint ids: ``vehicle.siren.ambulance``, ``walker.siren.pedestrian``.

    CARLA's ids name car models; these actors are none of them.
    """
    kind = "walker" if actor_class is ActorClass.PEDESTRIAN else "vehicle"
    return f"{kind}.siren.{actor_class.name.lower()}"


def trajectory_csv(record: EpisodeRecord) -> str:
    """The whole file of a recorded episode as text; rows in the order of steps and, within a step, of actor ids."""
    logged = [states for states in record.states if states.step % LOG_PERIOD_STEPS == 0]
    return HEAD + "".join(lines_of_step(states, record.actors) for states in logged)


def lines_of_step(states: ActorStates, actors: Mapping[int, ActorDescription]) -> str:
    """The rows of one step. Raises BagError: an actor is not described."""
    time_s = f"{states.step * STEP_S:.2f}"
    # The angle is rounded first and then wrapped to (−180, 180], as in CARLA.
    yaw_deg = np.round(-np.degrees(states.yaw_rad), _DECIMALS)
    yaw_deg = 180.0 - np.mod(180.0 - yaw_deg, 360.0)
    columns = (states.x_m, -states.y_m, states.z_m, yaw_deg, states.vx_mps, -states.vy_mps, states.speed_mps)
    numbers = zip(*(_texts(column) for column in columns), strict=True)
    lines = []
    for actor_id, values in zip(states.actor_id.tolist(), numbers, strict=True):
        actor = actors.get(actor_id)
        if actor is None:
            raise BagError(f"step {states.step}", f"an episode that describes its actors; {actor_id} is not")
        head = (str(states.step), time_s, str(actor_id), type_id_of(actor.actor_class))
        lines.append(",".join((*head, *values, str(int(actor.is_emv)))) + "\n")
    return "".join(lines)


def _texts(column: Floats) -> list[str]:
    # Rounding can give −0.0; adding zero turns it into 0.0.
    return [f"{value:.{_DECIMALS}f}" for value in (np.round(column, _DECIMALS) + 0.0).tolist()]


class CsvExporter:
    """Writes ``trajectory.csv``; several episodes get one folder each."""

    def __init__(self, region: str) -> None:
        self._region = region == "yes"

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:  # noqa: ARG002 - the interface of all formats
        """Write row by row; only one step is in memory."""
        files.append(FILE_NAME, HEAD)
        actors: dict[int, ActorDescription] = {}
        members: Ids = np.empty(0, dtype=np.uint32)
        rows, seen = 0, set()
        for step, held in source.messages_by_step({ACTORS.name, TRAFFIC.name}):
            with damage_refused(source.path):
                if TRAFFIC.name in held:
                    spawned = from_traffic_state(held[TRAFFIC.name].read()).spawned
                    actors.update({actor.actor_id: actor for actor in spawned})
                if ACTORS.name not in held:
                    continue
                states = from_actor_states(held[ACTORS.name].read())
            if self._region:
                members = region_members(members, states, source.description.emv_ids)
                states = states.select(np.isin(states.actor_id, members))
            if step % LOG_PERIOD_STEPS == 0:
                files.append(FILE_NAME, lines_of_step(states, actors))
                rows += len(states)
                seen.update(states.actor_id.tolist())
                files.progress(step * STEP_S)
        classes = Counter(actors[actor_id].actor_class.name.lower() for actor_id in sorted(seen))
        return EpisodeReport({"rows": rows, "vehicles": len(seen)}, classes)

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Assemble one file, or one folder per episode."""
        for part in parts:
            link(part.folder / FILE_NAME, (folder if len(parts) == 1 else folder / part.episode_id) / FILE_NAME)
