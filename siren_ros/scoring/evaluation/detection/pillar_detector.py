"""The project's learned detector: it sorts points into pillars, loads the network, and turns its output into boxes.

Pillars are the cells of a grid seen from above, the input of the network. After PointPillars (Lang et al. 2019).
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Self

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Flags, Floats, Floats32, Matrix
from siren_ros.base.numerics.compiled import Array, X, Y, Z, compiled
from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.plain_files import open_network
from siren_ros.data.episode_source import lidar_frames, lidar_of, open_source
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.detection.boxes import CLASS_NAMES, FoundBoxes, attributes_of, joined
from siren_ros.scoring.evaluation.detection.frames import EpisodeFrames
from siren_ros.scoring.evaluation.detection.tracking import Tracker
from siren_ros.simulation.scenario.episode import SHIPPED_DETECTOR, SeenEpisodes
from siren_ros.simulation.world.actors import ActorClass

SENSOR_HEIGHT_M: Final = 1.93
"""Height above the ground at which networks expect the LiDAR; sweeps from other heights are shifted to it."""


@dataclass(frozen=True)
class PillarGrid:
    """Grid of pillars in the LiDAR's frame.

    The cell at row 0, column 0 has the smallest x and y; rows count along y.
    """

    half_width_m: float = 51.2
    """Half width of the square of cells; points outside are left out."""
    cells: int = 400
    """Number of cells along x and along y."""
    low_m: float = -5.0
    high_m: float = 3.0
    """Upper limit of height; points below and above the limits are left out."""
    sweeps: int = 10
    """Number of sweeps: the present one and earlier ones, as in nuScenes."""
    points: int = 12
    """Maximum number of points per pillar; of more points, a random sample is used."""
    pillars: int = 40000
    """Maximum number of pillars per frame; pillars with old points only are left out first."""

    @property
    def cell_m(self) -> float:
        """Width of a pillar."""
        return 2.0 * self.half_width_m / self.cells

    def to_json(self) -> dict[str, Any]:
        """The grid as JSON types, for a network's card."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """Reads the message that ``to_json`` makes.

        Raises:
            InputError: A number is missing, unknown or of no use.
        """
        try:
            grid = cls(**values)
            usable = min(grid.half_width_m, grid.cells, grid.sweeps, grid.points, grid.pillars) > 0
            usable = usable and grid.low_m < grid.high_m
        except TypeError as error:
            raise InputError("card", f"grid {dict(values)}", f"the fields {', '.join(asdict(cls()))}") from error
        if not usable:
            raise InputError("card", f"grid {dict(values)}", "numbers above 0, low_m below high_m")
        return grid


def class_of(actor_class: int) -> int:
    """Index into ``CLASS_NAMES`` for a member of ``ActorClass``."""
    name = ActorClass(actor_class).name.lower()
    return CLASS_NAMES.index(name) if name in CLASS_NAMES else 0


COLUMNS: Final = ("x_m", "y_m", "z_m", "intensity", "age_s")
"""Columns of a point, in the LiDAR's frame at the time of the newest sweep."""
FEATURES: Final = ("x", "y", "z", "intensity", "age", "x_mean", "y_mean", "z_mean", "x_middle", "y_middle")
"""Features of a point in a pillar, as in PointPillars: with its offset from the mean of the pillar's points and from
the pillar's middle. Lengths are divided by the grid's half width, heights by 2 m, ages by 0.25 s."""
_HEIGHT_M: Final = 2.0
_AGE_S: Final = 0.25


@dataclass(frozen=True)
class Pillars:
    """The pillars of one frame that contain points: the network's input."""

    points: Floats32
    """Features with columns ``FEATURES``, shape ``(P, grid.points, 10)``. Unused slots repeat the first point, which
    changes no maximum."""
    cell: npt.NDArray[np.int64]
    """Cell of each pillar as ``row * grid.cells + column``, shape ``(P,)``; each cell occurs once."""

    def __len__(self) -> int:
        return len(self.cell)


@dataclass(frozen=True)
class SortedPoints:
    """Points sorted into the slots of their pillars."""

    slots: Floats32
    """Points with columns ``COLUMNS``, shape ``(P, grid.points, 5)``; unused slots are zero."""
    count: npt.NDArray[np.int64]
    """Number of points of each pillar, shape ``(P,)``."""
    cell: npt.NDArray[np.int64]


def pillars_of(points: Floats32, grid: PillarGrid) -> Pillars:
    """The pillars of a frame; arguments are those of ``sorted_points``."""
    held = sorted_points(points, grid)
    features = np.empty((len(held.cell), grid.points, len(FEATURES)), dtype=np.float32)
    _describe(held.slots, held.count, held.cell, grid.cells, grid.cell_m, grid.half_width_m, features)
    return Pillars(features, held.cell)


