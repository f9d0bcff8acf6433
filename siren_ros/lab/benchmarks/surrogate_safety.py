"""Compares TTC and DRAC with SUMO's own device: ``python -m siren_ros.benchmarks.surrogate_safety --vehicles 80``.

Lets impatient drivers go their ways through a map under SUMO alone, and compares both measures where both apply: one
vehicle follows another on its lane, and SUMO's TTC is below 3 s. Prints how far they are apart, moment by moment and in
each pair's extremes.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from defusedxml.ElementTree import parse

from siren_ros.base.numerics.arrays import Floats, random_stream
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import StateRows
from siren_ros.errors import EXIT_OK, MapError
from siren_ros.scoring.judging.surrogate_safety import HORIZON_S, Encounters, predicted_contacts
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.netconvert import sumo_home
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES

LENGTH_M: Final = 4.6
WIDTH_M: Final = 1.8
_FOLLOWER: Final = "2"
"""SUMO's code for an encounter in which the vehicle with the device follows the other on the same lane."""
_DRIVERS: Final = {
    "vClass": "passenger",
    "length": f"{LENGTH_M}",
    "width": f"{WIDTH_M}",
    "tau": "0.5",  # short headways and imperfect drivers cause conflicts to compare
    "sigma": "0.8",
    "minGap": "1.0",
    "speedDev": "0.3",
    "decel": "6.0",
}


@dataclass(frozen=True)
class Conflict:
    """What the device records for one pair while one follows the other; NaN where a measure has no value."""

    follower: str
    leader: str
    time_s: Floats
    time_to_collision_s: Floats
    required_deceleration_mps2: Floats


@dataclass(frozen=True)
class DeviceRun:
    """Results of one run."""

    tracks: Mapping[str, StateRows]
    """Poses and speeds of each vehicle, by SUMO's name."""
    conflicts: tuple[Conflict, ...]


def run_device(net: Path, network: RoadNetwork, vehicles: int, duration_s: float, seed: int) -> DeviceRun:
    """Run SUMO with impatient drivers on the file ``net``; CalledProcessError if SUMO fails."""
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
            **dict.fromkeys(("--no-step-log", "--no-warnings", "--ignore-route-errors"), "true"),
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
    """States from step, front bumper, SUMO's angle (clockwise from north, in degrees) and speed."""
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
    conflicts = []
    for entry in _root(path).iter("conflict"):
        parts = {tag: entry.find(tag) for tag in ("timeSpan", "typeSpan", "TTCSpan", "DRACSpan")}
        columns = {tag: [] if part is None else part.get("values", "").split() for tag, part in parts.items()}
        follows = np.array(columns["typeSpan"]) == _FOLLOWER
        if follows.any():
            time, ttc, drac = (
                np.array([float("nan") if word == "NA" else float(word) for word in columns[tag]])[follows]
                for tag in ("timeSpan", "TTCSpan", "DRACSpan")
            )
            conflicts.append(Conflict(entry.get("ego", ""), entry.get("foe", ""), time, ttc, drac))
    return tuple(conflicts)


def _root(path: Path) -> Element:
    root = parse(path).getroot()
    if root is None:
        raise MapError(str(path), "what SUMO writes")
    return root


@dataclass(frozen=True)
class Compared:
    """One pair: SUMO's measures and ours at the same moments, each of shape ``(N,)``."""

    sumo_ttc_s: Floats
    our_ttc_s: Floats
    """Our TTC; infinite if the footprints miss each other."""
    sumo_drac_mps2: Floats
    our_drac_mps2: Floats


@dataclass(frozen=True)
class Agreement:
    """Differences between SUMO's device and SIREN in TTC and DRAC."""

    pairs: int
    moments: int
    missed: int
    """Number of moments at which SUMO has a conflict and SIREN's footprints miss each other."""
    ttc_s: Floats
    """Differences at moments with a value on both sides, shape ``(M,)``."""
    drac_mps2: Floats
    least_ttc_s: Floats
    """Differences of each pair's smallest TTC, shape ``(P,)``."""
    most_drac_mps2: Floats


