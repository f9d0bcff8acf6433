"""The commands that a page names."""

from pathlib import Path
from shlex import split

import pytest

from siren_ros.cli.generate import _study_of
from siren_ros.cli.main import parser
from siren_ros.studies.matrix import DrawPlan, Method, Study
from siren_ros.study_report.page import command, generate_command

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
    arguments = parser().parse_args(words[2:])
    assert _study_of(arguments).to_json() == study.to_json()
    assert arguments.out == "out folder"


def test_paths_are_quoted() -> None:
    assert command("evaluate yield", Path("a b"), "--out x") == "./env siren evaluate yield 'a b' --out x"
