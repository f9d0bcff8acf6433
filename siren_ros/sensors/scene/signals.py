"""Signal heads and stop signs at the approaches that they control, and the poles of these and of street lamps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.roads.road_network import Connection, Edge, Lane, LaneKind, RoadNetwork
from siren_ros.sensors.meshes.mesh import LampColour, Material, Mesh, SignalLamp
from siren_ros.sensors.meshes.solids import Rgb, box, from_quads, frustum
from siren_ros.sensors.scene.config import SceneConfig
from siren_ros.sensors.scene.surfaces import FreeSpace

POLE_RGB: Final[Rgb] = (112, 116, 120)
HOUSING_RGB: Final[Rgb] = (30, 32, 34)
_LENS_RGB: Final[dict[LampColour, Rgb]] = {
    LampColour.RED: (92, 18, 16),
    LampColour.YELLOW: (96, 74, 14),
    LampColour.GREEN: (14, 80, 46),
}
_LENS_RADIUS_M: Final = 0.15
"""Lenses of 300 mm, the larger of the two standard sizes (EN 12368)."""
HEAD_HEIGHT_M: Final = 1.28
_LETTERS: Final = {
    "S": ("111", "100", "111", "001", "111"),
    "T": ("111", "010", "010", "010", "010"),
    "O": ("111", "101", "101", "101", "111"),
    "P": ("111", "101", "111", "100", "100"),
}


@dataclass(frozen=True, eq=False)
class SignalHead:
    """A head as a mesh, with the triangles of each lamp."""

    mesh: Mesh
    lamps: tuple[tuple[LampColour, int, int], ...]


def turned(mesh: Mesh, x_m: float, y_m: float, z_m: float, heading_rad: float) -> Mesh:
    """A mesh turned so that its x axis points along a heading, and moved."""
    c, s = float(np.cos(heading_rad)), float(np.sin(heading_rad))
    return mesh.transformed(np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)]), (x_m, y_m, z_m))


def signal_head() -> SignalHead:
    """A three-lamp head that shines along +x, its lower edge at z 0, red above yellow above green."""
    parts = [
        box((-0.2, -0.21, 0.0), (0.0, 0.21, HEAD_HEIGHT_M), Material.SIGNAL_HOUSING, HOUSING_RGB),
        box((-0.08, -0.36, -0.12), (-0.06, 0.36, HEAD_HEIGHT_M + 0.12), Material.SIGNAL_HOUSING, HOUSING_RGB),
    ]
    lamps = []
    angle = np.arange(10) * (2 * np.pi / 10)
    for row, colour in enumerate((LampColour.GREEN, LampColour.YELLOW, LampColour.RED)):
        z = 0.23 + 0.41 * row
        ring = np.column_stack((np.full(10, 0.012), _LENS_RADIUS_M * np.cos(angle), z + _LENS_RADIUS_M * np.sin(angle)))
        fan = [(0, k, k + 1) for k in range(1, 9)]
        parts.append(box((0.0, -0.17, z + 0.16), (0.2, 0.17, z + 0.18), Material.SIGNAL_HOUSING, HOUSING_RGB))
        start = sum(len(part) for part in parts)
        parts.append(Mesh.uniform(ring, fan, colour.material, _LENS_RGB[colour]))
        lamps.append((colour, start, start + len(fan)))
    return SignalHead(Mesh.concatenate(parts), tuple(lamps))


def pole(x_m: float, y_m: float, height_m: float, radius_m: float = 0.07) -> Mesh:
    """An upright metal pole on the ground, slightly tapered."""
    return frustum((x_m, y_m, 0.0), height_m, (radius_m, 0.75 * radius_m), 7, Material.METAL_POLE, POLE_RGB)


def stop_sign() -> Mesh:
    """An octagonal sign that faces +x, its middle at the origin: red with a white rim and the word STOP."""
    angle = np.pi / 8 + np.arange(8) * (np.pi / 4)
    outline = np.column_stack((np.zeros(8), np.cos(angle), np.sin(angle)))
    fan = np.array([(0, k, k + 1) for k in range(1, 7)])
    back = [-0.012, 0.0, 0.0]
    parts = [
        Mesh.uniform(outline * 0.45, fan, Material.STOP_SIGN, (236, 236, 236)),
        Mesh.uniform(outline * 0.41 + (0.006, 0.0, 0.0), fan, Material.STOP_SIGN, (178, 20, 24)),
        Mesh.uniform(outline * 0.45 + back, fan[:, ::-1], Material.METAL_POLE, (140, 142, 144)),
    ]
    cell = 0.045
    for place, letter in enumerate("STOP"):
        left = -0.33 + place * 0.175
        for row, bits in enumerate(_LETTERS[letter]):
            for column, bit in enumerate(bits):
                if bit == "1":
                    y, z = left + column * cell, 0.11 - row * cell
                    quad = np.array(
                        [(0.012, y, z - cell), (0.012, y + cell, z - cell), (0.012, y + cell, z), (0.012, y, z)]
                    )
                    parts.append(from_quads([(quad, (Material.STOP_SIGN, (240, 240, 240)))]))
    return Mesh.concatenate(parts)


def street_lamp(height_m: float) -> Mesh:
    """A street lamp at the origin whose arm reaches 1.8 m along +x."""
    arm = 1.8
    return Mesh.concatenate(
        [
            frustum((0.0, 0.0, 0.0), height_m, (0.09, 0.05), 7, Material.METAL_POLE, POLE_RGB),
            box((0.0, -0.03, height_m - 0.05), (arm, 0.03, height_m), Material.METAL_POLE, POLE_RGB),
            box(
                (arm - 0.6, -0.12, height_m - 0.13), (arm, 0.12, height_m - 0.05), Material.STREET_LAMP, (196, 198, 190)
            ),
        ]
    )


def mast_arm(from_m: tuple[float, float], to_m: tuple[float, float], z_m: float) -> Mesh:
    """A horizontal arm of square section between two places at height ``z_m``."""
    dx, dy = to_m[0] - from_m[0], to_m[1] - from_m[1]
    length = float(np.hypot(dx, dy))
    beam = box((0.0, -0.06, -0.06), (length, 0.06, 0.06), Material.METAL_POLE, POLE_RGB)
    return turned(beam, from_m[0], from_m[1], z_m, float(np.arctan2(dy, dx)))


def clear_pole(
    space: FreeSpace, x_m: float, y_m: float, direction: tuple[float, float], reach_m: float, radius_m: float
) -> tuple[float, float] | None:
    """The nearest place from a point along a direction, within a reach, with a clear radius; None without one."""
    steps = np.arange(0.0, reach_m, 0.25)[:, None]
    return space.first_clear(np.array((x_m, y_m)) + steps * np.array(direction), radius_m)


_POST_HEAD_M: Final = 2.6
"""Lower edge of a head on a post beside the road."""
_POST_RADIUS_M: Final = 0.5
"""Room around a post that carries a head or a sign at eye height."""
_MAST_RADIUS_M: Final = 0.25
_PREFERENCE: Final = "slrt"
"""A head that serves several movements shows the state of the first of these that it has."""


@dataclass(frozen=True, eq=False)
class Controls:
    """All signals and signs; the lamps' triangle ranges count from the mesh's first triangle."""

    mesh: Mesh
    lamps: tuple[SignalLamp, ...]


def junction_controls(network: RoadNetwork, space: FreeSpace, config: SceneConfig) -> Controls:
    """Signals and stop signs of a map: a post at the right of each approach, heads on a mast beyond the junction."""
    collector = _Collector()
    for edge in network.edges:
        if edge.internal:
            continue
        lanes = [network.lanes[i] for i in edge.lanes if network.lanes[i].kind is LaneKind.DRIVING]
        signalled = [(lane, link) for lane in lanes if (link := _representative(network, lane)) is not None]
        if signalled:
            _near_post(collector, network, edge, signalled, space)
            _far_heads(collector, network, signalled, space, config)
        elif any(c.must_stop for lane in lanes for c in network.connections_from.get(lane.index, ())):
            _stop_post(collector, network, edge, lanes, space)
    return Controls(Mesh.concatenate(collector.parts), tuple(collector.lamps))


class _Collector:
    """Meshes in order, with the lamps' triangle ranges in their concatenation."""

    def __init__(self) -> None:
        self.parts: list[Mesh] = []
        self.lamps: list[SignalLamp] = []
        self._triangles = 0

    def add(self, mesh: Mesh) -> None:
        """Appends a mesh without lamps."""
        self.parts.append(mesh)
        self._triangles += len(mesh)

    def add_head(self, link: Connection, x_m: float, y_m: float, z_m: float, heading_rad: float) -> None:
        """Appends a signal head that shines along a heading."""
        head = signal_head()
        for colour, start, stop in head.lamps:
            self.lamps.append(
                SignalLamp(
                    signal_id=str(link.signal_id),
                    link=link.signal_link,
                    colour=colour,
                    start=self._triangles + start,
                    stop=self._triangles + stop,
                )
            )
        self.add(turned(head.mesh, x_m, y_m, z_m, heading_rad))


