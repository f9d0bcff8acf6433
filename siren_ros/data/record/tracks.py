"""Tracks of an episode at 10 Hz, the paper's logging rate, and windows of frames in them."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats, Ids, Rows
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError
from siren_ros.simulation.scenario.interaction_region import region_members
from siren_ros.simulation.world.actors import ActorDescription

LOG_PERIOD_STEPS: Final = 2
"""Steps between logged frames, which are 10 Hz apart (paper: "actor states are logged at 10 Hz")."""
FRAME_S: Final = LOG_PERIOD_STEPS * STEP_S
"""Duration of a *frame*, one logged step."""
REGION: Final = "region"
"""Population of the vehicles that are in the interaction region around the EMV for the whole window."""
POPULATIONS: Final = (REGION, "all")
"""Populations, as in the evaluation of predictors."""
_MOTION: Final = ("x_m", "y_m", "z_m", "yaw_rad", "vx_mps", "vy_mps", "accel_mps2")


@dataclass(frozen=True)
class Track:
    """Track of one vehicle over the frames at which it is present; arrays of shape ``(K,)`` in the ``map`` frame."""

    actor: ActorDescription
    frame: Rows
    """Numbers of 10 Hz frames, increasing."""
    x_m: Floats
    y_m: Floats
    z_m: Floats
    yaw_rad: Floats
    vx_mps: Floats
    vy_mps: Floats
    accel_mps2: Floats
    in_region: Flags
    """Whether the vehicle is in the interaction region around the EMV."""

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def xy_m(self) -> Floats:
        """Positions, shape ``(K, 2)``."""
        return np.stack((self.x_m, self.y_m), axis=-1)

    @property
    def speed_mps(self) -> Floats:
        """Speed over ground."""
        return np.hypot(self.vx_mps, self.vy_mps)

    def window(self, first: int, count: int) -> "Track":
        """The part of the track in some frames."""
        start, end = np.searchsorted(self.frame, [first, first + count])
        arrays: dict[str, Any] = {
            name: values[start:end] for name, values in vars(self).items() if isinstance(values, np.ndarray)
        }
        return Track(actor=self.actor, **arrays)


def rows_in_region(record: EpisodeRecord, *, walkers: bool = False) -> Flags:
    """Which of ``record.rows`` are in the interaction region at their step, shape ``(M,)``.

    It counts vehicles, and pedestrians too with ``walkers``.

    """
    members, inside = np.empty(0, dtype=np.uint32), [np.empty(0, dtype=np.int64)]
    for state in sorted(record.states, key=lambda state: state.step):
        members = region_members(members, state, record.emv_ids)
        inside.append(_row_keys(members, state.step))
    rows = record.rows
    left_out = np.isin(rows.actor_id, [] if walkers else record.walker_ids)
    return ~left_out & np.isin(_row_keys(rows.actor_id, rows.step), np.concatenate(inside))


def _row_keys(actor_id: Ids, step: Any) -> npt.NDArray[np.int64]:
    return np.asarray(actor_id.astype(np.int64) << 32 | step, dtype=np.int64)


def tracks_of(record: EpisodeRecord) -> tuple[Track, ...]:
    """The tracks of all vehicles, in the order of actor ids.

    Raises BagError: the record holds states of an actor that it does not describe.
    """
    rows, inside = record.rows, rows_in_region(record)
    logged = np.flatnonzero(rows.step % LOG_PERIOD_STEPS == 0)
    tracks = []
    for actor_id in np.unique(rows.actor_id[logged]).tolist():
        actor = record.actors.get(actor_id)
        if actor is None:
            raise BagError(record.description.template, f"an episode that describes its actors; {actor_id} is not")
        of_actor = logged[rows.actor_id[logged] == actor_id]
        frame = rows.step[of_actor] // LOG_PERIOD_STEPS
        motion = {name: getattr(rows, name)[of_actor] for name in _MOTION}
        tracks.append(Track(actor, frame, **motion, in_region=inside[of_actor]))
    return tuple(tracks)


def whole_windows(track: Track, count: int, population: str) -> Rows:
    """First frames of windows of ``count`` frames with the vehicle present and in the population throughout."""
    frames = track.frame[track.in_region] if population == REGION else track.frame
    if len(frames) < count:
        return np.empty(0, dtype=np.intp)
    whole = frames[count - 1 :] - frames[: len(frames) - count + 1] == count - 1
    return frames[: len(frames) - count + 1][whole].astype(np.intp)