def sorted_points(points: Floats32, grid: PillarGrid) -> SortedPoints:
    """Sort points into pillars.

    The sample of a pillar with too many points is drawn with a generator that starts the same in every frame. Points
    have shape ``(N, 5)``, columns as in ``COLUMNS``, the newest sweep first.
    """
    most = min(grid.pillars, grid.cells * grid.cells)
    slots = np.zeros((most, grid.points, len(COLUMNS)), dtype=np.float32)
    seen, cell = np.zeros(most, dtype=np.int64), np.zeros(most, dtype=np.int64)
    pillar_of_cell = np.full(grid.cells * grid.cells, -1, dtype=np.int32)
    limits = (grid.half_width_m, 1.0 / grid.cell_m, grid.low_m, grid.high_m)
    filled = _sort(points, limits, grid.cells, pillar_of_cell, slots, seen, cell)
    return SortedPoints(slots[:filled], np.minimum(seen[:filled], grid.points), cell[:filled])


_INTENSITY, _AGE = 3, 4
"""Columns of points after the place."""


@compiled
def _sort(
    points: Array, limits: tuple[float, ...], cells: int, pillar_of_cell: Array, slots: Array, seen: Array, cell: Array
) -> int:
    """Fill the slots of the pillars; returns the number of pillars."""
    half_width_m, cells_per_m, low_m, high_m = limits
    most, filled, state = slots.shape[1], 0, 1
    for row in range(points.shape[0]):
        column = int(np.floor((points[row, X] + half_width_m) * cells_per_m))
        line = int(np.floor((points[row, Y] + half_width_m) * cells_per_m))
        if column < 0 or line < 0 or column >= cells or line >= cells:
            continue
        away = points[row, X] * points[row, X] + points[row, Y] * points[row, Y]
        if not (low_m <= points[row, Z] <= high_m and away <= half_width_m * half_width_m):
            continue
        place = line * cells + column
        pillar = pillar_of_cell[place]
        if pillar < 0:
            if filled == slots.shape[0]:
                continue
            pillar = filled
            pillar_of_cell[place] = pillar
            cell[pillar] = place
            filled += 1
        slot = seen[pillar]
        seen[pillar] += 1
        if slot >= most:
            # Reservoir sampling: every point of the pillar has the same chance to remain.
            state = (state * 1664525 + 1013904223) & 0xFFFFFFFF
            slot = (state * (slot + 1)) >> 32
            if slot >= most:
                continue
        for axis in range(points.shape[1]):
            slots[pillar, slot, axis] = points[row, axis]
    return filled


