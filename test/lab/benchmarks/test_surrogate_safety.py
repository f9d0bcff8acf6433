"""Our TTC and DRAC held against SUMO's device: on hand-made tracks, and in a short run of SUMO."""

import numpy as np
import pytest

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import StateRows
from siren_ros.lab.benchmarks.surrogate_safety import (
    LENGTH_M,
    Conflict,
    DeviceRun,
    agreement_of,
    compare,
    lines_of,
    run_device,
    tracks_of,
)
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network

STEPS = np.arange(20)


def track(front_m: float, speed_mps: float, y_m: float = 0.0) -> StateRows:
    """Eastwards; SUMO's angle is clockwise from north."""
    x = front_m + speed_mps * STEP_S * STEPS
    angle, speed = np.full(len(STEPS), 90.0), np.full(len(STEPS), speed_mps)
    return tracks_of(np.stack((STEPS, x, np.full(len(STEPS), y_m), angle, speed), axis=1))


def run_of(leader: StateRows) -> DeviceRun:
    gap = 15.0 - LENGTH_M - 5.0 * STEP_S * STEPS
    conflict = Conflict("f", "l", STEPS * STEP_S, gap / 5.0, 5.0**2 / (2.0 * gap))
    return DeviceRun({"f": track(0.0, 15.0), "l": leader}, (conflict,))


def test_a_follower_agrees_with_the_formula() -> None:
    agreement = agreement_of(compare(run_of(track(15.0, 10.0))))
    assert (agreement.pairs, agreement.moments, agreement.missed) == (1, 20, 0)
    assert agreement.ttc_s.max() < 1e-9
    assert agreement.drac_mps2.max() < 1e-9
    assert agreement.least_ttc_s.tolist() == pytest.approx([0.0], abs=1e-9)
    assert lines_of(agreement)[0].startswith("1 pairs that follow each other, 20 moments")


def test_a_leader_at_the_side_is_missed_by_the_footprints() -> None:
    agreement = agreement_of(compare(run_of(track(15.0, 10.0, y_m=2.0))))
    assert (agreement.moments, agreement.missed, len(agreement.ttc_s), len(agreement.least_ttc_s)) == (20, 20, 0, 0)
    assert len(lines_of(agreement)) == 1


def test_a_run_of_sumo_agrees_with_its_own_device() -> None:
    compiled = compile_map(None)
    network = parse_road_network(compiled.net_path.read_bytes())
    agreement = agreement_of(compare(run_device(compiled.net_path, network, 25, 30.0, 3)))
    assert agreement.moments > 50
    assert agreement.missed < 0.1 * agreement.moments
    # On straight lanes both are the same formula; in bends SUMO measures along the lane, and the footprints turn.
    assert np.median(agreement.ttc_s) < 1e-5
    assert np.median(agreement.drac_mps2) < 1e-5
    assert np.percentile(agreement.ttc_s, 95) < 0.05
