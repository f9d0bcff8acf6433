"""HOTA, a tracking score: how well tracks find vehicles and keep their ids, averaged over thresholds of a match.

Source: J. Luiten et al., "HOTA: A Higher Order Metric for Evaluating Multi-Object Tracking", IJCV 129 (2021) 548. The
similarity of two places is that of TrackEval for points: 1 at the same place, 0 from 2 m on, which is also nuScenes'
limit for tracks. ``test_tracking.py`` compares with TrackEval's own code, which cannot be a dependency: on Python
3.12 it needs numpy 2, and nuscenes-devkit needs numpy 1.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from siren_ros.base.numerics.arrays import Flags, Floats, Rows

ZERO_M: Final = 2.0
ALPHAS: Final = np.arange(0.05, 0.99, 0.05)
"""Similarity thresholds of a match."""
_TINY: Final = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class TrackTable:
    """Boxes of tracks, one row each, sorted by frame. Arrays have shape ``(N,)``."""

    episode: Rows
    frame: Rows
    """Number of the frame, counted over all episodes."""
    centre_m: Floats
    """Centre on the ground, shape ``(N, 2)``."""
    track: Rows
    """Number of the track, unique over all episodes."""
    score: Floats
    """Confidence of the track, equal in all of its rows; -1 for labels, as in nuScenes."""

    def at(self, rows: Rows | Flags) -> "TrackTable":
        """Select some of the rows."""
        return TrackTable(self.episode[rows], self.frame[rows], self.centre_m[rows], self.track[rows], self.score[rows])


class Hota(NamedTuple):
    """HOTA and its parts, as means over ``ALPHAS``; NaN without labels and tracks."""

    hota: float
    detection: float
    """DetA: found vehicles divided by all vehicles and false alarms."""
    association: float
    """AssA: common share of the two tracks of a match, as a mean."""


@dataclass(frozen=True)
class HotaSums:
    """Sums per episode from which HOTA follows, shape ``(E, 19)``; columns as ``ALPHAS``."""

    hits: Floats
    misses: Floats
    alarms: Floats
    common: Floats
    """Sum over all hits of the common share of their two tracks."""

    def of(self, weight: Floats) -> Hota:
        """HOTA of the episodes with weights, shape ``(E,)``."""
        hits, misses, alarms, common = (weight @ part for part in (self.hits, self.misses, self.alarms, self.common))
        every = hits + misses + alarms
        if not every.any():
            return Hota(np.nan, np.nan, np.nan)
        detection, association = hits / np.maximum(every, 1.0), common / np.maximum(hits, 1.0)
        shares = np.sqrt(detection * association), detection, association
        return Hota(*(float(share.mean()) for share in shares))


def hota_sums(labels: TrackTable, found: TrackTable, episodes: int) -> HotaSums:
    """Compute the sums for HOTA per episode; labels and tracks have the same frames."""
    parts = [_of_episode(labels.at(labels.episode == one), found.at(found.episode == one)) for one in range(episodes)]
    return HotaSums(*(np.array(column).reshape(-1, len(ALPHAS)) for column in zip(*parts, strict=True)))


def _of_episode(labels: TrackTable, found: TrackTable) -> tuple[Floats, Floats, Floats, Floats]:
    (truths, truth), (tracks, track) = (np.unique(table.track, return_inverse=True) for table in (labels, found))
    frames = np.union1d(labels.frame, found.frame)
    edges = np.r_[frames, np.inf]
    here = [
        [slice(*np.searchsorted(table.frame, pair).tolist()) for pair in pairwise(edges)] for table in (labels, found)
    ]
    alike = [_similarity(labels.centre_m[one], found.centre_m[other]) for one, other in zip(*here, strict=True)]
    overlap = np.zeros((len(truths), len(tracks)))
    for one, other, values in zip(*here, alike, strict=True):
        whole = values.sum(axis=0)[None] + values.sum(axis=1)[:, None] - values
        overlap[np.ix_(truth[one], track[other])] += np.where(whole > _TINY, values / np.maximum(whole, _TINY), 0.0)
    boxes = np.bincount(truth, minlength=len(truths))[:, None] + np.bincount(track, minlength=len(tracks))[None]
    alignment = overlap / np.maximum(boxes - overlap, _TINY)
    matches = np.zeros((len(ALPHAS), len(truths), len(tracks)))
    for one, other, values in zip(*here, alike, strict=True):
        row, column = linear_sum_assignment(-alignment[np.ix_(truth[one], track[other])] * values)
        for number, alpha in enumerate(ALPHAS):
            near = values[row, column] >= alpha - _TINY
            matches[number, truth[one][row[near]], track[other][column[near]]] += 1.0
    hits = matches.sum(axis=(1, 2))
    common = (matches * matches / np.maximum(boxes - matches, 1.0)).sum(axis=(1, 2))
    return hits, len(truth) - hits, len(track) - hits, common


def _similarity(first_m: Floats, second_m: Floats) -> Floats:
    way = first_m[:, None] - second_m[None]
    return np.maximum(0.0, 1.0 - np.hypot(way[..., 0], way[..., 1]) / ZERO_M)
