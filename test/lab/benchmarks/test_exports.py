from collections.abc import Callable
from pathlib import Path

import pytest

from siren_ros.lab.benchmarks.exports import export_time_s, main


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> list[Path]:
    folder = tmp_path_factory.mktemp("bags")
    return [write_bag(folder / f"{civilians}", duration_s=1.0, civilians=civilians, lidar=True) for civilians in (2, 3)]


def test_an_export_is_timed_with_its_episodes(bags: list[Path]) -> None:
    wall_s, simulated_s = export_time_s("openpcdet", bags, 1)
    assert wall_s > 0.0
    assert simulated_s == 2.0


def test_one_row_for_each_format(bags: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*map(str, bags), "--formats", "openpcdet"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["format", "one", "bag", "two", "bags", "loops", "share"]
    assert lines[1].split()[0] == "openpcdet"
    assert len(lines[1].split()) == 5
