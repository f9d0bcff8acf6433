"""Data of an episode's page as columns of whole numbers in few bytes, for the page's script to read.

A file is the length of its head, the head as JSON, and the columns, all through zlib. A column holds differences of
neighbours, once or twice, as numbers of 32 or 16 bits that wrap around. Its bytes are sorted by significance: what
changes little is then almost all zeros.

One episode of a page has actors, their motion and signals; each episode's columns have their own names. Motion has one
row per actor and frame, from its first frame to its last, with the measures of EMVs as the metrics define them. Shapes
are triangles: scene around the EMV's path, signals, actors. Reasons tell what limits a driver's speed at each step, and
each guard's result.
"""

import json
import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, shown_text
from siren_ros.running.generation.replay_check import Decision
from siren_ros.scoring.evaluation.yielding.metrics import lost_shares
from siren_ros.scoring.judging.surrogate_safety import conflict_series
from siren_ros.sensing.meshes.mesh import LENSES, Bytes, LampColour, Material, Mesh, StaticScene, Triangles
from siren_ros.sensing.scene.kerbside import scene_config_of
from siren_ros.sensing.scene.static_scene import kept_scene
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.behaviour.driving.navigator import SpeedLimit
from siren_ros.simulation.world.actors import ActorClass, ActorDescription

SMALL: Final = 9
MEDIUM: Final = 6
QUICK: Final = 1
"""Compression levels of zlib. The first takes seconds for a town; on noise such as sweeps it takes ten times as long as
the second and saves 4 %."""


class ColumnFile:
    """Collects columns by name."""

    def __init__(self) -> None:
        """Start without columns."""
        self._entries: list[dict[str, Any]] = []
        self._bytes: list[bytes] = []

    def add(self, name: str, values: npt.ArrayLike, unit: float = 1.0, order: int = 1, *, width: int = 4) -> None:
        """Add a column of any shape, rounded to whole multiples of a unit.

        ``order`` is how often neighbours are subtracted: twice for what changes evenly, such as a position. Numbers
        have ``width`` bytes, 4 or 2.
        """
        numbers = np.rint(np.asarray(values, np.float64).ravel() / unit).astype(np.int64).astype(np.uint32)
        for _ in range(order):
            numbers = np.diff(numbers, prepend=np.uint32(0))
        narrow = {} if width == 4 else {"bytes": width}
        self._entries.append({"name": name, "length": len(numbers), "unit": unit, "order": order, **narrow})
        self._bytes.append(numbers.astype(f"<u{width}").view(np.uint8).reshape(-1, width).T.tobytes())

    def add_bytes(self, name: str, content: bytes) -> None:
        """Add bytes unchanged, such as pictures."""
        self._entries.append({"name": name, "length": len(content), "bytes": 1})
        self._bytes.append(content)

    def packed(self, head: Mapping[str, Any], level: int = SMALL) -> bytes:
        """The complete file; ``head`` has JSON types, and the list of columns is added to it."""
        text = json.dumps({**head, "columns": self._entries}, allow_nan=False, separators=(",", ":")).encode()
        return zlib.compress(b"".join((len(text).to_bytes(4, "little"), text, *self._bytes)), level)


NOTHING: Final = 9999.0
"""Stands for a missing value: no EMV, no other actor, or no predicted contact."""


def measures_of_emvs(record: EpisodeRecord) -> tuple[Floats, Floats, Floats]:
    """For each row of the record: smallest TTC in seconds, smallest gap in metres, delay so far in seconds."""
    ttc_s, gap_m, delay_s = np.full((3, len(record.rows)), NOTHING)
    for seen in record.by_emv():
        mine = record.rows_of(emv_id := seen.emv_ids[0])
        if not len(mine):
            continue
        encounters, contacts = conflict_series(record, emv_id)
        row = mine[np.searchsorted(record.rows.step[mine], encounters.step)]
        np.minimum.at(ttc_s, row, contacts.time_s)
        np.minimum.at(gap_m, row, contacts.gap_m)
        with np.errstate(all="ignore"):  # a record of another program may have any target speed
            lost_s = np.cumsum(lost_shares(seen)) * STEP_S
        delay_s[mine] = np.nan_to_num(lost_s, nan=NOTHING).clip(-NOTHING, NOTHING)
    return ttc_s, gap_m, delay_s


