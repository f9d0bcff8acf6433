"""Samples for trajectory prediction: the past for the predictor, and separately the future for the score.

A window says which past a predictor gets and which times it predicts (paper, "Trajectory prediction").
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Brief, Codes, Flags, Floats, Ids, Rows
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.data.tracks import LOG_PERIOD_STEPS, rows_in_region, sumo_lanes
from siren_ros.errors import BagError
from siren_ros.scoring.evaluation.prediction.reported_tracks import Reporter
from siren_ros.simulation.roads.road_network import MIRROR, NO_LANE, SIDES_EXCHANGED, RoadNetwork, right_hand_image
from siren_ros.simulation.world.actors import Indices

FRAME_PERIOD_S: Final = LOG_PERIOD_STEPS * STEP_S
"""Time between *frames*, the logged steps (10 Hz). Windows start at every frame."""
FUTURE_POINTS: Final = 25
FUTURE_STRIDE_FRAMES: Final = 2
"""Frames between points of the common grid of all methods: 5 s of future, a point every 0.2 s."""

LAST_FUTURE_STEP: Final = FUTURE_POINTS * FUTURE_STRIDE_FRAMES * LOG_PERIOD_STEPS
"""Number of steps from the present to the horizon."""


@dataclass(frozen=True)
class HistoryWindow:
    """The history that a predictor observes, including the present, in frames of 0.1 s.

    The default is 3 s at 0.2 s (NGSIM's convention), which CSP, STDAN, BAT and the references CV and IDM use.
    """

    points: int = 16
    stride_frames: int = 2
    future_frames: int = FUTURE_POINTS * FUTURE_STRIDE_FRAMES
    """Frames after the present that must be logged; a vehicle whose track ends earlier gives no sample."""

    @property
    def offsets(self) -> npt.NDArray[np.int64]:
        """Frames of the points relative to the present, shape ``(points,)``, the last one 0."""
        return np.arange(1 - self.points, 1, dtype=np.int64) * self.stride_frames

    @property
    def times_s(self) -> Floats:
        """Times of the points relative to the present, shape ``(points,)``."""
        return self.offsets * FRAME_PERIOD_S


ARGOVERSE_WINDOW: Final = HistoryWindow(points=50, stride_frames=1, future_frames=60)
"""Window of Argoverse 2's scenarios (11 s): predictors trained on it observe 5 s at 0.1 s and predict 6 s."""
WINDOWS: Final = {"ngsim": HistoryWindow(), "argoverse2": ARGOVERSE_WINDOW}
"""Windows by name."""


def future_offsets() -> npt.NDArray[np.int64]:
    """Frames of the scored points relative to the present, shape ``(FUTURE_POINTS,)``."""
    return np.arange(1, FUTURE_POINTS + 1, dtype=np.int64) * FUTURE_STRIDE_FRAMES


def future_times_s() -> Floats:
    """Times of the scored points relative to the present, shape ``(FUTURE_POINTS,)``: 0.2 s … 5 s."""
    return future_offsets() * FRAME_PERIOD_S


class Population(StrEnum):
    """Which vehicles give samples, and which are visible to predictors."""

    REGION = "region"
    """Vehicles in the interaction region around the EMV, as if no other were logged. This is assumed for the paper,
    which does not say whom it logs."""
    ALL = "all"
    """All vehicles anywhere on the map."""


@dataclass(frozen=True)
class ObservedActors(Brief):
    """All actors at the frames of a batch with their history: M rows, sorted by frame and then by actor.

    H points of history, the present last and always observed; the other values of a point that was not observed
    are 0. Frame ``map``, footprint centres.
    """

    frame: Rows
    """Index of each row's frame in ``SampleBatch.step``, shape ``(M,)``."""
    actor_id: Ids
    actor_class: Codes
    """``ActorClass`` of each row, shape ``(M,)``."""
    is_emv: Flags
    length_m: Floats
    width_m: Floats
    lights: Codes
    """``Lights`` that are on at the present, including beacon and siren; shape ``(M,)``."""
    observed: Flags
    """Whether a point of the history was observed, shape ``(M, H)``."""
    xy_m: Floats
    """Positions, shape ``(M, H, 2)``."""
    velocity_mps: Floats
    """Recorded velocity, shape ``(M, H, 2)``."""
    yaw_rad: Floats
    """Headings, shape ``(M, H)``."""
    accel_mps2: Floats
    """Acceleration along the heading, shape ``(M, H)``."""
    past_sumo_lane: Indices
    """SUMO's lane at each point, NO_LANE off the road or if unknown; shape ``(M, H)``."""

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def sumo_lane(self) -> Indices:
        """SUMO's lane at the present, shape ``(M,)``."""
        return self.past_sumo_lane[:, -1]


@dataclass(frozen=True)
class SampleBatch(Brief):
    """All samples of one episode without their future: N vehicles, each at one present frame.

    A sample is a row of ``actors``; its neighbours are the other rows of the same frame.
    """

    network: RoadNetwork
    window: HistoryWindow
    step: npt.NDArray[np.int64]
    """Step of each of the F frames, increasing."""
    frame_offset: Rows
    """Offsets of shape ``(F + 1,)``: the actors of frame f are the rows ``frame_offset[f]:frame_offset[f + 1]``."""
    actors: ObservedActors
    target: Rows
    """Row of each sample in ``actors``, shape ``(N,)``."""
    signals: Mapping[str, Codes] = field(default_factory=dict)
    """State of each traffic light at the frames, by its id: letters of SUMO's state string as ASCII codes, one column
    per link; shape ``(F, links)``, 0 where the state is unknown."""

    def __len__(self) -> int:
        return len(self.target)

    def between(self, first: int, end: int) -> "SampleBatch":
        """Copy the frames ``first:end`` with their samples; the copy has no access to other frames."""
        rows = slice(int(self.frame_offset[first]), int(self.frame_offset[end]))
        actors = {name: values[rows].copy() for name, values in vars(self.actors).items()}
        actors["frame"] = actors["frame"] - first
        inside = (self.target >= rows.start) & (self.target < rows.stop)
        return replace(
            self,
            step=self.step[first:end].copy(),
            frame_offset=self.frame_offset[first : end + 1] - rows.start,
            actors=ObservedActors(**actors),
            target=self.target[inside] - rows.start,
            signals={name: states[first:end].copy() for name, states in self.signals.items()},
        )

    @property
    def right_hand(self) -> "SampleBatch":
        """The batch itself if traffic keeps right, otherwise its mirror image.

        Models that were trained on right-hand traffic use it.
        """
        if not self.network.left_hand:
            return self
        actors = self.actors
        image = replace(
            actors,
            lights=SIDES_EXCHANGED[actors.lights],
            xy_m=actors.xy_m * MIRROR,
            velocity_mps=actors.velocity_mps * MIRROR,
            yaw_rad=-actors.yaw_rad,
        )
        return replace(self, network=right_hand_image(self.network), actors=image)

    @property
    def sample_step(self) -> npt.NDArray[np.int64]:
        """Step of the present of the samples, shape ``(N,)``."""
        return self.step[self.actors.frame[self.target]]

    @property
    def actor_id(self) -> npt.NDArray[np.int64]:
        """Actors of the samples, shape ``(N,)``."""
        return self.actors.actor_id[self.target].astype(np.int64)

    @property
    def xy_m(self) -> Floats:
        """Present positions of the samples, shape ``(N, 2)``."""
        return self.actors.xy_m[self.target, -1]

    @property
    def velocity_mps(self) -> Floats:
        """Present velocities of the samples, shape ``(N, 2)``."""
        return self.actors.velocity_mps[self.target, -1]

    @property
    def speed_mps(self) -> Floats:
        """Present speeds of the samples, shape ``(N,)``."""
        return np.hypot(self.velocity_mps[:, 0], self.velocity_mps[:, 1])

    @property
    def yaw_rad(self) -> Floats:
        """Present headings of the samples, shape ``(N,)``."""
        return self.actors.yaw_rad[self.target, -1]

    def neighbours(self) -> tuple[Rows, Rows]:
        """All pairs of a sample and another actor of its frame: sample indices and rows of ``actors``.

        Sorted by sample and then by actor.
        """
        frame = self.actors.frame[self.target]
        first = self.frame_offset[frame]
        count = self.frame_offset[frame + 1] - first
        sample = np.repeat(np.arange(len(self), dtype=np.intp), count)
        within = np.arange(len(sample)) - np.repeat(np.cumsum(count) - count, count)
        other = first[sample] + within
        apart = other != self.target[sample]
        return sample[apart], other[apart]


@dataclass(frozen=True)
class ScoredSamples(Brief):
    """A batch together with the true future, which predictors do not get."""

    batch: SampleBatch
    future_xy_m: Floats
    """Logged positions on the common grid, shape ``(N, FUTURE_POINTS, 2)``."""

    def __len__(self) -> int:
        return len(self.batch)

    def select(self, samples: Rows) -> "ScoredSamples":
        """Select some of the samples by increasing indices; all vehicles remain as neighbours."""
        return ScoredSamples(replace(self.batch, target=self.batch.target[samples]), self.future_xy_m[samples])


def samples_of(
    record: EpisodeRecord,
    window: HistoryWindow,
    population: Population,
    *,
    people: bool = False,
    reporter: Reporter | None = None,
) -> ScoredSamples:
    """Make one sample for each vehicle, including the EMV, and each frame whose whole window was logged.

    With the population of the region only states within it count as logged, those of neighbours too. People on foot and
    on two wheels have samples of their own (``people``), with everybody as neighbours. Samples of vehicles have no
    neighbours on foot.

    With a ``reporter`` the batch has what that one reports, without SUMO's lanes. The truth stays; vehicles that are
    not reported are missing.

    The stride is one frame, so that the windows overlap (paper, "Trajectory prediction"): a gapless track of F
    frames gives F − 80 samples with the default window.

    Raises:
        BagError: The record holds states of an actor that it does not describe.
    """
    rows = record.rows
    logged = rows.step % LOG_PERIOD_STEPS == 0
    if not people:
        logged &= ~np.isin(rows.actor_id, record.walker_ids)
    if population is Population.REGION:
        logged &= rows_in_region(record, walkers=people)
    rows = rows.select(logged)
    ids = np.unique(rows.actor_id)
    missing = [key for key in ids.tolist() if key not in record.actors]
    if missing:
        raise BagError(record.description.template, f"an episode that describes its actors; {missing} are not")
    table, wanted = _row_table(rows, ids), np.isin(ids, record.people_ids) == people
    past, future = window.offsets, future_offsets()
    needed = np.union1d(future, np.arange(future[-1] + 1, window.future_frames + 1))
    present = _present_frames(table, np.concatenate((past, needed)))
    frames = np.flatnonzero(present.any(axis=0))
    frame, actor = np.nonzero(table[:, frames].T >= 0)
    there = _points(table, actor, frames[frame], past)
    lanes, seen = sumo_lanes(record, rows), rows
    if reporter is not None:
        reported = reporter(record, rows, table)
        seen, lanes = reported.rows, np.full(len(reported.rows), NO_LANE, dtype=lanes.dtype)
        there = reported.points(there, table, actor, frames[frame], past)
        known = there[:, -1] >= 0
        there, frame, actor = there[known], frame[known], actor[known]
    batch = SampleBatch(
        network=record.network,
        window=window,
        step=frames * LOG_PERIOD_STEPS,
        frame_offset=np.searchsorted(frame, np.arange(len(frames) + 1)),
        actors=_observed(record, seen, there, frame, ids, lanes),
        target=np.flatnonzero((present & wanted[:, None])[actor, frames[frame]]),
        signals=_signals(record, frames * LOG_PERIOD_STEPS),
    )
    truth = _points(table, actor[batch.target], frames[frame[batch.target]], future)
    return ScoredSamples(batch, rows.xy_m[truth])


def _row_table(rows: StateRows, ids: Ids) -> Rows:
    """Row of each actor at each frame, −1 if it is absent; shape ``(A, F)``."""
    frame = rows.step // LOG_PERIOD_STEPS
    count = int(frame.max()) + 1 if len(frame) else 0
    table = np.full((len(ids), count), -1, dtype=np.intp)
    table[np.searchsorted(ids, rows.actor_id), frame] = np.arange(len(rows))
    return table


def _present_frames(table: Rows, offsets: npt.NDArray[np.int64]) -> Flags:
    """Where every point of the window around a frame is logged; same shape as the table."""
    count = table.shape[1]
    present = np.zeros(table.shape, dtype=np.bool_)
    first, end = int(-offsets.min()), count - int(offsets.max())
    if first < end:
        present[:, first:end] = True
        for offset in offsets.tolist():
            present[:, first:end] &= table[:, first + offset : end + offset] >= 0
    return present


def _points(table: Rows, actor: Rows, frame: Rows, offsets: npt.NDArray[np.int64]) -> Rows:
    """Rows of the points at offsets within the window, −1 if not logged; ``(len(actor), len(offsets))``."""
    return np.asarray(table[actor[:, None], frame[:, None] + offsets])


def _observed(
    record: EpisodeRecord, rows: StateRows, points: Rows, frame: Rows, ids: Ids, lanes: Indices
) -> ObservedActors:
    observed = points >= 0
    present = rows.select(points[:, -1])
    actors = [record.actors[key] for key in ids.tolist()]
    column = np.searchsorted(ids, present.actor_id)
    velocity = np.stack((rows.vx_mps, rows.vy_mps), axis=-1)
    return ObservedActors(
        frame=frame,
        actor_id=present.actor_id,
        actor_class=np.array([actor.actor_class for actor in actors], dtype=np.uint8)[column],
        is_emv=np.array([actor.is_emv for actor in actors], dtype=np.bool_)[column],
        length_m=np.array([actor.length_m for actor in actors], dtype=np.float64)[column],
        width_m=np.array([actor.width_m for actor in actors], dtype=np.float64)[column],
        lights=present.lights,
        observed=observed,
        xy_m=np.where(observed[..., None], rows.xy_m[points], 0.0),
        velocity_mps=np.where(observed[..., None], velocity[points], 0.0),
        yaw_rad=np.where(observed, rows.yaw_rad[points], 0.0),
        accel_mps2=np.where(observed, rows.accel_mps2[points], 0.0),
        past_sumo_lane=np.where(observed, lanes[points], NO_LANE),
    )


def _signals(record: EpisodeRecord, steps: npt.NDArray[np.int64]) -> dict[str, Codes]:
    """States of all traffic lights at some steps (increasing), as in ``SampleBatch.signals``."""
    letters_of: dict[str, Codes] = {}
    for traffic in record.traffic:
        frame = int(np.searchsorted(steps, traffic.step))
        if frame == len(steps) or steps[frame] != traffic.step:
            continue
        for signal in traffic.signals:
            letters = np.frombuffer(signal.state.encode("ascii"), dtype=np.uint8)
            codes = letters_of.setdefault(signal.signal_id, np.zeros((len(steps), len(letters)), dtype=np.uint8))
            codes[frame] = letters
    return letters_of
