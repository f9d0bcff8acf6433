import argparse
from dataclasses import replace

import numpy as np
import pytest

from siren_ros.lab.benchmarks.templates import (
    EpisodeFigures,
    compared_row,
    compared_text,
    details_of,
    json_row,
    longest_standstill_s,
    placebo_levels,
    placebo_row,
    row_of,
    seeds_of_option,
    spread_of,
    travel_times_s,
)
from siren_ros.scoring.judging.outcome import Realisation
from siren_ros.simulation.scenario.templates import available_templates


def figures(seed: int, way_m: list[float], *, holds: bool = False, failing: tuple[str, ...] = ()) -> EpisodeFigures:
    return EpisodeFigures("S1", seed, holds=holds, failing=failing, way_m=np.array(way_m), cv_ade_m=1.0)


def test_longest_standstill_counts_one_unbroken_stop() -> None:
    speed = np.array([0.0] * 10 + [5.0] + [0.05] * 30 + [1.0] + [0.0] * 20)
    assert longest_standstill_s(speed) == pytest.approx(1.5)
    assert longest_standstill_s(np.array([1.0, 2.0])) == 0.0


def test_travel_times_compare_the_way_that_both_cover() -> None:
    slow, fast = figures(0, [1.0, 2.0, 3.0, 4.0]), figures(0, [2.0, 4.0, 6.0, 8.0])
    assert travel_times_s(slow, fast) == pytest.approx((0.15, 0.05))


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
    lost = compared_row("S2", ("L1", "L2"), ([EpisodeFigures("S2", 0, error="no site")], second[:1]))
    assert (lost["seeds"], lost["failed"]) == (0, 1)
    assert compared_text(lost).endswith("no episode ran")


def test_rows_count_what_holds_and_failures_are_named() -> None:
    episodes = [
        figures(0, [1.0], holds=True),
        figures(1, [1.0], failing=("holding: 2 (needs >= 6)",)),
        EpisodeFigures("S1", 2, error="SUMO teleported"),
    ]
    assert row_of("S1", episodes).split()[:3] == ["S1", "1/3", "1"]
    lines = list(details_of(episodes))
    assert any("seed 1" in line and "holding" in line for line in lines)
    assert any("seed 2: failed, SUMO teleported" in line for line in lines)


def test_seeds_are_a_range_or_a_number() -> None:
    assert seeds_of_option("3:5") == (3, 4)
    assert seeds_of_option("7") == (7,)
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


def test_the_spread_of_seeds_is_printed_with_its_standard_deviation() -> None:
    arrivals = ((6.0, 2), (10.0, 4), (float("nan"), 0))
    episodes = [
        replace(figures(seed, [1.0]), realisation=Realisation(arrival_s, queue, 3, 8.0))
        for seed, (arrival_s, queue) in enumerate(arrivals)
    ]
    text = spread_of(episodes)
    assert "arrival s 8.0 +- 2.0" in text
    assert "queue 2.0 +- 1.6" in text
    assert "yielding 3.0 +- 0.0" in text
    assert "no episode ran" in spread_of([EpisodeFigures("S1", 0, error="failed")])


def test_the_json_row_has_the_numbers_of_the_printed_one() -> None:
    row = json_row("S1", [figures(0, [1.0], holds=True), figures(1, [1.0]), EpisodeFigures("S1", 2, error="died")])
    assert (row["holds"], row["episodes"], row["failed"], row["arrival_s"]) == ("1/3", 3, 1, None)
    assert json_row("S1", [EpisodeFigures("S1", 0, error="no site")])["holds"] == "–"
