import json
import os
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import siren_ros
from siren_ros.cli.main import main
from siren_ros.data.datasets.export_job import (
    ExportJob,
    card,
    readme,
    run_export,
    write_card,
)
from siren_ros.data.datasets.files import FileWriter
from siren_ros.data.datasets.formats import (
    EpisodePart,
    EpisodeReport,
    Format,
    Option,
    format_named,
    load_exporter,
)
from siren_ros.data.datasets.trajectory_tables import CsvExporter
from siren_ros.data.episode_source import LICENCE, BagSurvey, EpisodeSource, Need, episode_name, in_dataset_order
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.episode import EpisodeIdentity

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
        "values": "",
        "map": map_name,
        "map_sha256": "5e" * 32,
        "map_licence": "its own",
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


def test_counts_are_summed_over_episodes():
    card_content = content()
    assert card_content["counts"] == {"frames": 7}
    assert card_content["classes"] == {"bus": 1, "car": 7}
    assert list(card_content["classes"]) == ["bus", "car"], "by name"
    assert [episode["counts"] for episode in card_content["episodes"]] == [{"frames": 3}, {"frames": 4}]
    assert [(episode["id"], episode["seed"], episode["bag_sha256"][:2]) for episode in card_content["episodes"]] == [
        ("episode0", 1, "aa"),
        ("episode1", 2, "bb"),
    ]
    assert card_content["splits"] == {
        "train": ["episode0"],
        "val": ["episode1"],
        "test-seed": [],
        "test-map": [],
        "test-template": [],
    }
    assert card_content["made_with"] == {
        "command": "siren export made --layout wide BAG… --out DIR",
        "siren_ros": siren_ros.__version__,
        "options": {"layout": "wide"},
    }
    assert (card_content["format"], card_content["what"], card_content["licence"]) == (
        "made",
        "Frames of formulas",
        LICENCE,
    )


def test_people_read_the_same_and_what_is_lost_at_the_end():
    lines = readme(content()).splitlines()
    assert {"| episodes | 2 |", "| frames | 7 |", "| car | 7 |", "* val: episode1", "* test-seed: none"} <= {*lines}
    assert "    ros2 run siren_ros cosim --ros-args -p seed:=1" in lines
    assert "## Not whole" not in lines
    assert "| class | labels |" in lines
    assert "| class | labels |" not in readme(content() | {"classes": {}})
    lost = readme(content("the bag was cut off")).splitlines()
    assert lost[-3:] == ["## Not whole", "", "* episode1: the bag was cut off"]


def test_a_readme_of_the_format_stays_at_the_head(tmp_path):
    linked = tmp_path / "own"
    linked.write_text("# Mine\n", encoding="utf-8")
    (tmp_path / "README.md").hardlink_to(linked)
    write_card(tmp_path, content())
    assert linked.read_text(encoding="utf-8") == "# Mine\n", "not written through"
    assert (tmp_path / "README.md").read_text(encoding="utf-8") == "# Mine\n\n" + readme(content())
    assert json.loads((tmp_path / "dataset.json").read_text(encoding="utf-8")) == content()
    (tmp_path / "new").mkdir()
    write_card(tmp_path / "new", content())
    assert (tmp_path / "new" / "README.md").read_text(encoding="utf-8") == readme(content())


def test_an_option_may_waive_what_a_bag_must_have():
    assert FORMAT.needs_with({}) == (Need.LIDAR, Need.CAMERA)
    assert FORMAT.needs_with({"layout": "wide"}) == (Need.LIDAR, Need.CAMERA)
    assert FORMAT.needs_with({"layout": "paper"}) == (Need.LIDAR,)
    assert [option.is_flag for option in FORMAT.options] == [False, False]
    assert Option("region", "no", ("no", "yes"), "who").is_flag


