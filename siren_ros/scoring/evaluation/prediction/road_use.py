"""Checks whether predicted paths stay on the road and follow its direction, with a raster of the road network."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt
from matplotlib.path import Path as Outline

from siren_ros.base.numerics.arrays import Codes, Flags, Floats
from siren_ros.base.numerics.geometry import wrap_angle
from siren_ros.data.record.vehicle_location import DRIVEN_KINDS
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import ScoredSamples
from siren_ros.simulation.roads.road_network import MAPS_KEPT, LaneKind, RoadNetwork

CELL_M: Final = 0.5
"""Cell size of the raster; places up to one cell outside the road count as on it."""
_SPACING_M: Final = 0.4
_SECTORS: Final = 8
_STILL_M: Final = 0.1
"""A segment of a path that is shorter than this has no direction."""


@dataclass(frozen=True)
class RoadRaster:
    """The road as cells: where it is, and which driving directions are allowed."""

    low_m: Floats
    """Lower corner of the first cell, shape ``(2,)``."""
    road: Flags
    """Whether a cell is on lanes, shoulders or junctions, shape ``(X, Y)``."""
    directions: Codes
    """Allowed directions: bit k means that a lane's heading is within 90° of k · 45°; all bits in junctions, 0 off the
    lanes. Shape ``(X, Y)``."""

    def cells(self, xy_m: Floats) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        """Cells of positions with shape ``(…, 2)``.

        Positions outside the raster get a border cell, which is not road.
        """
        at = np.floor((xy_m - self.low_m) / CELL_M).astype(np.intp)
        return np.clip(at[..., 0], 0, self.road.shape[0] - 1), np.clip(at[..., 1], 0, self.road.shape[1] - 1)


@lru_cache(maxsize=MAPS_KEPT)
def road_raster(network: RoadNetwork) -> RoadRaster | None:
    """The raster of a map; None for a map without lanes."""
    lanes = [lane for lane in network.lanes if lane.kind in DRIVEN_KINDS]
    if not lanes:
        return None
    outlines = [junction.outline for junction in network.junctions.values() if len(junction.outline) > 2]
    corners = np.concatenate([lane.centre.points for lane in lanes] + outlines)
    low, high = corners.min(axis=0) - 20.0, corners.max(axis=0) + 20.0
    size = np.ceil((high - low) / CELL_M).astype(np.intp) + 1
    raster = RoadRaster(low, np.zeros(size, dtype=np.bool_), np.zeros(size, dtype=np.uint8))
    for lane in lanes:
        arc = np.linspace(0.0, lane.length_m, max(int(lane.length_m / _SPACING_M), 1) + 1)[:, None]
        aside = np.linspace(-0.5, 0.5, max(int(lane.width_m / _SPACING_M), 1) + 1)[None] * lane.width_m
        arc, aside = np.broadcast_arrays(arc, aside)
        at = raster.cells(lane.centre.offset_points(arc, aside))
        raster.road[at] = True
        bits = 255 if lane.kind is LaneKind.INTERNAL else _bits(lane.centre.heading_rad(arc))
        np.bitwise_or.at(raster.directions, at, bits)
    for outline in outlines:
        first, last = raster.cells(np.stack((outline.min(axis=0), outline.max(axis=0))))
        x, y = np.meshgrid(np.arange(first[0], first[1] + 1), np.arange(last[0], last[1] + 1), indexing="ij")
        middles = low + (np.stack((x, y), axis=-1) + 0.5) * CELL_M
        inside = Outline(outline).contains_points(middles.reshape(-1, 2)).reshape(x.shape)
        raster.road[x[inside], y[inside]] = True
        raster.directions[x[inside], y[inside]] = 255
    return RoadRaster(low, _grown(raster.road), raster.directions)


def _bits(heading_rad: Floats) -> Codes:
    sectors = 2.0 * np.pi / _SECTORS * np.arange(_SECTORS)
    near = np.abs(wrap_angle(heading_rad[..., None] - sectors)) <= 0.5 * np.pi + 1e-9
    return np.asarray((near * 2 ** np.arange(_SECTORS)).sum(axis=-1), dtype=np.uint8)


def _grown(cells: Flags) -> Flags:
    """Extend an area of cells by one cell on all sides."""
    grown = cells.copy()
    for axis in (0, 1):
        for shift in (-1, 1):
            grown |= np.roll(cells, shift, axis)
    return grown


def off_road(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """1 where the most probable path's centre leaves lanes, shoulders and junctions, else 0; shape ``(N,)``.

    NaN where it is not on the road at the present.
    """
    raster = road_raster(samples.batch.network)
    if raster is None:
        return np.full(len(hypotheses), np.nan)
    leaves = ~raster.road[raster.cells(hypotheses.xy_m[:, 0])].all(axis=1)
    return np.where(raster.road[raster.cells(samples.batch.xy_m)], leaves, np.nan)


def wrong_way(hypotheses: Hypotheses, samples: ScoredSamples) -> Floats:
    """1 where the most probable path differs by more than 90° from all lanes at a place, else 0; shape ``(N,)``.

    Junctions have no wrong way. NaN where the vehicle itself stands against its lane at the present, as while it passes
    on the other side.
    """
    batch = samples.batch
    raster = road_raster(batch.network)
    if raster is None:
        return np.full(len(hypotheses), np.nan)
    path = hypotheses.xy_m[:, 0]
    legs = np.diff(np.concatenate((batch.xy_m[:, None], path), axis=1), axis=1)
    moves = np.hypot(legs[..., 0], legs[..., 1]) > _STILL_M
    against = moves & _against(raster, path, np.arctan2(legs[..., 1], legs[..., 0]))
    return np.where(_against(raster, batch.xy_m, batch.yaw_rad), np.nan, against.any(axis=1))


def _against(raster: RoadRaster, xy_m: Floats, heading_rad: Floats) -> Flags:
    allowed = raster.directions[raster.cells(xy_m)]
    sector = np.round(heading_rad / (2.0 * np.pi / _SECTORS)).astype(np.int64) % _SECTORS
    return np.asarray((allowed > 0) & (allowed >> sector & 1 == 0))
