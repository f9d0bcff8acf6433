"""Makes predictors of CSP, STDAN and BAT, with their inputs: local frames and NGSIM's social grid of neighbours.

Published weights are loaded without running anything that is in the file, and are held against the network.

Inputs: values are in feet and seconds, 16 points of the past first, in single precision.

BAT's behaviour tensor has closeness centralities of a graph over the cells, as the published loader computes them. The
weights were trained on it as it is, so it is reproduced with what is peculiar about it:

* Positions are polar, and distances between them are taken as if they were Cartesian. Empty cells are at the origin.
* Cell 20 holds the target, and hides a neighbour there.
* Positions are listed by cell and then by time, and read as if they were listed by time and then by cell. A graph
  therefore joins the paths of two or three cells instead of all cells at one time.
* Closeness stands for all three centralities (degree, closeness, eigenvector). Their changes are zero but for that
  of closeness, which runs over the vertices of a graph, not over time, and whose axes are mixed up by another reshape.

The published loader computes the 16 graphs of a sample in threads and takes them in the order in which they finish.
Here they are in order.
"""

import pickle
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import torch
from torch import Tensor, nn

from siren_ros.base.numerics.arrays import Floats, Floats32, Rows
from siren_ros.base.numerics.compiled import Array, X, Y, compiled
from siren_ros.data.datasets.trajectory_tables import (
    CELLS,
    FOOT_M,
    OUTSIDE,
    across_and_ahead,
    from_across_and_ahead,
    lane_widths_m,
    neighbour_cells,
    road_places,
    vehicle_class,
)
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.published.networks import (
    Bat,
    BatInput,
    Csp,
    Neighbours,
    NetworkInput,
    Stdan,
    mode_probabilities,
)
from siren_ros.scoring.evaluation.prediction.samples import FUTURE_POINTS, HistoryWindow, ObservedActors, SampleBatch
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import ActorClass


