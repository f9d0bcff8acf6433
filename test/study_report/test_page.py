"""How numbers are written."""

from pathlib import Path
from shlex import split

import pytest

from siren_ros.cli.generate import _study_of
from siren_ros.cli.main import parser
from siren_ros.evaluation.statistics.interval import NOTHING, Interval
from siren_ros.studies.matrix import DrawPlan, Method, Study
from siren_ros.study_report.page import command, count_of, generate_command, number, pair, share_of, with_interval


def test_numbers_and_what_is_none() -> None:
    assert [number(value) for value in (0.0, 1.239, -2.0, None)] == ["0.00", "1.24", "-2.00", "–"]
    assert number(1.26, 1) == "1.3"
    assert pair([1.444, None]) == "1.44/–"


def test_an_interval_is_written_where_it_is_bounded() -> None:
    found = Interval(2.284, 2.104, 2.426, 5)
    assert with_interval(found) == "2.28 [2.10, 2.43]"
    assert with_interval(found, 1, "+") == "+2.3 [+2.1, +2.4]"
    assert with_interval(Interval(-2.0, -3.0, 1.0, 5), sign="+") == "-2.00 [-3.00, +1.00]"
    assert with_interval(Interval(2.0, 2.0, 2.0, 1)) == "2.00 [–]"
    assert with_interval(NOTHING) == "–"


def test_a_share_has_wilsons_interval() -> None:
    assert share_of(17, 20) == "17 of 20 [64, 95] %"
    assert share_of(0, 5) == "0 of 5 [0, 43] %"
    assert share_of(3, 4) == "3 of 4 [–]"
    assert share_of(0, 0) == "–"


def test_one_and_several() -> None:
    assert [count_of(count, "bag") for count in (0, 1, 2, 1234)] == ["0 bags", "1 bag", "2 bags", "1,234 bags"]


STUDIES = (
    Study(("S1", "S2"), ("L0", "own"), (0, 1, 7), ("town", "../a map.xodr"), duration_s=30.0, risk_videos=3),
    Study(("S2",), draws=DrawPlan(Method.GRID, values={"emv.speed_mps": [12.5, 14.0], "demand.platoon.vehicles": [4]})),
    Study(("S2",), draws=DrawPlan(Method.RANDOM, samples=3, seed=9), preset="realistic", sensors="lidar", look="rain"),
    Study(("S2",), draws=DrawPlan(Method.LATIN_HYPERCUBE, samples=4, ranges={"emv.speed_mps": (12.0, 14.5)})),
)


@pytest.mark.parametrize("study", STUDIES)
def test_the_command_asks_for_the_same_study(study: Study) -> None:
    words = split(generate_command(study.to_json(), Path("out folder")))
    assert words[:3] == ["./env", "siren", "generate"]
    arguments = parser("generate").parse_args(words[2:])
    assert _study_of(arguments).to_json() == study.to_json()
    assert arguments.out == "out folder"


def test_paths_are_quoted() -> None:
    assert command("evaluate yield", Path("a b"), "--out x") == "./env siren evaluate yield 'a b' --out x"
