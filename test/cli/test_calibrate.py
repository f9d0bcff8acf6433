import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from siren_ros.base.numerics.arrays import Floats
from siren_ros.cli import calibrate
from siren_ros.cli.main import main
from siren_ros.lab.calibration.targets import Situation, Target
from siren_ros.simulation.scenario.episode import EpisodeRequest

NOISE_M = 0.1


@pytest.fixture
def bag(write_bag: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bag whose situation needs no simulation: the error grows with the distance of the headway from 2 s."""

    @contextmanager
    def residuals_over(targets: Sequence[Target], *_: object) -> Iterator[object]:
        assert len(targets) == 1

        def residuals(tries: Sequence[Mapping[str, float]], _: float) -> list[Floats]:
            return [np.array([values["emv_driver.approach.headway_s"] - 2.0, NOISE_M]) for values in tries]

        yield residuals

    monkeypatch.setattr(calibrate, "residuals_over", residuals_over)
    monkeypatch.setattr(Situation, "of_record", lambda _: Situation(EpisodeRequest()))
    return write_bag(tmp_path / "bag", duration_s=2.0)


def test_what_was_found_is_printed_and_written(bag: Path, tmp_path: Path, siren) -> None:
    out = tmp_path / "found.json"
    command = [
        "calibrate",
        str(bag),
        "--parameters",
        "emv_driver.approach.headway_s",
        "--evaluations",
        "100",
        "--workers",
        "1",
    ]
    lines = siren([*command, "--out", str(out)]).out.splitlines()
    name, value, *_ = lines[1].split()
    assert name == "emv_driver.approach.headway_s"
    assert float(value) == pytest.approx(2.0, abs=0.01)
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["values"]["emv_driver.approach.headway_s"] == pytest.approx(2.0, abs=0.01)
    assert written["targets"] == ["bag"]
    assert NOISE_M <= written["error_m"] <= written["start_error_m"]
    assert written["undetermined"] == []
    assert written["agreed"] is True
    assert len(lines) == 3, "nothing to warn of"


def test_what_the_trajectories_do_not_determine_is_said(bag, tmp_path, siren) -> None:
    names = "emv_driver.approach.headway_s,emv_driver.driving.comfort_accel_mps2"
    command = ["calibrate", str(bag), "--parameters", names, "--evaluations", "30", "--workers", "1"]
    *_, named, spent = siren([*command, "--out", str(tmp_path / "found.json")]).out.splitlines()
    assert named.startswith("not determined by these trajectories: emv_driver.driving.comfort_accel_mps2 ")
    assert "more --evaluations" in spent
    assert json.loads((tmp_path / "found.json").read_text())["undetermined"] == [
        "emv_driver.driving.comfort_accel_mps2"
    ]


@pytest.mark.parametrize(
    "options",
    [["--parameters", "mood"], ["--parameters", ""], ["--workers", "0"], ["--evaluations", "2"], ["--trajectory", "no"],
     ["--parameters", "sumo.tau_s"]],
)  # fmt: skip
def test_bad_options_are_refused(bag: Path, options: list[str], siren) -> None:
    assert siren(["calibrate", str(bag), *options], 2).err.count("\n") == 1


def test_a_trajectory_belongs_to_one_bag(bag: Path, write_bag: Callable[..., Path], tmp_path: Path) -> None:
    write_bag(tmp_path / "other", duration_s=1.0)
    assert main(["calibrate", str(tmp_path), "--trajectory", str(bag / "x.csv")]) == 2
