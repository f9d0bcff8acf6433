"""One measurement on many bags."""

import os
from pathlib import Path

import pytest

from siren_ros.cli.options.each_bag import of_each_bag
from siren_ros.errors import BagError, EpisodeError
from siren_ros.recording.bag_reader import read_episode


def length_of_name(bag: Path) -> int:
    if bag.name == "gone":
        raise BagError(str(bag), "a bag")
    if bag.name == "broken":
        raise EpisodeError("it ended early")
    return len(bag.name)


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_bag_is_measured(jobs: int) -> None:
    bags = [Path("/a/b"), Path("/a/bcd"), Path("/a/bc")]
    found, code = of_each_bag(os.fspath, bags, jobs)
    assert sorted(found) == ["/a/b", "/a/bc", "/a/bcd"]
    assert code == 0


@pytest.mark.parametrize("jobs", [1, 2])
def test_errors_come_back_from_processes(jobs: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found, code = of_each_bag(read_episode, [tmp_path / "none", tmp_path / "neither"], jobs)
    assert found == []
    assert code == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    assert "neither" in "".join(told)


@pytest.mark.parametrize(
    ("names", "worst"), [(["ab", "broken"], 1), (["gone", "ab"], 2), (["gone", "ab", "broken"], 2)]
)
def test_bags_that_cannot_be_read_keep_none_back(
    names: list[str], worst: int, capsys: pytest.CaptureFixture[str]
) -> None:
    found, code = of_each_bag(length_of_name, [Path(name) for name in names], 1)
    assert found == [2]
    assert code == worst
    told = capsys.readouterr().err
    assert ("it ended early" in told) == ("broken" in names)
    assert ("gone" in told) == ("gone" in names)
