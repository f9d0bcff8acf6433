"""What CARLA calls and places things as: blueprints, poses, lights, signals. It needs no CARLA client.

CARLA's coordinates are left-handed: x as in ``map``, y to the other side, angles in degrees, yaw clockwise, pitch up.
A map's OpenDRIVE coordinates are those of ``map``, so no offset lies between the two.
"""

import math
import zlib
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from typing import Final

import numpy as np
import numpy.typing as npt

from siren_ros.base.numerics.arrays import Floats, Floats32, Matrix
from siren_ros.base.params import parameters
from siren_ros.base.params.folders import params_dir
from siren_ros.simulation.world.actors import ActorClass, ActorDescription, Lights

_FILE: Final = "carla.yaml"
_SIMILAR_M: Final = 0.5
"""Lengths of which the nearer is not preferred: half of what separates the classes of passenger cars."""
Bytes = npt.NDArray[np.uint8]
CarlaPose = tuple[float, float, float, float, float, float]
"""x, y, z in metres, pitch, yaw, roll in degrees, as CARLA means them."""

_LIGHTS: Final = {
    Lights.BRAKE: 8,
    Lights.INDICATOR_RIGHT: 16,
    Lights.INDICATOR_LEFT: 32,
    Lights.BEACON: 512 | 1024,
}
"""CARLA's flags (``VehicleLightState``) of our lights; it has no siren."""
RED, YELLOW, GREEN, OFF = range(4)
"""CARLA's ``TrafficLightState``."""


@cache
def blueprints() -> Mapping[ActorClass, Mapping[str, float]]:
    """The table ``params/carla.yaml``: lengths in metres of the blueprints of each class."""
    content = parameters.load_yaml(parameters.read_yaml_text(params_dir() / _FILE))
    return {ActorClass[name.upper()]: rows for name, rows in content.items()}


def cast_of(actor: ActorDescription, available: Collection[str] | None = None) -> tuple[str, ...]:
    """Blueprints that can stand for an actor, the best first; the same actor has the same ones in every episode.

    ``available`` are those of a server, None all of the table. Where it has none of the class, the blueprints of the
    plain class with such a body follow, then those of all other classes.
    """
    table, kind = blueprints(), actor.actor_class
    people = kind is ActorClass.PEDESTRIAN
    ranks = [
        table[kind],
        table[kind.body],
        *(table[each] for each in table if (each is ActorClass.PEDESTRIAN) == people),
    ]

    def order(rows: Mapping[str, float]) -> list[str]:
        def place(name: str) -> tuple[int, int]:
            return round(abs(rows[name] - actor.length_m) / _SIMILAR_M), zlib.crc32(f"{actor.actor_id} {name}".encode())

        return sorted(rows, key=place)

    names = dict.fromkeys(name for rows in ranks for name in order(rows))
    return tuple(name for name in names if available is None or name in available)


def carla_pose(map_from_thing: Matrix) -> CarlaPose:
    """The pose of a thing with x forward, y left, z up, given as a matrix of shape ``(4, 4)``."""
    r, (x, y, z) = map_from_thing[:3, :3], map_from_thing[:3, 3].tolist()
    pitch, yaw = math.asin(min(1.0, max(-1.0, float(r[2, 0])))), math.atan2(float(r[1, 0]), float(r[0, 0]))
    roll = math.atan2(float(r[2, 1]), float(r[2, 2]))
    return x, -y, z, math.degrees(pitch), -math.degrees(yaw), math.degrees(roll)


def actor_pose(
    x_m: float, y_m: float, yaw_rad: float, ground_m: float, centre_m: Floats, extent_m: Floats
) -> CarlaPose:
    """Where CARLA's origin of an actor goes, so that the centre of its box is over the middle of our footprint.

    ``centre_m`` and ``extent_m`` are location and half sizes of its ``bounding_box``, in CARLA's axes. The box stands
    on the ground.
    """
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    ahead, left = float(centre_m[0]), -float(centre_m[1])
    x, y = x_m - cos * ahead + sin * left, y_m - sin * ahead - cos * left
    return x, -y, ground_m - float(centre_m[2] - extent_m[2]), 0.0, -math.degrees(yaw_rad), 0.0


def carla_lights(lights: int) -> int:
    """CARLA's flags of what an actor shows."""
    return sum(flag for light, flag in _LIGHTS.items() if lights & light)


def signal_colour(letters: Iterable[str]) -> int:
    """CARLA's state of a lamp head that is for movements with these letters of SUMO (``rugyGsoO``).

    The most permissive movement decides, as its lamp is the one that is lit.
    """
    letters = set(letters)
    for colour, lit in ((GREEN, "gG"), (YELLOW, "yuo"), (RED, "rs")):
        if letters & set(lit):
            return colour
    return OFF


_MAX_DEPTH_M: Final = 1000.0
_DEPTH_STEPS: Final = 256**3 - 1
"""CARLA's depth camera: metres over 24 bits, in the channels red, green and blue, red the lowest."""
_CLASSES: Final = {4: 3, 13: 12, 17: 16, 20: 0, 21: 0, 22: 0, 23: 10, 26: 3, 27: 25, 28: 5, 29: 10}
"""CARLA's tags that we do not have, as the class nearest to them: walls and bridges are buildings, riders pedestrians,
trains buses, guard rails fences, water and rocks terrain, rail tracks ground; the others have no label."""
_CLASS_OF_TAG: Final = np.arange(256, dtype=np.uint8)
_CLASS_OF_TAG[list(_CLASSES)] = list(_CLASSES.values())


def pixels_of(bgra: bytes, width: int, height: int) -> Bytes:
    """The raw data of a picture of CARLA as blue, green, red, alpha, shape ``(height, width, 4)``; not writable."""
    return np.frombuffer(bgra, np.uint8).reshape(height, width, 4)


def depth_of(bgra: Bytes) -> Floats32:
    """Metres along the optical axis of a picture of CARLA's depth camera; 0 where it ends, which is the sky."""
    depth = (bgra[..., 2] + 256.0 * bgra[..., 1] + 65536.0 * bgra[..., 0]) * (_MAX_DEPTH_M / _DEPTH_STEPS)
    return np.where(depth < _MAX_DEPTH_M, depth, 0.0).astype(np.float32)


def classes_of(bgra: Bytes) -> Bytes:
    """Our semantic classes of a picture of CARLA's semantic camera, whose red channel has the tags."""
    return _CLASS_OF_TAG[bgra[..., 2]]
