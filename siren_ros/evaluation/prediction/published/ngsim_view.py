"""A batch as the loaders of NGSIM show it: each sample in a frame of its own, its neighbours in a social grid."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from siren_ros.datasets.ngsim.grid import CELLS, OUTSIDE, neighbour_cells
from siren_ros.datasets.ngsim.road_frame import across_and_ahead, from_across_and_ahead, lane_widths_m, road_places
from siren_ros.evaluation.prediction.protocol.samples import ObservedActors, SampleBatch
from siren_ros.numerics.arrays import Floats, Rows
from siren_ros.roads.road_network import RoadNetwork


@dataclass(frozen=True)
class NgsimView:
    """B samples of a batch and their P neighbours, which are sorted by sample and then by cell."""

    network: RoadNetwork
    actors: ObservedActors
    target: Rows
    """Row of ``actors`` of each sample, shape ``(B,)``."""
    tangent_rad: Floats
    """The direction +y of each sample in the frame ``map``: of the target's lane at the present, off the lanes its
    heading; shape ``(B,)``."""
    sample: Rows
    """Sample of each neighbour, shape ``(P,)``."""
    neighbour: Rows
    """Row of ``actors`` of each neighbour, shape ``(P,)``."""
    cell: Rows
    """Cell of each neighbour, 0 to 38, shape ``(P,)``."""

    def __len__(self) -> int:
        return len(self.target)

    @property
    def scene(self) -> Rows:
        """The samples of one frame are a scene: its number for each sample, from 0 upwards, shape ``(B,)``."""
        frame = self.actors.frame[self.target]
        return np.cumsum(np.diff(frame, prepend=frame[:1]) > 0)

    def parts(self, size: int) -> Iterator["NgsimView"]:
        """Consecutive parts of whole scenes, of at least ``size`` samples but for the last."""
        scene = self.scene
        first = 0
        while first < len(self):
            last = int(np.searchsorted(scene, scene[min(first + size, len(self)) - 1], side="right"))
            start, end = np.searchsorted(self.sample, [first, last])
            yield NgsimView(
                self.network,
                self.actors,
                self.target[first:last],
                self.tangent_rad[first:last],
                self.sample[start:end] - first,
                self.neighbour[start:end],
                self.cell[start:end],
            )
            first = last

    def right_ahead_m(self, row: Rows, sample: Rows) -> Floats:
        """Past positions of actors in the frames of samples: metres to the right and ahead; ``(len(row), 16, 2)``."""
        origin = self.actors.xy_m[self.target[sample], -1]
        x_m, y_m = np.moveaxis(self.actors.xy_m[row] - origin[:, None], -1, 0)
        # The sum turns −0 into 0: the direction of the origin, seen from itself, must not depend on the sign.
        return np.stack(across_and_ahead(x_m, y_m, self.tangent_rad[sample, None]), axis=-1) + 0.0

    def on_map(self, right_ahead_m: Floats) -> Floats:
        """Places of the samples in the frame ``map``.

        Args:
            right_ahead_m: Metres to the right and ahead of each target's present, shape ``(B, …, 2)``.
        """
        ones = (1,) * (right_ahead_m.ndim - 2)
        tangent = self.tangent_rad.reshape(-1, *ones)
        x_m, y_m = from_across_and_ahead(right_ahead_m[..., 0], right_ahead_m[..., 1], tangent)
        return np.stack((x_m, y_m), axis=-1) + self.actors.xy_m[self.target, -1].reshape(-1, *ones, 2)


def ngsim_view(batch: SampleBatch) -> NgsimView:
    """The view of a batch.

    A neighbour drives in the direction of the target's lane and was observed at every point of the past. Where two are
    in one cell, the later actor counts, as in the published loaders.
    """
    actors, target = batch.actors, batch.target
    road = road_places(batch.network, batch.xy_m, batch.yaw_rad, actors.sumo_lane[target])
    sample, other = batch.neighbours()
    x_m, y_m = (actors.xy_m[other, -1] - batch.xy_m[sample]).T
    cell = neighbour_cells(
        *across_and_ahead(x_m, y_m, road.tangent_rad[sample]),
        actors.yaw_rad[other, -1] - road.tangent_rad[sample],
        lane_widths_m(batch.network, road.lane)[sample],
    )
    seen = np.flatnonzero((cell != OUTSIDE) & actors.observed[other].all(axis=1))
    place = sample[seen] * CELLS + cell[seen]
    _, from_the_end = np.unique(place[::-1], return_index=True)
    kept = seen[::-1][from_the_end]
    return NgsimView(batch.network, actors, target, road.tangent_rad, sample[kept], other[kept], cell[kept])
