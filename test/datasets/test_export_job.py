"""What all formats share: many bags, staged output, what is refused, what is said of bags that are not whole."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from siren_ros.cli.main import main
from siren_ros.datasets import export_job
from siren_ros.datasets.export_job import ExportJob, run_export
from siren_ros.datasets.exporting.file_writer import FileWriter
from siren_ros.datasets.registry import FORMATS, format_named, load_exporter
from siren_ros.errors import InputError


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


def test_the_same_bags_give_the_same_files(bags: list[Path], tmp_path: Path) -> None:
    assert export("csv", bags, tmp_path / "one", "--jobs", "1") == 0
    assert export("csv", [bags[2], bags[0], bags[1]], tmp_path / "two", "--jobs", "2") == 0
    assert files_of(tmp_path / "one") == files_of(tmp_path / "two")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "two"]


def test_a_folder_of_bags_is_all_its_bags(bags: list[Path], tmp_path: Path) -> None:
    assert export("csv", [bags[0].parent], tmp_path / "out", "--jobs", "1") == 0
    card = json.loads((tmp_path / "out" / "dataset.json").read_text())
    assert len(card["episodes"]) == 3
    assert len({one["id"] for one in card["episodes"]}) == 3
    assert len({one["bag_sha256"] for one in card["episodes"]}) == 3
    assert sum(len(names) for names in card["splits"].values()) == 3
    assert card["counts"]["rows"] == 20 * (3 + 4 + 5)
    assert card["made_with"]["command"] == "siren export csv --region no BAG… --out DIR"


def test_how_the_episodes_are_split_is_said_with_what_is_empty_and_why(
    bags: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export("csv", bags, tmp_path / "auto", "--jobs", "1") == 0
    line = capsys.readouterr().out.splitlines()[-1]
    assert line.startswith("episodes by split: train 3 (240 rows), val 0, test 0; val and test stay empty because ")
    assert "two seeds or maps" in line
    assert "--split" in line
    assert export("csv", bags, tmp_path / "all", "--jobs", "1", "--split", "val") == 0
    assert capsys.readouterr().out.splitlines()[-1] == "episodes by split: train 0, val 3 (240 rows), test 0"


def test_the_licence_is_stated(bags: list[Path], tmp_path: Path) -> None:
    assert export("csv", bags[:1], tmp_path / "out", "--licence", "CC-BY-4.0", "--split", "test") == 0
    assert json.loads((tmp_path / "out" / "dataset.json").read_text())["splits"]["train"] == []
    assert "Licence: CC-BY-4.0." in (tmp_path / "out" / "README.md").read_text()


def test_what_is_there_is_not_overwritten(bags: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "precious").write_text("mine")
    assert export("csv", bags[:1], out) == 2
    assert "new or empty" in capsys.readouterr().err
    assert files_of(tmp_path) == {"out/precious": b"mine"}


def test_the_same_bag_twice_is_refused(bags: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(bags[0], tmp_path / "copy")
    assert export("csv", [bags[0], tmp_path / "copy"], tmp_path / "out", "--jobs", "1") == 2
    assert "the same one" in capsys.readouterr().err
    assert not (tmp_path / ".out.partial").exists()


def test_an_interrupted_export_goes_on_where_it_was(
    bags: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = ExportJob(format_named("csv"), {}, tuple(bags), tmp_path / "out")
    done: list[str] = []
    whole = export_job._export_part

    def interrupted(*arguments: object) -> None:
        if len(done) == 2:
            raise InterruptedError
        whole(*arguments)  # type: ignore[arg-type] # handed through
        done.append(str(arguments[3]))

    monkeypatch.setattr(export_job, "_export_part", interrupted)
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


def test_a_full_disk_leaves_nothing_under_the_final_name(
    bags: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    real = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if path.name == "000010.bin":
            raise OSError(28, os.strerror(28))
        return real(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    assert export("kitti", bags[:1], tmp_path / "out", "--layout", "paper", "--jobs", "1") == 2
    told = capsys.readouterr().err
    assert "No space left on device" in told
    assert told.count("\n") == 1
    assert not (tmp_path / "out").exists()
    monkeypatch.undo()
    assert export("kitti", bags[:1], tmp_path / "out", "--layout", "paper", "--jobs", "1") == 0
    assert len(list((tmp_path / "out" / "velodyne").iterdir())) == 20


@pytest.mark.parametrize("metadata", [True, False])
def test_a_truncated_bag_is_exported_as_far_as_it_goes(
    bags: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str], metadata: bool
) -> None:
    cut = shutil.copytree(bags[0], tmp_path / "cut")
    (file,) = cut.glob("*.mcap")
    os.truncate(file, file.stat().st_size * 2 // 3)
    if not metadata:
        (cut / "metadata.yaml").unlink()
    assert export("csv", [cut, bags[1]], tmp_path / "out", "--jobs", "1") == 1
    assert "cut: exported as far as it goes; the bag was cut off" in capsys.readouterr().err
    card = json.loads((tmp_path / "out" / "dataset.json").read_text())
    lost = [one for one in card["episodes"] if one["lost"]]
    assert len(lost) == 1
    assert 0 < lost[0]["counts"]["rows"] < 20 * 3
    assert "Not whole" in (tmp_path / "out" / "README.md").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cut", "out"]


def test_what_is_no_bag_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "empty").mkdir()
    assert export("csv", [tmp_path / "empty"], tmp_path / "out") == 2
    assert "recorded episode" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


def test_the_list_names_every_format_and_its_needs(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["export", "--list"])
    assert end.value.code == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[1 : len(FORMATS) + 1]] == list(FORMATS)
    assert "lidar, front camera" in next(line for line in lines if line.startswith("kitti"))


@pytest.mark.parametrize(("options", "told"), [({"layout": "mine"}, "kitti, paper"), ({"colour": "red"}, "layout")])
def test_options_are_checked(options: dict[str, str], told: str) -> None:
    with pytest.raises(InputError, match=told):
        load_exporter(format_named("kitti"), options)


def test_an_unknown_format_is_refused() -> None:
    with pytest.raises(InputError, match="kitti"):
        format_named("kitty")


@pytest.mark.parametrize("threads", [1, 3])
def test_files_are_written_and_errors_told(tmp_path: Path, threads: int) -> None:
    with FileWriter(tmp_path, threads) as files:
        for number in range(40):
            files.write(f"sub/{number}.txt", lambda number=number: f"{number}".encode())  # type: ignore[misc] # bound
    assert {path.read_text() for path in (tmp_path / "sub").iterdir()} == {str(number) for number in range(40)}

    def broken() -> bytes:
        raise InputError("points", "x", "y")

    def write_all() -> None:
        with FileWriter(tmp_path, threads) as files:
            for number in range(40):
                files.write(f"{number}.bin", broken)

    with pytest.raises(InputError, match="points"):
        write_all()