def _representative(network: RoadNetwork, lane: Lane) -> Connection | None:
    """The signalled movement whose state a lane's head shows."""
    links = [c for c in network.connections_from.get(lane.index, ()) if c.signal_id is not None and c.signal_link >= 0]
    return min(links, key=lambda c: _rank(c.direction), default=None)


def _rank(direction: str) -> int:
    place = _PREFERENCE.find(direction.lower())
    return place if place >= 0 else len(_PREFERENCE)


def _right_post(network: RoadNetwork, edge: Edge, lane: Lane, space: FreeSpace) -> tuple[float, float] | None:
    """A place for a post at the right of the end of an edge: as near as possible to the lane and to its end."""
    outer = network.lanes[edge.lanes[0]]
    _, to_outer = outer.centre.project(lane.centre.at(lane.length_m))
    reach = lane.width_m + abs(float(to_outer)) + outer.width_m + 3.0
    back, aside = (grid.ravel() for grid in np.meshgrid((0.5, 2.0, 4.0, 7.0, 11.0), np.arange(0.0, reach, 0.25)))
    nearest = np.argsort(aside + 0.5 * back, kind="stable")
    s = np.maximum(lane.length_m - back[nearest], 0.0)
    return space.first_clear(lane.centre.offset_points(s, -aside[nearest]), _POST_RADIUS_M)


