"""Benchmarks over many episodes: templates, rescue lanes, left-hand traffic, surrogate safety."""

import argparse
from dataclasses import replace
from functools import cache
from json import loads
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from busy_record import busy_record
from hand_made_record import EMV, Driven, actor_states, hand_made
from known_outputs import assert_known
from made_jam import AT_SIDE_M, LENGTH_M, WIDTH_M, at, jam

from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import StateRows
from siren_ros.lab.benchmarks import rescue_lane, templates
from siren_ros.lab.benchmarks.left_hand import compare as compare_mirrored
from siren_ros.lab.benchmarks.rescue_lane import (
    AFTER_S,
    RescueFigures,
    bluelight_steps,
    figures_of,
    means_of,
    sumo_states,
)
from siren_ros.lab.benchmarks.surrogate_safety import (
    LENGTH_M as CAR_LENGTH_M,
)
from siren_ros.lab.benchmarks.surrogate_safety import (
    Conflict,
    DeviceRun,
    agreement_of,
    compare,
    lines_of,
    run_device,
    tracks_of,
)
from siren_ros.lab.benchmarks.templates import (
    EpisodeFigures,
    compared_row,
    compared_text,
    placebo_levels,
    placebo_row,
    seeds_of_option,
    travel_times_s,
)
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.scoring.judging.outcome import Realisation
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import mirror_image
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.templates import available_templates, load_template
from siren_ros.simulation.world.actors import Event, EventKind, Owner


def figures(seed: int, way_m: list[float], *, holds: bool = False, failing: tuple[str, ...] = ()) -> EpisodeFigures:
    return EpisodeFigures("S1", seed, holds=holds, failing=failing, way_m=np.array(way_m), cv_ade_m=1.0)


def test_levels_are_compared_by_the_way_in_the_same_time_with_an_interval() -> None:
    """Gains of 100 %, 50 % and 0 %: the interval is Student's with two degrees of freedom."""
    first = [figures(seed, [1.0, 2.0, 4.0]) for seed in (7, 8, 9)]
    second = [figures(7, [2.0, 4.0, 8.0, 99.0]), figures(8, [1.0, 3.0, 6.0]), figures(9, [1.0, 3.0, 4.0])]
    row = compared_row("S2", ("L1", "L2"), (first, second))
    half = 4.3027 * 0.5 / np.sqrt(3.0)
    interval = row["distance"]
    assert (interval["value"], interval["low"]) == pytest.approx((0.5, 0.5 - half), abs=1e-4)
    assert (row["farther"], row["least"], row["least_seed"], row["seeds"]) == (2, 0.0, 9, 3)
    assert row["not_farther"] == [9]
    assert "L2 against L1" in compared_text(row)
    assert "+50 %" in compared_text(row).replace("%", " %")
    slow, fast = figures(0, [1.0, 2.0, 3.0, 4.0]), figures(0, [2.0, 4.0, 6.0, 8.0])
    assert travel_times_s(slow, fast) == pytest.approx((0.15, 0.05)), "over the way that both cover"
    lost = compared_row("S2", ("L1", "L2"), ([EpisodeFigures("S2", 0, error="no site")], second[:1]))
    assert (lost["seeds"], lost["failed"]) == (0, 1)
    assert compared_text(lost).endswith("no episode ran")


def test_seeds_are_a_range_or_a_number() -> None:
    assert (seeds_of_option("3:5"), seeds_of_option("7")) == ((3, 4), (7,))
    for text in ("a", "5:5", "1:b"):
        with pytest.raises(argparse.ArgumentTypeError):
            seeds_of_option(text)


def test_the_placebo_of_a_template_is_every_level_without_its_cause() -> None:
    names = {name: [level.name for level in placebo_levels(name)] for name in available_templates()}
    assert names["S1"] == ["L0", "L1", "L2"]
    assert names["S2"] == ["L0", "L1"]
    assert all(names[f"S{number}"] == ["L0"] for number in range(3, 8))
    assert names["S8"] == ["L0", "L1", "L2"]
    row = placebo_row("S2", {"L0": [figures(0, [1.0]), figures(1, [1.0], holds=True)], "L1": [figures(0, [1.0])]})
    assert row.endswith("L0 1/2, L1 0/1")


