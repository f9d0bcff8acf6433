"""A dataset's card: sums over episodes, splits, and the same for people."""

import json
from pathlib import Path
from typing import Any

import pytest

import siren_ros
from siren_ros.datasets.exporting.dataset_card import NO_LICENCE, card, readme, write_card
from siren_ros.datasets.exporting.format import EpisodePart, EpisodeReport, Format, Option
from siren_ros.datasets.exporting.survey import BagSurvey, episode_name, in_dataset_order
from siren_ros.datasets.sources.needs import Need
from siren_ros.errors import InputError

FORMAT = Format(
    "made",
    "Frames of formulas",
    (Need.LIDAR, Need.CAMERA),
    "nowhere:Exporter",
    (Option("layout", "wide", ("wide", "paper"), "which", {"paper": (Need.CAMERA,)}), Option("near", "no", (), "how")),
)


def survey(seed: int, sha256: str, note: str = "", map_name: str = "town") -> BagSurvey:
    episode = {
        "template": "S2",
        "level": "L1",
        "seed": seed,
        "map": map_name,
        "map_sha256": "5e" * 32,
        "planned_duration_s": 20.0,
        "sensor_suite": "full",
        "ended": "complete",
        "recorded_with": f"ros2 run siren_ros cosim --ros-args -p seed:={seed}",
    }
    return BagSurvey(f"/bags/{seed}", f"/bags/{seed}", sha256, note, episode)


def part(index: int, split: str, frames: int, **classes: int) -> EpisodePart:
    return EpisodePart(f"episode{index}", index, split, Path("/nowhere"), EpisodeReport({"frames": frames}, classes))


def content(note: str = "") -> dict[str, Any]:
    surveys = [survey(1, "aa" * 32), survey(2, "bb" * 32, note)]
    return card(FORMAT, {"layout": "wide"}, surveys, [part(0, "train", 3, car=5, bus=1), part(1, "val", 4, car=2)], "")


def test_counts_are_summed_over_episodes() -> None:
    found = content()
    assert found["counts"] == {"frames": 7}
    assert found["classes"] == {"bus": 1, "car": 7}
    assert list(found["classes"]) == ["bus", "car"], "by name"
    assert [one["counts"] for one in found["episodes"]] == [{"frames": 3}, {"frames": 4}]
    assert [(one["id"], one["seed"], one["bag_sha256"][:2]) for one in found["episodes"]] == [
        ("episode0", 1, "aa"),
        ("episode1", 2, "bb"),
    ]
    assert found["splits"] == {"train": ["episode0"], "val": ["episode1"], "test": []}
    assert found["made_with"] == {
        "command": "siren export made --layout wide BAG… --out DIR",
        "siren_ros": siren_ros.__version__,
        "options": {"layout": "wide"},
    }
    assert (found["format"], found["what"], found["licence"]) == ("made", "Frames of formulas", NO_LICENCE)


def test_people_read_the_same() -> None:
    lines = readme(content()).splitlines()
    assert lines[0] == "# SIREN dataset, format made"
    for line in (
        "Frames of formulas.",
        f"Licence: {NO_LICENCE}.",
        "| episodes | 2 |",
        "| frames | 7 |",
        "| car | 7 |",
        "* train: episode0",
        "* val: episode1",
        "* test: none",
        "| episode0 | town (5e5e5e5e5e5e…) | full | complete | aaaaaaaaaaaa… |",
        "    ros2 run siren_ros cosim --ros-args -p seed:=1",
    ):
        assert line in lines
    assert "## Not whole" not in lines
    assert "| class | labels |" in lines
    without = readme(content() | {"classes": {}}).splitlines()
    assert "| class | labels |" not in without


def test_what_is_lost_is_said_at_the_end() -> None:
    lines = readme(content("the bag was cut off")).splitlines()
    assert lines[-3:] == ["## Not whole", "", "* episode1: the bag was cut off"]


def test_a_readme_of_the_format_stays_at_the_head(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("# Mine\n", encoding="utf-8")
    write_card(tmp_path, content())
    assert (tmp_path / "README.md").read_text(encoding="utf-8") == "# Mine\n\n" + readme(content())
    assert json.loads((tmp_path / "dataset.json").read_text(encoding="utf-8")) == content()
    (tmp_path / "new").mkdir()
    write_card(tmp_path / "new", content())
    assert (tmp_path / "new" / "README.md").read_text(encoding="utf-8") == readme(content())


def test_a_head_that_is_linked_elsewhere_is_not_written_through(tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.write_text("# Mine\n", encoding="utf-8")
    (tmp_path / "README.md").hardlink_to(own)
    write_card(tmp_path, content())
    assert own.read_text(encoding="utf-8") == "# Mine\n"


def test_an_option_may_waive_what_a_bag_must_have() -> None:
    assert FORMAT.needs_with({}) == (Need.LIDAR, Need.CAMERA)
    assert FORMAT.needs_with({"layout": "wide"}) == (Need.LIDAR, Need.CAMERA)
    assert FORMAT.needs_with({"layout": "paper"}) == (Need.LIDAR,)
    assert [option.is_flag for option in FORMAT.options] == [False, False]
    assert Option("region", "no", ("no", "yes"), "who").is_flag


def test_episodes_are_ordered_by_name_and_namesakes_told_apart_by_their_hash() -> None:
    surveys = [survey(2, "cc" * 32), survey(1, "bb" * 32), survey(1, "aa" * 32)]
    assert [(one.sha256[:2], name) for one, name in in_dataset_order(surveys)] == [
        ("aa", "S2_L1_seed1_town-aaaaaaaa"),
        ("bb", "S2_L1_seed1_town-bbbbbbbb"),
        ("cc", "S2_L1_seed2_town"),
    ]
    assert surveys[0].group == ("5e" * 32, 2)
    with pytest.raises(InputError, match="/bags/1 is the same one"):
        in_dataset_order([survey(3, "aa" * 32), survey(1, "aa" * 32)])


def test_names_have_letters_digits_and_hyphens() -> None:
    assert episode_name("S2", "L1", 3, "my town/2.xodr") == "S2_L1_seed3_my-town-2-xodr"