_FARTHEST_M: Final = 2e6
"""Largest coordinate that a 32-bit column holds in millimetres."""
ABSENT: Final = 255
"""Mode that marks a frame in which an actor is absent, between frames in which it is present."""
_UNITS: Final[Mapping[str, tuple[float, int]]] = {
    "x_m": (0.001, 2),
    "y_m": (0.001, 2),
    "z_m": (0.001, 2),
    "yaw_rad": (0.0002, 2),
    "speed_mps": (0.01, 1),
    "accel_mps2": (0.01, 1),
    "steer_rad": (0.005, 1),
    "residual_m": (0.001, 1),
    "owner": (1.0, 1),
    "lights": (1.0, 1),
    "mode": (1.0, 1),
}
"""Unit and order (``ColumnFile.add``) of each column."""


def check_motion(record: EpisodeRecord) -> None:
    """Check that a record can be shown; damaged bags often cannot.

    Raises:
        InputError: No states, states that are no numbers or far away, or actors without a description.
    """
    rows, template = record.rows, record.description.template
    if len(rows) == 0:
        raise InputError("bag", template, "an episode with at least one recorded actor state")
    known = all(
        actor_id in record.actors and all(0.0 < size < _FARTHEST_M for size in _size_m(record.actors[actor_id]))
        for actor_id in np.unique(rows.actor_id).tolist()
    )
    if not known or not all((np.abs(getattr(rows, name)) < _FARTHEST_M).all() for name in _UNITS):
        raise InputError("bag", template, "an episode whose states and sizes are numbers within 2,000 km")


def _size_m(actor: ActorDescription) -> tuple[float, float, float]:
    return actor.length_m, actor.width_m, actor.height_m


def add_motion(file: ColumnFile, record: EpisodeRecord, prefix: str = "") -> list[dict[str, Any]]:
    """Add the columns ``frame.step`` and ``motion.*``; returns the actors for the head, in the order of the columns.

    The columns' names begin with ``prefix``.
    """
    rows = record.rows
    steps = np.array([state.step for state in record.states], np.int64)
    file.add(f"{prefix}frame.step", steps)
    frame = np.searchsorted(steps, rows.step)
    actors, gathered, absent = [], [], []
    for actor_id in np.unique(rows.actor_id).tolist():
        mine = record.rows_of(actor_id)
        frames = frame[mine]
        every = np.arange(frames[0], frames[-1] + 1)
        latest = np.searchsorted(frames, every, side="right") - 1
        gathered.append(mine[latest])
        absent.append(frames[latest] != every)
        actors.append(_actor(record.actors[actor_id]) | {"first": int(frames[0]), "frames": len(every)})
    row = np.concatenate(gathered) if gathered else np.empty(0, np.intp)
    hidden = np.concatenate(absent) if absent else np.empty(0, np.bool_)
    for name, (unit, order) in _UNITS.items():
        values: npt.NDArray[Any] = getattr(rows, name)[row]
        if name == "yaw_rad":
            values = np.unwrap(values)
        file.add(f"{prefix}motion.{name}", np.where(hidden, ABSENT, values) if name == "mode" else values, unit, order)
    for name, of_emvs in zip(("ttc_s", "gap_m", "delay_s"), measures_of_emvs(record), strict=True):
        file.add(f"{prefix}motion.{name}", of_emvs[row], 0.01)
    return actors


