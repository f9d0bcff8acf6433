"""The figures beside SUMO's bluelight device, on records made by hand, and SUMO's own drive."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from hand_made_record import EMV, Driven, hand_made
from made_jam import AT_SIDE_M, LENGTH_M, WIDTH_M, at, jam

from siren_ros.base.numerics.units import STEP_S
from siren_ros.lab.benchmarks.rescue_lane import AFTER_S, RescueFigures, bluelight_steps, figures_of, means_of, row_of
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.world.actors import Owner

PREDICATE = {"name": "rescue_lane", "thresholds": dict(load_template("S8").predicate.thresholds)}


def judged(record):
    return replace(record, description=replace(record.description, parameters={"predicate": PREDICATE}))


def names(record):
    return frozenset(actor.name for actor in record.actors.values() if not actor.is_emv)


def test_an_open_lane_is_driven_through_in_the_time_that_its_length_takes():
    record = judged(jam(drive_m=800.0))
    figures = figures_of(record, names(record))
    assert (figures.open_before, figures.open_after) == (1.0, 1.0)
    way_m = 19 * 8.0 + 4.0 + 6.0  # from the rear of the last car to the front of the first one, and the EMV's length
    assert figures.through_s == pytest.approx(way_m / 8.0, abs=0.6)
    assert figures.jam_m == pytest.approx(way_m, abs=4.0)
    assert (figures.overlaps, figures.emv_overlaps, figures.overtaking) == (0, 0, 0)
    assert np.isnan(figures.off_middle), "nobody of the jam flows"
    assert row_of("0 SIREN", asdict(figures)).split()[:4] == ["0", "SIREN", "1.00", "1.00"]


def test_an_emv_that_stays_in_the_jam_has_no_time():
    record = judged(jam())
    short = replace(record, states=record.states[: int(35.0 / STEP_S)])
    figures = figures_of(short, names(record))
    assert np.isnan(figures.through_s)
    assert 20.0 < figures.jam_m < 60.0
    assert np.isnan(figures.open_after), f"nobody looked {AFTER_S:.0f} s later"


def test_bodies_that_overlap_and_civilians_that_overtake_are_counted():
    record = judged(jam(more=[(303.0, AT_SIDE_M), (320.0, -0.5 * WIDTH_M)]))
    figures = figures_of(record, names(record))
    assert figures.overlaps == 2, "two cars, and the EMV with one in the corridor"
    assert figures.emv_overlaps == 1


def test_a_civilian_that_comes_from_behind_overtakes():
    line = np.array([at(0.0, -0.5 * WIDTH_M), at(LENGTH_M, -0.5 * WIDTH_M)])
    right = np.array([at(0.0, -WIDTH_M), at(LENGTH_M, -WIDTH_M)])
    time_s = STEP_S * np.arange(600)
    vehicles = {EMV: Driven(line, 100.0 + 8.0 * time_s), 2: Driven(right, 60.0 + 20.0 * time_s)}
    made = hand_made(jam().network, vehicles)
    site = {"stretch": ["road"], "route": ["road"]}
    record = judged(replace(made, description=replace(made.description, site=site)))
    figures = figures_of(record, names(record))
    assert figures.overtaking == 1
    assert figures.off_middle == 0.0
    aside = np.array([at(0.0, -WIDTH_M - 0.5), at(LENGTH_M, -WIDTH_M - 0.5)])
    moved = hand_made(made.network, {**vehicles, 2: Driven(aside, 60.0 + 20.0 * time_s)})
    record = judged(replace(moved, description=replace(moved.description, site=site)))
    assert figures_of(record, names(record)).off_middle == 1.0


def test_sumo_drives_everybody_alone():
    setup = set_up_episode(EpisodeRequest("S8", sensors="none"))
    steps = list(bluelight_steps(setup, 100))
    emv = [step.states.actor_id.tolist().index(1) for step in steps]
    assert all((step.traffic.owner == Owner.SUMO).all() for step in steps)
    ways_m = [
        float(np.hypot(after.states.x_m[b] - before.states.x_m[a], after.states.y_m[b] - before.states.y_m[a]))
        for before, after, a, b in zip(steps[:-1], steps[1:], emv[:-1], emv[1:], strict=True)
    ]
    speeds_mps = [float(step.states.speed_mps[row]) for step, row in zip(steps[1:], emv[1:], strict=True)]
    assert np.array(ways_m) / STEP_S == pytest.approx(speeds_mps, abs=0.5)
    assert min(speeds_mps) > 20.0


def test_means_leave_out_what_a_drive_does_not_have():
    one = RescueFigures(1.0, 0.5, 40.0, 300.0, 2, 1, 0, 0.1)
    other = RescueFigures(0.5, np.nan, np.nan, 100.0, 5, 0, 3, 0.3)
    means = means_of([one, other])
    assert (means["open_before"], means["open_after"], means["through_s"]) == (0.75, 0.5, 40.0)
    assert (means["overlaps"], means["overtaking"], means["off_middle"]) == (3.5, 1.5, pytest.approx(0.2))
    assert np.isnan(means_of([other])["open_after"])
