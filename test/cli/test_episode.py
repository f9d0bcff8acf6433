"""``siren episode``: one episode without ROS, from the choices of the library."""

from pathlib import Path

import pytest

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest

QUICK = ("--sensors", "none", "--duration-s", "0.5")


def test_it_makes_a_bag_says_how_it_ended_and_what_can_follow(siren, tmp_path: Path) -> None:
    bag = str(tmp_path / "my bag")
    words = ["episode", "S3", "--level", "1", "--seed", "4", *QUICK, "--out", bag]
    printed = siren(words)
    ended, following = printed.out.splitlines()
    assert ended.startswith(f"{bag} (")
    assert "episode complete after 0.50 s; its interaction did not happen" in ended
    assert f"`siren verify '{bag}'`" in following
    request = read_episode(Path(bag)).description.asked
    expected = EpisodeRequest("S3", "L1", 4, sensors="none", duration_s=0.5)
    assert request == expected.to_json()
    assert "--overwrite" in siren(words, 2).err
    siren([*words, "--overwrite"])
    siren([*words, "--overwrite", "--strict"], 1)


def test_its_place_is_that_of_cosim(siren, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    siren(["episode", *QUICK])
    assert (tmp_path / "bags" / "S2_L2_seed0" / "metadata.yaml").is_file()


@pytest.mark.parametrize(
    ("words", "named"),
    [(["S9"], "template: 'S9'"), (["--level", "L7"], "level: 'L7'"), (["--duration-s", "-1"], "duration_s: -1.0")],
)
def test_bad_choices_are_one_line(siren, words: list[str], named: str) -> None:
    printed = siren(["episode", *words], 2)
    assert printed.err.startswith(f"siren episode: {named} cannot be used")
    assert printed.err.count("\n") == 1