def _actor(actor: ActorDescription) -> dict[str, Any]:
    red, green, blue = actor.colour_rgb
    return {
        "id": actor.actor_id,
        "name": shown_text(actor.name),
        "class": actor.actor_class.name,
        "size_m": [round(size, 4) for size in _size_m(actor)],
        "rgb": (red << 16) + (green << 8) + blue,
        "emv": actor.is_emv,
    }


STATIC_TRIANGLES: Final = 190_000
"""Largest number of triangles of the scene. The page may draw 300,000; the rest is for the actors."""
_UNIT_M: Final = 0.001
_GROUND: Final = (
    *(Material.GROUND, Material.GRASS, Material.ASPHALT, Material.SHOULDER_ASPHALT, Material.MARKING_WHITE),
    *(Material.MARKING_YELLOW, Material.KERB, Material.SIDEWALK, Material.MEDIAN),
)
_GROUND_FIRST: Final = 0.25
"""Factor on the distance of the ground: distant roads matter more than distant trees."""
_PLAIN, _PAINT = 0, 1
_SLENDER: Final = (Material.SIGNAL_HOUSING, Material.METAL_POLE, Material.STOP_SIGN)
"""Materials of thin objects. They hide little, so that the page need not cut them open for the view."""
_SURFACES: Final = {
    Material.CAR_PAINT: _PAINT,
    Material.CLOTHING: _PAINT,
    Material.BRAKE_LAMP: 2,
    Material.INDICATOR_LEFT_LAMP: 3,
    Material.INDICATOR_RIGHT_LAMP: 4,
    Material.BEACON_BLUE: 5,
    Material.BEACON_RED: 6,
    Material.HEAD_LAMP: 7,
}
"""Codes in the page's script for surfaces that have the actor's colour or can shine; all others are plain."""
_SURFACE_OF: Final = np.array([_SURFACES.get(material, _PLAIN) for material in Material])
_CLOTHES: Final = (255, 255, 255)