@compiled
def _describe(
    slots: Array, count: Array, cell: Array, cells: int, cell_m: float, half_width_m: float, features: Array
) -> None:
    """Compute the features of all slots."""
    for pillar in range(slots.shape[0]):
        held = count[pillar]
        mean_x, mean_y, mean_z = 0.0, 0.0, 0.0
        for slot in range(held):
            mean_x += slots[pillar, slot, X]
            mean_y += slots[pillar, slot, Y]
            mean_z += slots[pillar, slot, Z]
        mean_x, mean_y, mean_z = mean_x / held, mean_y / held, mean_z / held
        middle_x = (cell[pillar] % cells + 0.5) * cell_m - half_width_m
        middle_y = (cell[pillar] // cells + 0.5) * cell_m - half_width_m
        for place in range(slots.shape[1]):
            slot = place if place < held else 0
            x, y, z = slots[pillar, slot, X], slots[pillar, slot, Y], slots[pillar, slot, Z]
            row = features[pillar, place]
            row[0], row[1], row[2] = x / half_width_m, y / half_width_m, z / _HEIGHT_M
            row[3], row[4] = slots[pillar, slot, _INTENSITY], slots[pillar, slot, _AGE] / _AGE_S
            row[5], row[6], row[7] = x - mean_x, y - mean_y, z - mean_z
            row[8], row[9] = x - middle_x, y - middle_y


FORM_VERSION: Final = 1
"""Version of the network's inputs and outputs; files of another version are refused."""
INPUTS: Final = ("points", "cell")
OUTPUTS: Final = ("box", "score", "class_share")
BOX_COLUMNS: Final = ("x", "y", "z", "length", "width", "height", "sin", "cos", "vx", "vy")
"""Columns of the network's output ``box``, in the LiDAR's frame: centre of the volume, size, heading, velocity over
ground."""


@dataclass(frozen=True)
class DetectorNetwork:
    """A network that finds boxes, with its card."""

    session: Any
    card: Mapping[str, Any]
    grid: PillarGrid
    class_names: tuple[str, ...]

    def run(self, pillars: Pillars) -> tuple[Floats, Floats, Floats]:
        """Run the network.

        Gives boxes ``(K, 10)``, scores ``(K,)`` and shares of the classes ``(K, C)``, best first.
        """
        if not len(pillars):
            return np.zeros((0, len(BOX_COLUMNS))), np.zeros(0), np.zeros((0, len(self.class_names)))
        box, score, share = self.session.run(OUTPUTS, {"points": pillars.points, "cell": pillars.cell})
        return box.astype(np.float64), score.astype(np.float64), share.astype(np.float64)


def load_detector(path: Path) -> DetectorNetwork:
    """Load a detector, which runs on one processor.

    Raises:
        InputError: No such file, no card, weights that are not the card's, or another form.
    """
    network = open_network(path)
    card, inputs = network.card, network.session.get_inputs()
    if card.get("form_version") != FORM_VERSION or not isinstance(card.get("grid"), dict):
        raise InputError("checkpoint", str(path), f"a detector of form {FORM_VERSION}, not {card.get('form_version')}")
    grid = PillarGrid.from_json(card["grid"])
    if [tensor.name for tensor in inputs] != list(INPUTS) or inputs[0].shape[1:] != [grid.points, len(FEATURES)]:
        raise InputError("checkpoint", str(path), f"inputs {', '.join(INPUTS)} as the card's grid has them")
    return DetectorNetwork(network.session, card, grid, tuple(card["class_names"]))


def seen_in_training(weights: Path | None = None) -> SeenEpisodes | None:
    """Episodes in a detector's training, from its card; ``weights`` as in ``detect_pillars``.

    Raises:
        InputError: The weights cannot be used.
    """
    return SeenEpisodes.of_card(load_detector(weights or detector_file(SHIPPED_DETECTOR)).card)


_OWN_HALF_M: Final = (4.2, 1.35)
"""Half length and half width of a box around the carrier; returns inside it come from the carrier itself."""


@dataclass
class SweepMemory:
    """Stores the last sweeps of one sensor."""

    sweeps: int
    """Number of sweeps, including the newest."""
    _held: list[tuple[int, Floats32, Matrix]] = field(default_factory=list)
    """Step, points and transform of each sweep, the newest first."""

    def add(self, step: int, points: npt.NDArray[np.void], map_from_lidar: Matrix) -> None:
        """Add the sweep of a step. If the step is not later than the last one, earlier sweeps are deleted.

        The points have the fields x, y, z and intensity and are in the LiDAR's frame.
        """
        if self._held and step <= self._held[0][0]:
            self._held.clear()
        columns = [points[name].astype(np.float32) for name in ("x", "y", "z", "intensity")]
        xyzi = np.stack(columns, axis=-1)
        own = (abs(xyzi[:, 0]) < _OWN_HALF_M[0]) & (abs(xyzi[:, 1]) < _OWN_HALF_M[1])
        self._held.insert(0, (step, xyzi[~own], map_from_lidar))
        del self._held[self.sweeps :]

    @property
    def newest(self) -> tuple[int, Matrix] | None:
        """Step and transform ``map_from_lidar`` of the newest sweep; None without a sweep."""
        return self._held[0][::2] if self._held else None

    def points(self) -> Floats32:
        """All points in the frame of the newest sweep, newest first: x, y, z, intensity, age in seconds."""
        if not self._held:
            return np.zeros((0, 5), dtype=np.float32)
        newest_step, _, map_from_newest = self._held[0]
        newest_from_map = np.linalg.inv(map_from_newest)
        parts = []
        for number, (step, xyzi, map_from_lidar) in enumerate(self._held):
            table = np.empty((len(xyzi), 5), dtype=np.float32)
            table[:, :3] = xyzi[:, :3]
            if number:
                moved = newest_from_map @ map_from_lidar
                table[:, :3] = xyzi[:, :3] @ moved[:3, :3].T.astype(np.float32) + moved[:3, 3].astype(np.float32)
            table[:, 3], table[:, 4] = xyzi[:, 3], (newest_step - step) * STEP_S
            parts.append(table)
        return np.concatenate(parts)


SHIPPED: Final = Path("detectors", "pillars.onnx")
"""Place of the shipped weights below the parameter files."""
_LEAST_SCORE: Final = 0.03
_APART_M: Final = 1.8
"""Least distance of two vehicles' centres, the width of a car; of two closer boxes one is dropped."""


def detector_file(name: str) -> Path:
    """ONNX file of a detector: ``pillars`` is the shipped one, other names are paths."""
    return params_dir() / SHIPPED if name == SHIPPED_DETECTOR else Path(name)


@dataclass
class PillarDetector:
    """Finds vehicles in the newest sweep of one LiDAR, with earlier sweeps, and tracks them for velocities."""

    network: DetectorNetwork
    height_m: float = SENSOR_HEIGHT_M
    """Height of the LiDAR above the ground."""
    memory: SweepMemory = field(init=False)
    tracker: Tracker = field(default_factory=Tracker)

    def __post_init__(self) -> None:
        self.memory = SweepMemory(self.network.grid.sweeps)

    def add(self, step: int, points: npt.NDArray[np.void], map_from_lidar: Matrix) -> None:
        """Add the sweep of a step; see ``SweepMemory.add``."""
        if self.memory.newest is not None and step <= self.memory.newest[0]:
            self.tracker = Tracker(step=step)
        self.memory.add(step, points, map_from_lidar)

    def boxes(self) -> FoundBoxes:
        """Vehicles in the newest sweep, in the LiDAR's frame; their frame number is 0."""
        grid, names = self.network.grid, np.array(self.network.class_names)
        points, lift_m = self.memory.points(), self.height_m - SENSOR_HEIGHT_M
        points[:, 2] += np.float32(lift_m)
        table, score, share = self.network.run(pillars_of(points, grid))
        table[:, 2] -= lift_m
        kept = (score >= _LEAST_SCORE) & np.isfinite(table).all(axis=1)
        kept[kept] = apart(table[kept, :2], score[kept], _APART_M)
        table = table[kept]
        velocity = self._velocities(table[:, :3], table[:, 8:10])
        return FoundBoxes(
            frame=np.zeros(len(table), dtype=np.intp),
            centre_m=table[:, :3],
            size_m=table[:, 3:6],
            yaw_rad=np.arctan2(table[:, 6], table[:, 7]),
            velocity_mps=velocity,
            attribute=attributes_of(velocity),
            score=score[kept],
            label=names[share[kept].argmax(axis=1)],
        )

    def _velocities(self, centre_m: Floats, stated_mps: Floats) -> Floats:
        """Velocities from the tracker, which filters those of the network, in the LiDAR's frame."""
        if self.memory.newest is None:
            return stated_mps
        step, map_from_lidar = self.memory.newest
        turn = map_from_lidar[:2, :2]
        place_m = (centre_m @ map_from_lidar[:3, :3].T + map_from_lidar[:3, 3])[:, :2]
        return self.tracker.follow(step, place_m, STEP_S, stated_mps @ turn.T).velocity_mps @ turn


def apart(centre_m: Floats, score: Floats, least_m: float) -> Flags:
    """Keep a box unless one with a higher score is nearer than this distance (CenterPoint's circle NMS)."""
    order = np.argsort(-score, kind="stable")
    stays: Flags = np.zeros(len(score), dtype=np.bool_)
    for row in order:
        away = centre_m[stays] - centre_m[row]
        stays[row] = not (np.hypot(away[:, 0], away[:, 1]) < least_m).any()
    return stays


def detect_pillars(episode: EpisodeFrames, weights: Path | None = None) -> FoundBoxes:
    """Detect vehicles in all labelled sweeps of an episode, in the ``map`` frame.

    The weights are an ONNX file with its card; None stands for those that ship.

    Raises:
        InputError: The weights cannot be used.
        BagError: The bag is damaged.
    """
    network = load_detector(weights or detector_file(SHIPPED_DETECTOR))
    frame_of_step = episode.frame_of_step
    parts = [FoundBoxes.none()]
    with open_source(Path(episode.bag)) as source:
        base_from_lidar = lidar_of(source).base_from_sensor
        detector = PillarDetector(network, float(base_from_lidar[2, 3]))
        for frame in lidar_frames(source, pose=True):
            if frame.points is None or frame.map_from_base is None:
                continue
            map_from_lidar = frame.map_from_base @ base_from_lidar
            detector.add(frame.step, frame.points, map_from_lidar)
            if frame.step in frame_of_step:
                parts.append(_in_map(frame_of_step[frame.step], detector.boxes(), map_from_lidar))
    return joined(parts)


def _in_map(frame: int, boxes: FoundBoxes, map_from_lidar: Matrix) -> FoundBoxes:
    turn, shift = map_from_lidar[:3, :3], map_from_lidar[:3, 3]
    return replace(
        boxes,
        frame=np.full(len(boxes), frame, dtype=np.intp),
        centre_m=boxes.centre_m @ turn.T + shift,
        yaw_rad=boxes.yaw_rad + np.arctan2(turn[1, 0], turn[0, 0]),
        velocity_mps=boxes.velocity_mps @ turn[:2, :2].T,
    )