def test_episodes_are_ordered_by_name_and_namesakes_told_apart_by_their_hash():
    surveys = [survey(2, "cc" * 32), survey(1, "bb" * 32), survey(1, "aa" * 32)]
    assert [(survey.sha256[:2], name) for survey, name in in_dataset_order(surveys)] == [
        ("aa", "S2_L1_seed1_town-aaaaaaaa"),
        ("bb", "S2_L1_seed1_town-bbbbbbbb"),
        ("cc", "S2_L1_seed2_town"),
    ]
    assert surveys[0].identity == EpisodeIdentity("town", "S2", 2)
    assert episode_name("S2", "L1", 3, "my town/2.xodr") == "S2_L1_seed3_my-town-2-xodr"
    with pytest.raises(InputError, match="/bags/1 is the same one"):
        in_dataset_order([survey(3, "aa" * 32), survey(1, "aa" * 32)])


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory, write_bag: Callable[..., Path]) -> list[Path]:
    """Three episodes that differ."""
    folder = tmp_path_factory.mktemp("bags")
    return [
        write_bag(folder / f"bag{civilians}", duration_s=2.0, civilians=civilians, lidar=True)
        for civilians in (2, 3, 4)
    ]


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def export(name: str, bags: list[Path], out: Path, *more: str) -> int:
    return main(["export", name, *map(str, bags), "--out", str(out), *more])


def test_a_folder_of_bags_is_all_its_bags_and_their_order_changes_nothing(bags, tmp_path, capsys):
    assert export("csv", [bags[0].parent], tmp_path / "one", "--workers", "1") == 0
    line = capsys.readouterr().out.splitlines()[-1]
    start = "episodes by split: train 3 (240 rows), val 0, test-seed 0, test-map 0, test-template 0; val, test-seed, "
    assert line.startswith(start)
    assert "params/splits.yaml" in line, "what is empty, and why"
    assert export("csv", [bags[2], bags[0], bags[1]], tmp_path / "two", "--workers", "2") == 0
    assert files_of(tmp_path / "one") == files_of(tmp_path / "two")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "two"]
    card = json.loads((tmp_path / "one" / "dataset.json").read_text())
    assert [len({episode[key] for episode in card["episodes"]}) for key in ("id", "bag_sha256")] == [3, 3]
    assert sum(len(names) for names in card["splits"].values()) == 3
    assert card["counts"]["rows"] == 20 * (3 + 4 + 5)
    assert card["made_with"]["command"] == "siren export csv --region no BAG… --out DIR"


def test_the_split_may_be_given_and_the_licence_is_stated(bags, tmp_path, capsys):
    assert export("csv", bags[:1], tmp_path / "out", "--licence", "CC-BY-4.0", "--split", "test") == 0
    told = "episodes by split: train 0, val 0, test-seed 0, test-map 0, test-template 0, test 1 (60 rows)"
    assert capsys.readouterr().out.splitlines()[-1] == told
    assert json.loads((tmp_path / "out" / "dataset.json").read_text())["splits"]["train"] == []
    assert "Licence: CC-BY-4.0." in (tmp_path / "out" / "README.md").read_text()


def test_what_is_there_is_not_overwritten_and_what_is_no_bag_is_refused(bags, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / "precious").write_text("mine")
    assert export("csv", bags[:1], out) == 2
    assert "new or empty" in capsys.readouterr().err
    (tmp_path / "empty").mkdir()
    assert export("csv", [tmp_path / "empty"], tmp_path / "new") == 2
    assert "recorded episode" in capsys.readouterr().err
    assert files_of(tmp_path) == {"out/precious": b"mine"}