PREDICATE = {"name": "rescue_lane", "thresholds": dict(load_template("S8").predicate.thresholds)}


def judged(record):
    return replace(record, description=replace(record.description, parameters={"predicate": PREDICATE}))


def names(record):
    return frozenset(actor.name for actor in record.actors.values() if not actor.is_emv)


def test_an_emv_that_stays_in_the_jam_has_no_time():
    record = judged(jam())
    short = replace(record, states=record.states[: int(35.0 / STEP_S)])
    figures = figures_of(short, names(record))
    assert np.isnan(figures.through_s)
    assert 20.0 < figures.jam_m < 60.0
    assert np.isnan(figures.open_after), f"nobody looked {AFTER_S:.0f} s later"


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


EVENT = Event(0, EventKind.YIELD_HELD, 5, 1, 2.0, 7.0, {"side": -1})


def step(x_m, y_m, ids=(1, 5), events=(EVENT,)):
    return SimpleNamespace(states=actor_states(0, actor_id=ids, x_m=x_m, y_m=y_m), events=events)


def image_of(one):
    return SimpleNamespace(states=mirror_image(one.states), events=tuple(map(mirror_image, one.events)))


OWN = step((1.0, 4.0), (3.0, -2.0))


def test_distances_events_and_actors_of_a_mirror_image():
    found = compare_mirrored([OWN, OWN], [image_of(OWN), image_of(OWN)])
    assert (found.apart_m, found.events_differ) == (0.0, False)
    moved = image_of(step((1.0, 4.3), (3.0, -1.6)))
    assert compare_mirrored([OWN, OWN], [moved, image_of(OWN)]).apart_m == pytest.approx(0.5), "the largest of all"
    assert compare_mirrored([OWN], [OWN]).apart_m == pytest.approx(6.0), "not mirrored"
    other = image_of(step((1.0, 4.0), (3.0, -2.0), events=(replace(EVENT, actor_id=6),)))
    assert compare_mirrored([OWN, OWN], [other, image_of(OWN)]).events_differ, "at any of the steps"
    assert compare_mirrored([OWN], [image_of(step((1.0, 4.0), (3.0, -2.0), ids=(1, 6)))]).apart_m == float("inf")


STEPS = np.arange(20)


def track(front_m: float, speed_mps: float, y_m: float = 0.0) -> StateRows:
    """Eastwards; SUMO's angle is clockwise from north."""
    x = front_m + speed_mps * STEP_S * STEPS
    angle, speed = np.full(len(STEPS), 90.0), np.full(len(STEPS), speed_mps)
    return tracks_of(np.stack((STEPS, x, np.full(len(STEPS), y_m), angle, speed), axis=1))


def run_of(leader: StateRows) -> DeviceRun:
    gap = 15.0 - CAR_LENGTH_M - 5.0 * STEP_S * STEPS
    conflict = Conflict("f", "l", STEPS * STEP_S, gap / 5.0, 5.0**2 / (2.0 * gap))
    return DeviceRun({"f": track(0.0, 15.0), "l": leader}, (conflict,))


def test_a_follower_agrees_with_the_formula() -> None:
    agreement = agreement_of(compare(run_of(track(15.0, 10.0))))
    assert (agreement.pairs, agreement.moments, agreement.missed) == (1, 20, 0)
    assert agreement.ttc_s.max() < 1e-9
    assert agreement.drac_mps2.max() < 1e-9
    assert agreement.least_ttc_s.tolist() == pytest.approx([0.0], abs=1e-9)
    assert lines_of(agreement)[0].startswith("1 pairs that follow each other, 20 moments")
    agreement = agreement_of(compare(run_of(track(15.0, 10.0, y_m=2.0))))  # the footprints miss it
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


@cache
def busy_figures() -> EpisodeFigures:
    return templates.figures_of(busy_record(), EpisodeRequest("S2"), 0.0)


