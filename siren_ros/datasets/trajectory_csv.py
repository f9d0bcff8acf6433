"""``trajectory.csv`` in the paper's layout (supplement, "Data Formats and Coordinate Conventions").

One row per actor per logged frame at 10 Hz, in CARLA's world frame: left-handed, x forward, y right,
z up, yaw in degrees increasing clockwise, so ``y = −y_map``, ``vy = −vy_map`` and ``yaw = −yaw_map``.
"""

from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.errors import InputError
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.actors import ActorClass, ActorStates

COLUMNS: Final = (
    "step",
    "timestamp",
    "actor_id",
    "type_id",
    "x",
    "y",
    "z",
    "yaw",
    "vx",
    "vy",
    "speed_mps",
    "is_emv",
)
LOG_PERIOD_STEPS: Final = 2
"""10 Hz (paper: "actor states are logged at 10 Hz")."""
_DECIMALS: Final = 4


def type_id_of(actor_class: ActorClass) -> str:
    """A name in the form of CARLA's blueprint ids: ``vehicle.siren.ambulance``.

    CARLA's ids name car models; these actors are none of them.
    """
    return f"vehicle.siren.{actor_class.name.lower()}"


def trajectory_csv(record: EpisodeRecord) -> str:
    """The whole file as text; rows in the order of steps and, within a step, of actor ids."""
    lines = [",".join(COLUMNS)]
    for states in record.states:
        if states.step % LOG_PERIOD_STEPS == 0:
            lines += _lines_of_step(record, states)
    return "\n".join(lines) + "\n"


def _lines_of_step(record: EpisodeRecord, states: ActorStates) -> list[str]:
    time_s = f"{states.step * STEP_S:.2f}"
    yaw_deg = -np.degrees(states.yaw_rad)
    # Within (−180, 180], as CARLA gives it.
    yaw_deg = 180.0 - np.mod(180.0 - yaw_deg, 360.0)
    columns = (states.x_m, -states.y_m, states.z_m, yaw_deg, states.vx_mps, -states.vy_mps, states.speed_mps)
    numbers = zip(*(_texts(column) for column in columns), strict=True)
    lines = []
    for actor_id, values in zip(states.actor_id.tolist(), numbers, strict=True):
        actor = record.actors[actor_id]
        head = (str(states.step), time_s, str(actor_id), type_id_of(actor.actor_class))
        lines.append(",".join((*head, *values, str(int(actor.is_emv)))))
    return lines


def _texts(column: Floats) -> list[str]:
    # Adding zero turns −0.0, which rounding leaves behind, into 0.0.
    return [f"{value:.{_DECIMALS}f}" for value in (np.round(column, _DECIMALS) + 0.0).tolist()]


def export_csv(record: EpisodeRecord, folder: Path) -> Path:
    """Writes ``trajectory.csv`` into a folder; makes the folder where it is missing.

    Raises:
        InputError: The file exists already, or cannot be written.
    """
    path = folder / "trajectory.csv"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8", newline="") as file:
            file.write(trajectory_csv(record))
    except FileExistsError as error:
        raise InputError("out", str(path), "a place where nothing is yet") from error
    except OSError as error:
        raise InputError("out", str(path), f"a place that can be written ({error.strerror or error})") from error
    return path