@dataclass(frozen=True)
class NgsimView:
    """B samples of a batch and their P neighbours, which are sorted by sample and then by cell."""

    network: RoadNetwork
    actors: ObservedActors
    target: Rows
    """Row of each sample in ``actors``, shape ``(B,)``."""
    tangent_rad: Floats
    """Direction of each sample's +y axis in the frame ``map``, shape ``(B,)``: that of the target's present lane, or
    off the lanes its heading."""
    sample: Rows
    """Sample to which each neighbour belongs, shape ``(P,)``."""
    neighbour: Rows
    """Row of each neighbour in ``actors``, shape ``(P,)``."""
    cell: Rows
    """Grid cell of each neighbour, 0 to 38, shape ``(P,)``."""

    def __len__(self) -> int:
        return len(self.target)

    @property
    def scene(self) -> Rows:
        """Scene of each sample, counted from 0, shape ``(B,)``; the samples of one frame form a scene."""
        frame = self.actors.frame[self.target]
        return np.cumsum(np.diff(frame, prepend=frame[:1]) > 0)

    def parts(self, size: int) -> Iterator["NgsimView"]:
        """Split the view into consecutive parts of whole scenes, each with ``size`` samples or more except the last."""
        scene = self.scene
        first = 0
        while first < len(self):
            last = int(np.searchsorted(scene, scene[min(first + size, len(self)) - 1], side="right"))
            pairs = slice(*np.searchsorted(self.sample, [first, last]))
            targets = self.target[first:last], self.tangent_rad[first:last]
            neighbours = self.sample[pairs] - first, self.neighbour[pairs], self.cell[pairs]
            yield NgsimView(self.network, self.actors, *targets, *neighbours)
            first = last

    def right_ahead_m(self, row: Rows, sample: Rows) -> Floats:
        """Past positions of actors in the samples' frames: metres to the right and ahead; ``(len(row), 16, 2)``."""
        origin = self.actors.xy_m[self.target[sample], -1]
        x_m, y_m = np.moveaxis(self.actors.xy_m[row] - origin[:, None], -1, 0)
        # Adding 0.0 turns −0 into 0: the angle of the origin, seen from itself, must not depend on the sign.
        return np.stack(across_and_ahead(x_m, y_m, self.tangent_rad[sample, None]), axis=-1) + 0.0

    def on_map(self, right_ahead_m: Floats) -> Floats:
        """Convert positions of the samples' frames to the frame ``map``.

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
    tangent_rad, width_m = road.tangent_rad[sample], lane_widths_m(batch.network, road.lane)[sample]
    place_m = across_and_ahead(x_m, y_m, tangent_rad)
    cell = neighbour_cells(*place_m, actors.yaw_rad[other, -1] - tangent_rad, width_m)
    seen = np.flatnonzero((cell != OUTSIDE) & actors.observed[other].all(axis=1))
    place = sample[seen] * CELLS + cell[seen]
    _, from_the_end = np.unique(place[::-1], return_index=True)
    kept = seen[::-1][from_the_end]
    return NgsimView(batch.network, actors, target, road.tangent_rad, sample[kept], other[kept], cell[kept])


_CLASSES = np.array([vehicle_class(actor_class) for actor_class in ActorClass], dtype=np.float64)
Features = tuple[Floats32, Floats32]
"""Features by point and vehicle: of the targets ``(16, B, F)``, and of their neighbours ``(16, P, F)``."""


def csp_features(view: NgsimView) -> Features:
    """Features of CSP: positions x and y."""
    targets, neighbours = positions_ft(view)
    return _time_first(targets), _time_first(neighbours)


def stdan_features(view: NgsimView) -> Features:
    """Features of STDAN: position, class, speed, acceleration."""
    columns = zip(positions_ft(view), _class_and_motion(view), strict=True)
    targets, neighbours = (_time_first(*vehicles) for vehicles in columns)
    return targets, neighbours


def bat_features(view: NgsimView) -> Features:
    """Features of BAT: polar position, displacement since the last point, class, speed, acceleration, lane."""
    columns = zip(positions_ft(view), _class_and_motion(view), _lane_numbers(view), strict=True)
    targets, neighbours = (
        _time_first(polar(positions), np.diff(positions, axis=1, prepend=positions[:, :1]), motion, lanes)
        for positions, motion, lanes in columns
    )
    return targets, neighbours


def positions_ft(view: NgsimView) -> tuple[Floats, Floats]:
    """Past positions of targets ``(B, 16, 2)`` and of neighbours ``(P, 16, 2)``: feet to the right and ahead."""
    targets_m = view.right_ahead_m(view.target, np.arange(len(view)))
    return targets_m / FOOT_M, view.right_ahead_m(view.neighbour, view.sample) / FOOT_M


def polar(xy: Floats) -> Floats:
    """Convert to polar coordinates: distance, and angle from +x towards +y; shape ``(…, 2)``."""
    return np.stack((np.hypot(xy[..., 0], xy[..., 1]), np.arctan2(xy[..., 1], xy[..., 0])), axis=-1)


def from_polar(polar_xy: Floats) -> Floats:
    """Reads the message that ``polar`` makes."""
    r, phi = polar_xy[..., 0], polar_xy[..., 1]
    return np.stack((r * np.cos(phi), r * np.sin(phi)), axis=-1)


def _class_and_motion(view: NgsimView) -> tuple[Floats, Floats]:
    """Class (by NGSIM), speed and acceleration, shapes ``(B, 16, 3)`` and ``(P, 16, 3)``."""
    actors = view.actors

    def of(rows: Rows) -> Floats:
        speed = np.hypot(actors.velocity_mps[rows, :, 0], actors.velocity_mps[rows, :, 1]) / FOOT_M
        kind = np.broadcast_to(_CLASSES[actors.actor_class[rows], None], speed.shape)
        return np.stack((kind, speed, actors.accel_mps2[rows] / FOOT_M), axis=-1)

    return of(view.target), of(view.neighbour)


def _lane_numbers(view: NgsimView) -> tuple[Floats, Floats]:
    """Numbers of the lanes of all points, shapes ``(B, 16, 1)`` and ``(P, 16, 1)``; 0 off the lanes."""
    actors = view.actors
    rows = np.unique(np.concatenate((view.target, view.neighbour)))
    # The pasts of a vehicle overlap between frames, so each pose is located only once.
    columns = actors.xy_m[rows].reshape(-1, 2), actors.yaw_rad[rows].ravel(), actors.past_sumo_lane[rows].ravel()
    poses = np.column_stack(columns)
    different, same = np.unique(poses, axis=0, return_inverse=True)
    road = road_places(view.network, different[:, :2], different[:, 2], different[:, 3].astype(np.int32))
    numbers = road.lane_number[same].reshape(len(rows), -1, 1).astype(np.float64)
    return numbers[np.searchsorted(rows, view.target)], numbers[np.searchsorted(rows, view.neighbour)]


def _time_first(*columns: Floats) -> Floats32:
    return np.ascontiguousarray(np.concatenate(columns, axis=-1).swapaxes(0, 1), dtype=np.float32)


_POINTS: Final = 16
_TARGET_CELL: Final = 20
_JOINED_FT: Final = float(np.log(200.0))
"""Distance below which vertices are joined: exp(−distance) above 0.005 does not round to 0.00."""


def behaviour_tensor(targets: Floats, neighbours: Floats, sample: Rows, cell: Rows) -> Floats32:
    """Compute BAT's behaviour tensor, shape ``(16, B, 39, 6)``.

    Args:
        targets: Polar past of the targets (feet, radians), shape ``(B, 16, 2)``.
        neighbours: Polar past of their neighbours, shape ``(P, 16, 2)``.
        sample: Sample of each neighbour, shape ``(P,)``.
        cell: Cell of each neighbour, shape ``(P,)``.
    """
    grid = np.zeros((len(targets), CELLS, _POINTS, 2))
    grid[sample, cell] = neighbours
    grid[:, _TARGET_CELL] = targets
    return behaviours(closeness_centralities(np.round(grid, 2).reshape(len(targets), _POINTS, CELLS, 2)))


def behaviours(closeness: Floats) -> Floats32:
    """Behaviour tensor ``(16, B, 39, 6)`` from closeness centralities ``(B, 16, 39)``."""
    change = np.zeros_like(closeness)
    change[..., :-1] = np.diff(closeness, axis=-1)
    mixed = np.round(change, 2).swapaxes(1, 2).reshape(closeness.shape)
    behaviour = np.zeros((_POINTS, len(closeness), CELLS, 6), dtype=np.float32)
    behaviour[..., 1] = mixed.swapaxes(0, 1)
    behaviour[..., 3:] = np.round(closeness, 2).swapaxes(0, 1)[..., None]
    return behaviour


def closeness_centralities(points: Floats) -> Floats:
    """Closeness centrality of every vertex, scaled for graphs that are not connected.

    (S. Wasserman, K. Faust, "Social Network Analysis", 1994, p. 201.) Edges join points that are near each other.

    Args:
        points: Vertices of B × G graphs, at most 64 each, shape ``(B, G, V, 2)``.

    Returns:
        Shape ``(B, G, V)``.
    """
    vertices = points.shape[2]
    graphs = np.ascontiguousarray(points).reshape(-1, vertices, 2)
    return _closeness(graphs, _JOINED_FT**2).reshape(points.shape[:3])


@compiled
def _closeness(graphs: Array, joined_squared: float) -> Array:
    count, vertices = graphs.shape[0], graphs.shape[1]
    closeness = np.zeros((count, vertices))
    joined = np.zeros(vertices, dtype=np.uint64)
    bit = np.uint64(1)
    for graph in range(count):
        for i in range(vertices):
            joined[i] = bit << np.uint64(i)
            for j in range(i):
                dx = graphs[graph, i, X] - graphs[graph, j, X]
                dy = graphs[graph, i, Y] - graphs[graph, j, Y]
                if dx * dx + dy * dy < joined_squared:
                    joined[i] |= bit << np.uint64(j)
                    joined[j] |= bit << np.uint64(i)
        for start in range(vertices):
            closeness[graph, start] = _closeness_of(joined, start)
    return closeness


@compiled
def _closeness_of(joined: Array, start: int) -> float:
    """Closeness of one vertex by breadth-first search; the bits of a number are a set of vertices."""
    vertices = len(joined)
    bit, none = np.uint64(1), np.uint64(0)
    reached = bit << np.uint64(start)
    frontier = reached
    hops, others, total = 0, 0, 0
    while frontier != none:
        following = none
        for vertex in range(vertices):
            if (frontier >> np.uint64(vertex)) & bit:
                following |= joined[vertex]
        frontier = following & ~reached
        reached |= frontier
        hops += 1
        rest = frontier
        while rest != none:
            rest &= rest - bit
            others += 1
            total += hops
    return others / total * (others / (vertices - 1)) if total else 0.0


_UNREADABLE: Final = (RuntimeError, ValueError, KeyError, IndexError, AttributeError, TypeError, EOFError, ImportError)
"""Errors that torch raises for damaged or foreign files."""
_RENAMED: Final = {"soc_conv_3x1.": "conv_3x1."}
"""Name of a layer of CSP in another published repository, and its name here."""


def load_weights(network: nn.Module, model: str, path: Path | None) -> nn.Module:
    """Load weights from a file into a network, and set it to prediction mode.

    The file holds a state dict, alone or under ``state_dict``, or one for each part of the network by the part's name.
    Where the authors published a file for each part (``epoch9_gd.tar`` and ``epoch9_g.tar``), the path is that of one
    and the others lie next to it.

    Raises:
        InputError: There is no file, or it cannot be read, holds code, or is not of this model; with counts and the
            first offender.
    """
    if path is None:
        raise InputError("checkpoint", model, f"{model}=PATH of its weights")
    given, expected = _with_parts(network, path), network.state_dict()
    missing = [name for name in expected if name not in given]
    unknown = [name for name in given if name not in expected]
    reshaped = [name for name in expected if name in given and given[name].shape != expected[name].shape]
    wrong = []
    if missing:
        wrong.append(f"{len(missing)} of {len(expected)} missing, first {missing[0]}")
    if reshaped:
        first = reshaped[0]
        shapes = f"{tuple(given[first].shape)} instead of {tuple(expected[first].shape)}"
        wrong.append(f"{len(reshaped)} of another shape, first {first}: {shapes}")
    if unknown:
        wrong.append(f"{len(unknown)} unknown, first {unknown[0]}")
    if wrong:
        raise InputError("checkpoint", str(path), f"weights of {model} ({'; '.join(wrong)})")
    infinite = [name for name in expected if not bool(torch.isfinite(given[name]).all())]
    if infinite:
        what = f"finite weights ({len(infinite)} of {len(expected)} are not, first {infinite[0]})"
        raise InputError("checkpoint", str(path), what)
    network.load_state_dict(given)
    network.eval()
    return network


def _with_parts(network: nn.Module, path: Path) -> dict[str, Tensor]:
    """All weights of all parts of the network, by name."""
    parts = [name for name, _ in network.named_children()]
    content = _read(path)
    of_path = next((part for part in parts if path.stem.endswith(f"_{part}")), None)
    if of_path is not None and not any(name in parts for name in content):
        prefix = path.stem.removesuffix(of_path)
        content = {part: _read(path.with_name(f"{prefix}{part}{path.suffix}")) for part in parts}
    return _flat(content, str(path))


def _read(path: Path) -> Mapping[str, Any]:
    try:
        with warnings.catch_warnings():
            # torch warns about some files; the checks below refuse what is wrong
            warnings.simplefilter("ignore")
            content = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as error:
        raise InputError("checkpoint", str(path), f"a file that can be read ({error.strerror or error})") from error
    except pickle.UnpicklingError as error:
        raise InputError("checkpoint", str(path), "weights alone; the file holds code or is none of torch's") from error
    except _UNREADABLE as error:
        raise InputError("checkpoint", str(path), f"weights that torch saved ({type(error).__name__})") from error
    if isinstance(content, Mapping) and "state_dict" in content:
        content = content["state_dict"]
    if not isinstance(content, Mapping):
        raise InputError("checkpoint", str(path), f"a state dict, not {type(content).__name__}")
    return content


def _flat(content: Mapping[str, Any], path: str, prefix: str = "") -> dict[str, Tensor]:
    weights: dict[str, Tensor] = {}
    for name, value in content.items():
        full = f"{prefix}{name}"
        if isinstance(value, Mapping):
            weights.update(_flat(value, path, f"{full}."))
        elif isinstance(value, Tensor):
            for old, new in _RENAMED.items():
                full = full.replace(old, new)
            weights[full] = value
        else:
            raise InputError("checkpoint", path, f"tensors alone; {full} is of type {type(value).__name__}")
    return weights


MOST_SAMPLES: Final = 1024
"""Number of samples that a network processes at once."""
Answer = tuple[Floats, Floats]
"""Answer of a network: feet to the right and ahead by sample, mode and point, ``(B, k, 25, 2)``, and probabilities of
the modes, ``(B, k)``."""


@dataclass(frozen=True)
class PublishedPredictor:
    """Wraps a published network as a predictor: views of batches go in, hypotheses on the map come out."""

    answer: Callable[[NgsimView], Answer]
    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        """Give one hypothesis per mode."""
        answers = [self._part(part) for part in ngsim_view(batch).parts(MOST_SAMPLES)]
        if not answers:
            return Hypotheses.certain(np.zeros((0, FUTURE_POINTS, 2)))
        return Hypotheses.ranked(*(np.concatenate(arrays) for arrays in zip(*answers, strict=True)))

    def _part(self, view: NgsimView) -> Answer:
        with torch.inference_mode():
            right_ahead_ft, probability = self.answer(view)
        return view.on_map(right_ahead_ft * FOOT_M), probability


def make_csp(checkpoint: Path | None) -> PublishedPredictor:
    """CSP with six modes."""
    network = load_weights(Csp(), "csp", checkpoint)

    def answer(view: NgsimView) -> Answer:
        modes, lateral, longitudinal = network(NetworkInput(*_tensors(csp_features(view), view)))
        return _by_sample(modes), mode_probabilities(lateral, longitudinal).double().numpy()

    return PublishedPredictor(answer)


def make_stdan(checkpoint: Path | None) -> PublishedPredictor:
    """STDAN; its recognised manoeuvres give its single hypothesis."""
    network = load_weights(Stdan(), "stdan", checkpoint)

    def answer(view: NgsimView) -> Answer:
        path, _, _ = network(NetworkInput(*_tensors(stdan_features(view), view)))
        return _by_sample(path[None]), np.ones((len(view), 1))

    return PublishedPredictor(answer)


def make_bat(checkpoint: Path | None) -> PublishedPredictor:
    """BAT with nine modes; the vehicles of a frame form a scene."""
    network = load_weights(Bat(), "bat", checkpoint)

    def answer(view: NgsimView) -> Answer:
        targets, others = (polar(positions) for positions in positions_ft(view))
        behaviour = torch.from_numpy(behaviour_tensor(targets, others, view.sample, view.cell))
        given = BatInput(*_tensors(bat_features(view), view), behaviour, torch.from_numpy(view.scene))
        modes, lateral, longitudinal = network(given)
        return from_polar(_by_sample(modes)), mode_probabilities(lateral, longitudinal).double().numpy()

    return PublishedPredictor(answer)


def _tensors(features: Features, view: NgsimView) -> tuple[Tensor, Tensor, Neighbours]:
    """Convert features to the parts of ``NetworkInput``."""
    targets, neighbours = (torch.from_numpy(values) for values in features)
    return targets, neighbours, Neighbours(torch.from_numpy(view.sample), torch.from_numpy(view.cell), len(view))


def _by_sample(modes: Tensor) -> Floats:
    """Rearrange means ``(k, 25, B, 5)`` as ``(B, k, 25, 2)``."""
    return modes[..., :2].permute(2, 0, 1, 3).double().numpy()