def add_static_scene(
    file: ColumnFile, records: Sequence[EpisodeRecord], scene: StaticScene, prefix: str = "", pictures: int = 1
) -> dict[str, Any]:
    """Add the mesh without the lenses of signals, and the lenses; returns the lamps for the head.

    ``records`` are the episodes in it. The columns' names begin with ``prefix``.
    """
    mesh = scene.mesh
    lenses = np.isin(mesh.material, LENSES)
    kept = _nearest(records, mesh, np.flatnonzero(~lenses), STATIC_TRIANGLES // pictures)
    _add_mesh(file, f"{prefix}static", mesh, kept, np.isin(mesh.material, _SLENDER).astype(np.intp))
    chosen = [np.arange(lamp.start, lamp.stop) for lamp in scene.signal_lamps]
    corners = np.concatenate([mesh.triangles[rows].ravel() for rows in chosen]) if chosen else np.empty(0, np.uint32)
    file.add(f"{prefix}lamp.corners", mesh.vertices_m[corners], _UNIT_M)
    return {
        "lamps": [
            [lamp.signal_id, lamp.link, lamp.colour.value, 3 * (lamp.stop - lamp.start)] for lamp in scene.signal_lamps
        ],
        "lamp_letters": {colour.value: colour.lit_by for colour in LampColour},
    }


def _nearest(
    records: Sequence[EpisodeRecord], mesh: Mesh, candidates: npt.NDArray[np.intp], most: int
) -> npt.NDArray[np.intp]:
    """Select triangles, in order: all, or those nearest to the EMVs' paths."""
    if len(candidates) <= most:
        return candidates
    ways = [each.rows.xy_m[np.isin(each.rows.actor_id, each.emv_ids)] for each in records]
    tree = cKDTree(np.concatenate(ways if any(map(len, ways)) else [each.rows.xy_m for each in records])[::5])
    centres = mesh.vertices_m[mesh.triangles[candidates]].mean(axis=1)[:, :2]
    distance_m, _ = tree.query(centres)
    distance_m[np.isin(mesh.material[candidates], _GROUND)] *= _GROUND_FIRST
    kept = np.argsort(distance_m, kind="stable")[:most]
    return np.sort(candidates[kept])


def add_shapes(file: ColumnFile, classes: Iterable[ActorClass]) -> None:
    """Add the shape of each class at rest in ``base_link``, and its moving parts (``VehicleShape.parts``)."""
    for actor_class in classes:
        shape = vehicle_shape(actor_class)
        mesh = shape.at_rest
        surface = _SURFACE_OF[mesh.material]
        rgb = np.where((surface == _PAINT)[:, None], _CLOTHES, mesh.colour_rgb).astype(np.uint8)
        painted = Mesh(mesh.vertices_m, mesh.triangles, mesh.material, rgb)
        name = f"shape.{actor_class.name}"
        vertex = _add_mesh(file, name, painted, np.arange(len(mesh)), surface)
        ends = np.cumsum([len(part.vertices_m) for part, _ in shape.parts])
        file.add(f"{name}.part", np.searchsorted(ends, vertex, side="right"))
        file.add(f"{name}.hubs", [hub for _, hub in shape.parts], _UNIT_M, order=0)


def _add_mesh(
    file: ColumnFile,
    name: str,
    mesh: Mesh,
    rows: npt.NDArray[np.intp],
    surface: npt.NDArray[np.intp],
) -> npt.NDArray[np.intp]:
    """Add some triangles with colour and surface at each vertex; returns the mesh's vertices used."""
    code = _packed_rgb(mesh.colour_rgb[rows]) + (surface[rows] << 24)
    vertex, code, triangles = _split_by_code(mesh.triangles[rows], code)
    file.add(f"{name}.xyz", mesh.vertices_m[vertex].T, _UNIT_M)
    file.add(f"{name}.triangles", triangles)
    file.add(f"{name}.rgb", code & 0xFFFFFF)
    file.add(f"{name}.surface", code >> 24)
    return vertex


def _packed_rgb(colour_rgb: Bytes) -> npt.NDArray[np.int64]:
    return colour_rgb.astype(np.int64) @ np.array((1 << 16, 1 << 8, 1))


def _split_by_code(
    corners: Triangles, code: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.int64], npt.NDArray[np.intp]]:
    """Split vertices so that each has one code: old indices, codes, and corners as indices of the new ones."""
    codes, code_index = np.unique(code, return_inverse=True)
    key = corners.astype(np.int64) * len(codes) + code_index.reshape(-1, 1)
    keys, triangles = np.unique(key.ravel(), return_inverse=True)
    return (keys // max(len(codes), 1)).astype(np.intp), codes[keys % max(len(codes), 1)], triangles


Decisions = Iterable[tuple[int, Mapping[int, Decision]]]
"""Decisions as ``decisions_of`` gives them: each step with its decisions by actor."""
_SPEED_UNIT_MPS: Final = 0.01
_FASTEST_MPS: Final = 60.0
"""Speed limits above this are left out, since no vehicle drives faster."""


def add_reasons(file: ColumnFile, decisions: Decisions) -> Mapping[str, Any]:
    """Add the columns ``why.*``; returns the names that they refer to, or an empty head without decisions."""
    by_step = [(actor, step, decision) for step, decided in decisions for actor, decision in decided.items()]
    rows = sorted(by_step, key=lambda row: row[:2])
    if not rows:
        return {}
    limited = [_that_limit(decision) for _, _, decision in rows]
    limits = [limit for each in limited for limit in each.items()]
    guards = [guard for _, _, decision in rows for guard in decision.guards]
    mechanisms = sorted({mechanism for mechanism, _ in limits})
    texts = sorted({text for guard in guards for text in (guard.name, guard.why)})
    numbers = {text: number for number, text in enumerate(texts)}
    file.add("why.actor", [actor for actor, _, _ in rows])
    file.add("why.step", [step for _, step, _ in rows])
    file.add("why.target_mps", [_bounded(decision.target_mps) for _, _, decision in rows], _SPEED_UNIT_MPS)
    file.add("why.limits", [len(each) for each in limited])
    file.add("why.guards", [len(decision.guards) for _, _, decision in rows])
    file.add("limit.mechanism", [mechanisms.index(mechanism) for mechanism, _ in limits])
    file.add("limit.speed_mps", [_bounded(limit.speed_mps) for _, limit in limits], _SPEED_UNIT_MPS)
    file.add("limit.blocker", [limit.blocker_id for _, limit in limits])
    file.add("guard.name", [numbers[guard.name] for guard in guards])
    file.add("guard.acts", [guard.acts for guard in guards])
    file.add("guard.why", [numbers[guard.why] for guard in guards])
    return {"why": {"mechanisms": mechanisms, "texts": texts}}


def _that_limit(decision: Decision) -> Mapping[str, SpeedLimit]:
    return {name: limit for name, limit in decision.limits.items() if limit.speed_mps <= _FASTEST_MPS}


def _bounded(speed_mps: float) -> float:
    """A speed in the range of a column; -1 for none, where SUMO drives."""
    return -1.0 if math.isnan(speed_mps) else min(max(speed_mps, 0.0), _FASTEST_MPS)


MOST_OTHERS: Final = 3
"""Largest number of episodes for comparison: a screen has space for four pictures."""


def title_of(record: EpisodeRecord) -> str:
    """Title such as ``S2 at L2, seed 0, on town``."""
    episode = record.description
    return shown_text(f"{episode.template} at {episode.level.name}, seed {episode.seed}, on {episode.map_name}")


def add_parts(
    file: ColumnFile, record: EpisodeRecord, others: Sequence[EpisodeRecord], scene: StaticScene | None = None
) -> dict[str, Any]:
    """Add an episode and those for comparison; returns their entries for the head.

    ``scene`` is that of the first episode, where it has been made already. Episodes on the same map share its scene.
    Its triangles are fewer where there are more pictures to draw.

    Raises:
        InputError: Too many others, or a record that ``check_motion`` refuses.
    """
    if len(others) > MOST_OTHERS:
        raise InputError("against", str(len(others)), f"at most {MOST_OTHERS} other episodes")
    records = (record, *others)
    maps = [each.description.map_sha256 for each in records]
    parts = []
    for place, each in enumerate(records):
        check_motion(each)
        first = maps.index(maps[place])
        part = _part(file, each, _prefix(place)) | {"scene": _prefix(first)}
        if first == place:
            sharing = [other for other, sha256 in zip(records, maps, strict=True) if sha256 == maps[place]]
            config = scene_config_of(each.description.template_values)
            made = scene if scene and not place else kept_scene(each.network, each.description.seed, config)
            part |= add_static_scene(file, sharing, made, _prefix(place), pictures=len(records))
        parts.append(part)
    return {**parts[0], "against": parts[1:]}


def _prefix(place: int) -> str:
    return f"{place}." if place else ""


def _part(file: ColumnFile, record: EpisodeRecord, prefix: str) -> dict[str, Any]:
    return {
        "title": title_of(record),
        "prefix": prefix,
        "actors": add_motion(file, record, prefix),
        "emvs": list(record.emv_ids),
        "left_hand": record.network.left_hand,
        "signals": signals_of(record),
    }


def signals_of(record: EpisodeRecord) -> dict[str, list[tuple[int, str]]]:
    """For each signal the steps at which its state changes, with the new state."""
    changes: dict[str, list[tuple[int, str]]] = {}
    for traffic in record.traffic:
        for signal in traffic.signals:
            known = changes.setdefault(signal.signal_id, [])
            if not known or known[-1][1] != signal.state:
                known.append((traffic.step, signal.state))
    return changes