def _near_post(
    collector: _Collector,
    network: RoadNetwork,
    edge: Edge,
    signalled: Sequence[tuple[Lane, Connection]],
    space: FreeSpace,
) -> None:
    lane, link = signalled[0]
    place = _right_post(network, edge, lane, space)
    if place is None:
        return
    heading = float(lane.centre.heading_rad(lane.length_m)) + np.pi
    collector.add(pole(*place, _POST_HEAD_M + HEAD_HEIGHT_M))
    # The head hangs in front of its post.
    x, y = place[0] + 0.26 * np.cos(heading), place[1] + 0.26 * np.sin(heading)
    collector.add_head(link, float(x), float(y), _POST_HEAD_M, heading)


def _far_heads(
    collector: _Collector,
    network: RoadNetwork,
    signalled: Sequence[tuple[Lane, Connection]],
    space: FreeSpace,
    config: SceneConfig,
) -> None:
    """Heads over the lanes beyond the junction for straight movements, else on a post opposite the approach."""
    straight = [(network.lanes[link.to_lane], link) for _, link in signalled if link.direction == "s"]
    if not straight:
        _opposite_post(collector, signalled[-1], space)
        return
    first, last = straight[0][0], straight[-1][0]
    heading = float(first.centre.heading_rad(0.0))
    right = (float(np.sin(heading)), -float(np.cos(heading)))
    for ahead in (1.0, 3.0, 6.0):
        s = min(ahead, first.length_m)
        x, y = first.centre.at(s)
        place = clear_pole(space, float(x), float(y), right, 14.0, _MAST_RADIUS_M)
        if place is None:
            continue
        arm_z = config.clearance_m + HEAD_HEIGHT_M + 0.4
        end = last.centre.offset_points(min(ahead, last.length_m), 0.3)
        collector.add(pole(*place, arm_z + 0.2, 0.12))
        collector.add(mast_arm(place, (float(end[0]), float(end[1])), arm_z))
        for lane, link in straight:
            hx, hy = _on_line(place, (float(end[0]), float(end[1])), lane.centre.at(min(ahead, lane.length_m)))
            facing = heading + np.pi
            collector.add_head(
                link, hx + 0.27 * np.cos(facing), hy + 0.27 * np.sin(facing), config.clearance_m + 0.2, facing
            )
        return


def _on_line(
    start: tuple[float, float], end: tuple[float, float], point: npt.NDArray[np.float64]
) -> tuple[float, float]:
    a, b = np.array(start), np.array(end)
    along = float(np.dot(point - a, b - a) / np.dot(b - a, b - a))
    x, y = a + np.clip(along, 0.0, 1.0) * (b - a)
    return float(x), float(y)


def _opposite_post(collector: _Collector, approach: tuple[Lane, Connection], space: FreeSpace) -> None:
    lane, link = approach
    x, y = lane.centre.at(lane.length_m)
    heading = float(lane.centre.heading_rad(lane.length_m))
    forward = (float(np.cos(heading)), float(np.sin(heading)))
    place = clear_pole(space, float(x), float(y), forward, 60.0, _POST_RADIUS_M)
    if place is None:
        return
    collector.add(pole(*place, _POST_HEAD_M + 0.6 + HEAD_HEIGHT_M))
    facing = heading + np.pi
    collector.add_head(
        link, place[0] + 0.26 * np.cos(facing), place[1] + 0.26 * np.sin(facing), _POST_HEAD_M + 0.6, facing
    )


def _stop_post(
    collector: _Collector, network: RoadNetwork, edge: Edge, lanes: Sequence[Lane], space: FreeSpace
) -> None:
    place = _right_post(network, edge, lanes[0], space)
    if place is None:
        return
    facing = float(lanes[0].centre.heading_rad(lanes[0].length_m)) + np.pi
    collector.add(pole(*place, 2.75, 0.04))
    x, y = place[0] + 0.06 * np.cos(facing), place[1] + 0.06 * np.sin(facing)
    collector.add(turned(stop_sign(), float(x), float(y), 2.3, facing))