def test_an_interrupted_export_goes_on_where_it_was(bags, tmp_path, monkeypatch):
    job = ExportJob(format_named("csv"), {}, tuple(bags), tmp_path / "out")
    done: list[str] = []
    whole = CsvExporter.write_episode

    def interrupted(exporter: CsvExporter, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        if len(done) == 2:
            raise InterruptedError
        report = whole(exporter, source, episode_id, files)
        done.append(episode_id)
        return report

    monkeypatch.setattr(CsvExporter, "write_episode", interrupted)
    with pytest.raises(InputError):
        run_export(job)
    assert not (tmp_path / "out").exists()
    assert (tmp_path / ".out.partial").is_dir()
    first = {path: path.stat().st_ino for path in (tmp_path / ".out.partial" / "parts").rglob("*.csv")}
    assert len(first) == 2

    with pytest.raises(InputError, match="unfinished export of other bags"):
        run_export(ExportJob(format_named("csv"), {"region": "yes"}, tuple(bags), tmp_path / "out"))

    done.clear()
    run_export(job)
    assert len(done) == 1
    monkeypatch.undo()
    run_export(ExportJob(format_named("csv"), {}, tuple(bags), tmp_path / "again"))
    assert files_of(tmp_path / "out") == files_of(tmp_path / "again")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again", "out"]


def test_a_full_disk_leaves_nothing_under_the_final_name(bags, tmp_path, monkeypatch, capsys):
    real = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if path.name == "000010.bin":
            raise OSError(28, os.strerror(28))
        return real(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    assert export("kitti", bags[:1], tmp_path / "out", "--layout", "paper", "--workers", "1") == 2
    message = capsys.readouterr().err
    assert "No space left on device" in message
    assert message.count("\n") == 1
    assert not (tmp_path / "out").exists()
    monkeypatch.undo()
    assert export("kitti", bags[:1], tmp_path / "out", "--layout", "paper", "--workers", "1") == 0
    assert len(list((tmp_path / "out" / "velodyne").iterdir())) == 20


@pytest.mark.parametrize("metadata", [True, False])
def test_a_truncated_bag_is_exported_as_far_as_it_goes(bags, tmp_path, capsys, metadata):
    cut = shutil.copytree(bags[0], tmp_path / "cut")
    (file,) = cut.glob("*.mcap")
    os.truncate(file, file.stat().st_size * 2 // 3)
    if not metadata:
        (cut / "metadata.yaml").unlink()
    assert export("csv", [cut, bags[1]], tmp_path / "out", "--workers", "1") == 1
    assert "cut: exported as far as it goes; the bag was cut off" in capsys.readouterr().err
    card = json.loads((tmp_path / "out" / "dataset.json").read_text())
    lost = [episode for episode in card["episodes"] if episode["lost"]]
    assert len(lost) == 1
    assert 0 < lost[0]["counts"]["rows"] < 20 * 3
    assert "Not whole" in (tmp_path / "out" / "README.md").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut", "out"]


@pytest.mark.parametrize(("options", "allowed"), [({"layout": "mine"}, "kitti, paper"), ({"colour": "red"}, "layout")])
def test_options_are_checked(options, allowed):
    with pytest.raises(InputError, match=allowed):
        load_exporter(format_named("kitti"), options)
    with pytest.raises(InputError, match="kitti"):
        format_named("kitty")


@pytest.mark.parametrize("threads", [1, 3])
def test_files_are_written_and_errors_told(tmp_path, threads):
    with FileWriter(tmp_path, threads) as files:
        for number in range(40):
            files.write(f"sub/{number}.txt", lambda number=number: f"{number}".encode())
    assert {path.read_text() for path in (tmp_path / "sub").iterdir()} == {str(number) for number in range(40)}

    def broken() -> bytes:
        raise InputError("points", "x", "y")

    def write_all() -> None:
        with FileWriter(tmp_path, threads) as files:
            for number in range(40):
                files.write(f"{number}.bin", broken)

    with pytest.raises(InputError, match="points"):
        write_all()


def test_files_that_wait_are_few_however_slow_the_disk(tmp_path):
    go_on, begun, given = threading.Event(), threading.Semaphore(0), []

    def slow() -> bytes:
        begun.release()
        go_on.wait()
        return b""

    with FileWriter(tmp_path, 2) as files:

        def give() -> None:
            for number in range(100):
                files.write(f"{number}.bin", slow)
                given.append(number)

        giver = threading.Thread(target=give)
        giver.start()
        begun.acquire()
        begun.acquire()  # both threads are at work
        giver.join(0.3)
        waiting = len(given)
        go_on.set()
        giver.join()
    assert waiting <= 8, "two threads, four files for each"
    assert len(list(tmp_path.iterdir())) == 100
