"""Builds signal heads and stop signs at their approaches, and the poles of these and of street lamps."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.sensing.meshes.mesh import LampColour, Material, Mesh, SignalLamp, StaticScene
from siren_ros.sensing.meshes.solids import Rgb, box, from_quads, frustum
from siren_ros.sensing.scene.surfaces import FreeSpace, SceneConfig
from siren_ros.simulation.roads.road_network import Connection, Edge, Lane, LaneKind, RoadNetwork

POLE_RGB: Final[Rgb] = (112, 116, 120)
HOUSING_RGB: Final[Rgb] = (30, 32, 34)
_LENS_RGB: Final[dict[LampColour, Rgb]] = {
    LampColour.RED: (92, 18, 16),
    LampColour.YELLOW: (96, 74, 14),
    LampColour.GREEN: (14, 80, 46),
}
_LENS_RADIUS_M: Final = 0.15
"""Radius of a lens: 300 mm diameter, the larger of the two standard sizes (EN 12368)."""
HEAD_HEIGHT_M: Final = 1.28
_LETTERS: Final = {
    "S": ("111", "100", "111", "001", "111"),
    "T": ("111", "010", "010", "010", "010"),
    "O": ("111", "101", "101", "101", "111"),
    "P": ("111", "101", "111", "100", "100"),
}


@dataclass(frozen=True, eq=False)
class SignalHead:
    """A signal head as a mesh, with the triangles of each lamp."""

    mesh: Mesh
    lamps: tuple[tuple[LampColour, int, int], ...]


def turned(mesh: Mesh, x_m: float, y_m: float, z_m: float, heading_rad: float) -> Mesh:
    """Turn a mesh so that its x axis points along a heading, then move it."""
    c, s = float(np.cos(heading_rad)), float(np.sin(heading_rad))
    return mesh.transformed(np.array([(c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)]), (x_m, y_m, z_m))


def signal_head() -> SignalHead:
    """A head with three lamps that faces +x, its lower edge at z 0, red above yellow above green."""
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
    return SignalHead(Mesh.joined(*parts), tuple(lamps))


def pole(x_m: float, y_m: float, height_m: float, radius_m: float = 0.07) -> Mesh:
    """An upright metal pole on the ground, slightly tapered."""
    return frustum((x_m, y_m, 0.0), height_m, (radius_m, 0.75 * radius_m), 7, Material.METAL_POLE, POLE_RGB)


def stop_sign() -> Mesh:
    """An octagonal sign that faces +x, its centre at the origin: red with a white rim and the word STOP."""
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
    return Mesh.joined(*parts)


def street_lamp(height_m: float) -> Mesh:
    """A street lamp at the origin whose arm reaches 1.8 m along +x."""
    arm = 1.8
    return Mesh.joined(
        frustum((0.0, 0.0, 0.0), height_m, (0.09, 0.05), 7, Material.METAL_POLE, POLE_RGB),
        box((0.0, -0.03, height_m - 0.05), (arm, 0.03, height_m), Material.METAL_POLE, POLE_RGB),
        box((arm - 0.6, -0.12, height_m - 0.13), (arm, 0.12, height_m - 0.05), Material.STREET_LAMP, (196, 198, 190)),
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
    """Find the nearest place from a point along a direction, within a reach. None if no place has the clear radius."""
    steps = np.arange(0.0, reach_m, 0.25)[:, None]
    return space.first_clear(np.array((x_m, y_m)) + steps * np.array(direction), radius_m)


_POST_HEAD_M: Final = 2.6
"""Height of the lower edge of a signal head on a post beside the road."""
_POST_RADIUS_M: Final = 0.5
"""Room around a post that carries a head or a sign at eye height."""
_MAST_RADIUS_M: Final = 0.25
_PREFERENCE: Final = "slrt"
"""A head that serves several movements shows the state of the first movement in this order."""


def junction_controls(network: RoadNetwork, space: FreeSpace, config: SceneConfig) -> StaticScene:
    """Signals and stop signs of a map: a post at the right of each approach, heads on a mast beyond the junction."""
    builder = _ControlsBuilder(network, space, config)
    for edge in network.edges:
        if edge.internal:
            continue
        lanes = [network.lanes[i] for i in edge.lanes if network.lanes[i].kind is LaneKind.DRIVING]
        signalled = [(lane, link) for lane in lanes if (link := builder.shown_movement(lane)) is not None]
        if signalled:
            builder.add_near_post(edge, *signalled[0])
            builder.add_far_heads(signalled)
        elif any(c.must_stop for lane in lanes for c in network.connections_from.get(lane.index, ())):
            builder.add_stop_post(edge, lanes[0])
    return StaticScene(Mesh.joined(*builder.parts), tuple(builder.lamps))


class _ControlsBuilder:
    """Collects meshes in order, and which triangles of the joined mesh are lamps."""

    def __init__(self, network: RoadNetwork, space: FreeSpace, config: SceneConfig) -> None:
        self.parts: list[Mesh] = []
        self.lamps: list[SignalLamp] = []
        self._triangles = 0
        self._network = network
        self._space = space
        self._config = config

    def _add(self, mesh: Mesh) -> None:
        """Appends a mesh without lamps."""
        self.parts.append(mesh)
        self._triangles += len(mesh)

    def _add_head(
        self, link: Connection, place: tuple[float, float, float], heading_rad: float, ahead_m: float
    ) -> None:
        """Appends a signal head that shines along a heading, at a distance in front of a place."""
        head, (x_m, y_m, z_m) = signal_head(), place
        self.lamps += [
            SignalLamp(str(link.signal_id), link.signal_link, colour, self._triangles + start, self._triangles + stop)
            for colour, start, stop in head.lamps
        ]
        x_m, y_m = x_m + ahead_m * np.cos(heading_rad), y_m + ahead_m * np.sin(heading_rad)
        self._add(turned(head.mesh, float(x_m), float(y_m), z_m, heading_rad))

    def shown_movement(self, lane: Lane) -> Connection | None:
        """The signalled movement whose state a lane's head shows."""
        links = self._network.connections_from.get(lane.index, ())
        ranks = {direction: rank for rank, direction in enumerate(_PREFERENCE)}
        return min(
            (link for link in links if link.signal_id is not None and link.signal_link >= 0),
            key=lambda link: ranks.get(link.direction.lower(), len(ranks)),
            default=None,
        )

    def _right_post(self, edge: Edge, lane: Lane) -> tuple[float, float] | None:
        """Find a place for a post at the right of the end of an edge, as near to the lane and its end as possible."""
        outer = self._network.lanes[edge.lanes[0]]
        _, to_outer = outer.centre.project(lane.centre.at(lane.length_m))
        reach = lane.width_m + abs(float(to_outer)) + outer.width_m + 3.0
        back, aside = (grid.ravel() for grid in np.meshgrid((0.5, 2.0, 4.0, 7.0, 11.0), np.arange(0.0, reach, 0.25)))
        nearest = np.argsort(aside + 0.5 * back, kind="stable")
        s = np.maximum(lane.length_m - back[nearest], 0.0)
        return self._space.first_clear(lane.centre.offset_points(s, -aside[nearest]), _POST_RADIUS_M)

    def add_near_post(self, edge: Edge, lane: Lane, link: Connection) -> None:
        """Add a signal head in front of a post beside the approach."""
        place = self._right_post(edge, lane)
        if place is not None:
            heading = float(lane.centre.heading_rad(lane.length_m)) + np.pi
            self._add(pole(*place, _POST_HEAD_M + HEAD_HEIGHT_M))
            self._add_head(link, (*place, _POST_HEAD_M), heading, 0.26)

    def add_far_heads(self, signalled: Sequence[tuple[Lane, Connection]]) -> None:
        """Add heads for straight movements over the lanes beyond the junction, or on a post opposite the approach."""
        straight = [(self._network.lanes[link.to_lane], link) for _, link in signalled if link.direction == "s"]
        if not straight:
            self._add_opposite_post(*signalled[-1])
            return
        first, last = straight[0][0], straight[-1][0]
        heading = float(first.centre.heading_rad(0.0))
        right = (float(np.sin(heading)), -float(np.cos(heading)))
        for ahead in (1.0, 3.0, 6.0):
            x, y = first.centre.at(min(ahead, first.length_m))
            place = clear_pole(self._space, float(x), float(y), right, 14.0, _MAST_RADIUS_M)
            if place is None:
                continue
            arm_z = self._config.clearance_m + HEAD_HEIGHT_M + 0.4
            end_x, end_y = (float(value) for value in last.centre.offset_points(min(ahead, last.length_m), 0.3))
            self._add(pole(*place, arm_z + 0.2, 0.12))
            self._add(mast_arm(place, (end_x, end_y), arm_z))
            for lane, link in straight:
                on_arm = _on_line(place, (end_x, end_y), lane.centre.at(min(ahead, lane.length_m)))
                self._add_head(link, (*on_arm, self._config.clearance_m + 0.2), heading + np.pi, 0.27)
            return

    def _add_opposite_post(self, lane: Lane, link: Connection) -> None:
        x, y = lane.centre.at(lane.length_m)
        heading = float(lane.centre.heading_rad(lane.length_m))
        forward = (float(np.cos(heading)), float(np.sin(heading)))
        place = clear_pole(self._space, float(x), float(y), forward, 60.0, _POST_RADIUS_M)
        if place is not None:
            self._add(pole(*place, _POST_HEAD_M + 0.6 + HEAD_HEIGHT_M))
            self._add_head(link, (*place, _POST_HEAD_M + 0.6), heading + np.pi, 0.26)

    def add_stop_post(self, edge: Edge, lane: Lane) -> None:
        """Add a stop sign on a post beside the approach."""
        place = self._right_post(edge, lane)
        if place is not None:
            facing = float(lane.centre.heading_rad(lane.length_m)) + np.pi
            self._add(pole(*place, 2.75, 0.04))
            x, y = place[0] + 0.06 * np.cos(facing), place[1] + 0.06 * np.sin(facing)
            self._add(turned(stop_sign(), float(x), float(y), 2.3, facing))


def _on_line(start: tuple[float, float], end: tuple[float, float], point: Floats) -> tuple[float, float]:
    """Nearest place to a point on the line between two places."""
    a, b = np.array(start), np.array(end)
    along = float(np.dot(point - a, b - a) / np.dot(b - a, b - a))
    x, y = a + np.clip(along, 0.0, 1.0) * (b - a)
    return float(x), float(y)
