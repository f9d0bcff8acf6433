"""A run of SUMO with its own device for surrogate safety measures (SSM), next to the vehicles' poses."""

import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from defusedxml.ElementTree import parse

from siren_ros.errors import MapError
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.random_streams import random_stream
from siren_ros.numerics.units import STEP_S
from siren_ros.recording.episode_record import StateRows
from siren_ros.roads.maps.netconvert import sumo_home
from siren_ros.roads.road_network import LaneKind, RoadNetwork
from siren_ros.world.actors import ACTOR_STATE_DTYPES

LENGTH_M: Final = 4.6
WIDTH_M: Final = 1.8
_FOLLOWER: Final = "2"
"""SUMO's code of an encounter in which the vehicle with the device follows the other one on the same lane."""
_DRIVERS: Final = {
    "vClass": "passenger",
    "length": f"{LENGTH_M}",
    "width": f"{WIDTH_M}",
    "tau": "0.5",  # short headways and imperfect drivers: conflicts are what is compared
    "sigma": "0.8",
    "minGap": "1.0",
    "speedDev": "0.3",
    "decel": "6.0",
}


@dataclass(frozen=True)
class Conflict:
    """What the device notes of one pair, while one follows the other; NaN where a measure has no value."""

    follower: str
    leader: str
    time_s: Floats
    time_to_collision_s: Floats
    required_deceleration_mps2: Floats


@dataclass(frozen=True)
class DeviceRun:
    """Everything of one run."""

    tracks: Mapping[str, StateRows]
    """Poses and speeds of each vehicle, by SUMO's name."""
    conflicts: tuple[Conflict, ...]


def run_device(net: Path, network: RoadNetwork, vehicles: int, duration_s: float, seed: int) -> DeviceRun:
    """Lets impatient drivers go their ways through a map.

    Args:
        net: SUMO's net file.
        network: The same map.
        vehicles: How many set out, one after the other.
        duration_s: Simulated time.
        seed: Of the ways and of SUMO.

    Raises:
        CalledProcessError: SUMO failed.
    """
    with tempfile.TemporaryDirectory(prefix="siren-") as name:
        folder = Path(name)
        routes, poses, log = folder / "routes.xml", folder / "poses.xml", folder / "ssm.xml"
        routes.write_bytes(tostring(_trips(network, vehicles, duration_s, seed)))
        options = {
            "--net-file": net,
            "--route-files": routes,
            "--fcd-output": poses,
            "--precision": 6,
            "--step-length": STEP_S,
            "--end": duration_s,
            "--seed": seed,
            "--device.ssm.probability": 1,
            "--device.ssm.file": log,
            "--device.ssm.measures": "TTC DRAC",
            "--device.ssm.thresholds": "3.0 3.4",
            "--device.ssm.trajectories": "true",
            "--collision.action": "none",
            "--time-to-teleport": -1,
            "--no-step-log": "true",
            "--no-warnings": "true",
            "--ignore-route-errors": "true",
        }
        program = sumo_home() / "bin" / "sumo"
        command = [str(program), *(str(part) for pair in options.items() for part in pair)]
        subprocess.run(command, check=True, capture_output=True)  # noqa: S603 - SUMO's own program
        return DeviceRun(_tracks(poses), _conflicts(log))


def _trips(network: RoadNetwork, vehicles: int, duration_s: float, seed: int) -> Element:
    rng = random_stream(seed, "benchmarks/ssm_device")
    edges = sorted({network.edges[lane.edge].edge_id for lane in network.lanes if lane.kind is LaneKind.DRIVING})
    root = Element("routes")
    SubElement(root, "vType", {"id": "driver", **_DRIVERS})
    for number in range(vehicles):
        start, end = rng.choice(len(edges), 2, replace=False)
        ways = {"from": edges[int(start)], "to": edges[int(end)]}
        depart = f"{0.6 * duration_s * number / vehicles:.2f}"
        SubElement(root, "trip", {"id": f"v{number}", "type": "driver", "depart": depart, "departSpeed": "max", **ways})
    return root


def _tracks(path: Path) -> dict[str, StateRows]:
    rows: dict[str, list[tuple[float, ...]]] = {}
    for instant in _root(path).iter("timestep"):
        step = round(float(instant.get("time", "")) / STEP_S)
        for vehicle in instant.iter("vehicle"):
            values = tuple(float(vehicle.get(key, "nan")) for key in ("x", "y", "angle", "speed"))
            rows.setdefault(vehicle.get("id", ""), []).append((step, *values))
    return {name: tracks_of(np.array(values)) for name, values in rows.items()}


def tracks_of(values: Floats) -> StateRows:
    """From step, front bumper, SUMO's angle (clockwise from north, in degrees) and speed."""
    step, x, y, angle, speed = values.T
    yaw = np.radians(90.0 - angle)
    cos, sin = np.cos(yaw), np.sin(yaw)
    known = {
        "x_m": x - 0.5 * LENGTH_M * cos,
        "y_m": y - 0.5 * LENGTH_M * sin,
        "yaw_rad": yaw,
        "vx_mps": speed * cos,
        "vy_mps": speed * sin,
    }
    columns: dict[str, Any] = {
        name: np.asarray(known.get(name, np.zeros(len(step))), dtype) for name, dtype in ACTOR_STATE_DTYPES.items()
    }
    return StateRows(step=step.astype(np.int64), **columns)


def _conflicts(path: Path) -> tuple[Conflict, ...]:
    found = []
    for entry in _root(path).iter("conflict"):
        columns = {tag: _words(entry, tag) for tag in ("timeSpan", "typeSpan", "TTCSpan", "DRACSpan")}
        follows = np.array(columns["typeSpan"]) == _FOLLOWER
        if follows.any():
            time, ttc, drac = (
                np.array([_number(word) for word in columns[tag]])[follows]
                for tag in ("timeSpan", "TTCSpan", "DRACSpan")
            )
            found.append(Conflict(entry.get("ego", ""), entry.get("foe", ""), time, ttc, drac))
    return tuple(found)


def _root(path: Path) -> Element:
    root = parse(path).getroot()
    if root is None:
        raise MapError(str(path), "what SUMO writes")
    return root


def _words(entry: Element, tag: str) -> list[str]:
    part = entry.find(tag)
    return [] if part is None else (part.get("values") or "").split()


def _number(word: str) -> float:
    return float("nan") if word == "NA" else float(word)