def drawn_figures(task: templates.EpisodeTask) -> EpisodeFigures:
    """Figures of a busy record; the second seed fails, those of the others differ, and higher levels drive farther."""
    request, more = task.request, 1.0 + 0.1 * task.request.seed
    if request.seed == 4:
        return EpisodeFigures(request.template, request.seed, error="SUMO ended")
    named = {"template": request.template, "seed": request.seed}
    found = replace(busy_figures(), **named, step_ms=2.5 + request.seed if task.timed else float("nan"))
    scaled = {name: value * more for name, value in vars(found).items() if isinstance(value, float)}
    physics = {name: value * more for name, value in vars(found.physics).items() if isinstance(value, float)}
    seen = Realisation(*(value * more for value in vars(found.realisation).values()))
    return replace(
        replace(found, **scaled, realisation=seen, physics=replace(found.physics, **physics, contacts=request.seed)),
        way_m=found.way_m * (1.0 + 0.01 * int((request.level or "L1")[1]) * (request.seed - 4)),
        holds=request.seed != 6,
        failing=("through: 0 (needs >= 1)",) * (request.seed == 6),
        violations=found.violations[: (6 - request.seed) // 2],
        teleports=2 * request.seed,
        residual_max_m=1.0 + more,
    )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("plain", "--templates S3 --seeds 3:7"),
        ("compared", "--templates S2 --seeds 3:9 --compare L0 L1 L3"),
        ("placebo", "--templates S2 S8 --seeds 5:7 --placebo"),
    ],
)
def test_what_is_printed_and_written_of_busy_episodes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path, name: str, words: str
) -> None:
    monkeypatch.setattr(templates, "measure_all", lambda tasks, _: [drawn_figures(task) for task in tasks])
    assert templates.main([*words.split(), "--json", str(tmp_path / "a.json")]) == 0
    rows = loads((tmp_path / "a.json").read_text())
    found = {
        "printed": capsys.readouterr().out.splitlines(),
        "written": rows[:1] + [[*row.values()] for row in rows[1:]],
    }
    assert_known(Path(__file__).parent / "known" / f"templates_{name}.json", found, digits=5)


def test_what_is_printed_of_busy_jams(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Jams that differ in width, speed and cars between the lanes; SUMO's states of a busy record."""
    more = [(303.0, AT_SIDE_M), (320.0, -0.5 * WIDTH_M)]
    records = {
        "SIREN": [jam(drive_m=800.0), jam(0.5 * AT_SIDE_M, drive_m=600.0)],
        "bluelight": [jam(right_offset_m=0.1, speed_mps=10.0, drive_m=700.0), jam(more=more, drive_m=500.0)],
    }
    figures = {name: [figures_of(judged(one), names(one)) for one in found] for name, found in records.items()}
    monkeypatch.setattr(rescue_lane, "compare", lambda one: {name: of[one.seed - 5] for name, of in figures.items()})
    assert rescue_lane.main(["--seeds", "5:7", "--json", str(tmp_path / "a.json")]) == 0
    states = sumo_states(replace(busy_record().traffic[150], step=7))
    found = {
        "printed": capsys.readouterr().out.splitlines(),
        "written": loads((tmp_path / "a.json").read_text()),
        "states": {name: getattr(states, name) for name in ("actor_id", "x_m", "y_m", "yaw_rad", "vx_mps", "vy_mps")},
    }
    assert_known(Path(__file__).parent / "known" / "rescue_lane.json", found, digits=5)


def test_agreement_of_three_pairs_of_a_busy_record() -> None:
    """What a device states: our measures a little off, gaps in them, and a pair that it sees where we do not."""
    record = busy_record()
    tracks = {f"v{key}": record.track(key) for key in (1, 2, 3, 10)}
    time_s = 0.05 * np.arange(60, 80)
    pairs = (("v1", "v2", time_s), ("v1", "v3", time_s + 5.7), ("v1", "v10", 0.05 * np.arange(300, 330)))
    conflicts = []
    for number, (follower, leader, at_s) in enumerate(pairs):
        ttc_s = 2.8 - 0.1 * np.arange(len(at_s)) + 0.4 * number
        drac_mps2 = np.where(np.arange(len(at_s)) % 4 > 0, 3.0 / ttc_s, np.nan)
        conflicts.append(Conflict(follower, leader, at_s, ttc_s, drac_mps2))
    compared = compare(DeviceRun(tracks, tuple(conflicts)))
    agreement = agreement_of(compared)
    assert_known(
        Path(__file__).parent / "known" / "device.json", [agreement, lines_of(agreement), compared[2]], digits=5
    )