def compare(run: DeviceRun) -> tuple[Compared, ...]:
    """Measures of SUMO and of SIREN for each pair of vehicles that has a TTC below the horizon."""
    pairs = (_pair(run, conflict) for conflict in run.conflicts)
    return tuple(pair for pair in pairs if len(pair.sumo_ttc_s))


def _pair(run: DeviceRun, conflict: Conflict) -> Compared:
    follower, leader = run.tracks[conflict.follower], run.tracks[conflict.leader]
    steps = np.rint(conflict.time_s / STEP_S).astype(np.int64)
    known = conflict.time_to_collision_s < HORIZON_S
    known &= np.isin(steps, follower.step) & np.isin(steps, leader.step)
    mine, theirs = (np.searchsorted(track.step, steps[known]) for track in (follower, leader))
    size = (LENGTH_M, WIDTH_M)
    encounters = Encounters(follower.select(mine), leader.select(theirs), size, np.tile(size, (len(mine), 1)))
    contacts = predicted_contacts(encounters)
    sumo_ttc_s, sumo_drac_mps2 = conflict.time_to_collision_s[known], conflict.required_deceleration_mps2[known]
    return Compared(sumo_ttc_s, contacts.time_s, sumo_drac_mps2, contacts.required_deceleration_mps2)


def agreement_of(pairs: Sequence[Compared]) -> Agreement:
    """Differences over all moments and over each pair's extremes; pairs without our values count only as missed."""
    seen = [(pair, np.isfinite(pair.our_ttc_s)) for pair in pairs]
    both = [pair for pair, known in seen if known.any()]
    return Agreement(
        pairs=len(pairs),
        moments=sum(len(known) for _, known in seen),
        missed=sum(int(np.count_nonzero(~known)) for _, known in seen),
        ttc_s=_joined([np.abs(pair.our_ttc_s - pair.sumo_ttc_s)[known] for pair, known in seen]),
        drac_mps2=_joined([np.abs(pair.our_drac_mps2 - pair.sumo_drac_mps2)[known] for pair, known in seen]),
        least_ttc_s=np.array([abs(pair.our_ttc_s.min() - pair.sumo_ttc_s.min()) for pair in both]),
        most_drac_mps2=np.array([abs(pair.our_drac_mps2.max() - np.nanmax(pair.sumo_drac_mps2)) for pair in both]),
    )


def _joined(parts: Sequence[Floats]) -> Floats:
    values = np.concatenate([np.empty(0), *parts])
    return values[np.isfinite(values)]


def lines_of(agreement: Agreement) -> list[str]:
    """Result as text lines."""
    count = f"{agreement.pairs} pairs that follow each other, {agreement.moments} moments with SUMO's TTC below "
    lines = [f"{count}{HORIZON_S:g} s; at {agreement.missed} the swept footprints miss each other"]
    for what, unit, values in (
        ("TTC", "s", agreement.ttc_s),
        ("DRAC", "m/s²", agreement.drac_mps2),
        ("least TTC of a pair", "s", agreement.least_ttc_s),
        ("greatest DRAC of a pair", "m/s²", agreement.most_drac_mps2),
    ):
        if len(values):
            middle, late, most = np.percentile(values, (50.0, 99.0, 100.0))
            lines.append(
                f"{what}: apart by {middle:.2g} {unit} (median), {late:.2g} (99th percentile), {most:.2g} (most)"
            )
    return lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run SUMO and print the differences."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--map", type=Path, help="map file (default: the town)")
    parser.add_argument("--vehicles", type=int, default=80, help="(default %(default)s)")
    parser.add_argument("--duration-s", type=float, default=90.0, help="(default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="(default %(default)s)")
    given = parser.parse_args(arguments)
    compiled = compile_map(given.map)
    network = parse_road_network(compiled.net_path.read_bytes())
    run = run_device(compiled.net_path, network, given.vehicles, given.duration_s, given.seed)
    print("\n".join(lines_of(agreement_of(compare(run)))))
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
