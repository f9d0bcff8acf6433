"""What is half written does not look whole: the KITTI folder of a running episode."""

from pathlib import Path

import pytest

from siren_ros.data.datasets.files import LiveExport, Staging
from siren_ros.errors import InputError


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "bags" / "S2_kitti"


def written(out: Path) -> LiveExport:
    export = LiveExport(out)
    (export.open() / "frames.csv").write_text("frame\n")
    return export


@pytest.mark.parametrize("there", [[], ["S2_kitti"]])
def test_it_has_its_name_when_it_is_published_and_not_before(out, there):
    """An empty folder may be there already."""
    for name in there:
        (out.parent / name).mkdir(parents=True)
    export = written(out)
    assert names(out.parent) == [".S2_kitti.partial", *there]
    export.close(whole=True)
    assert names(out.parent) == [".S2_kitti.partial", *there]
    LiveExport(out).publish()
    assert names(out.parent) == ["S2_kitti"]
    assert names(out) == ["frames.csv"]


def test_one_that_is_not_whole_is_gone_and_the_next_can_begin(out):
    written(out).close(whole=False)
    assert names(out.parent) == []
    written(out).close(whole=True)


def test_one_that_nobody_publishes_is_dropped(out):
    export = written(out)
    LiveExport(out).drop()
    assert names(out.parent) == [".S2_kitti.partial"], "it is being written"
    export.close(whole=True)
    LiveExport(out).drop()
    assert names(out.parent) == []
    LiveExport(out).drop()


def test_what_a_killed_exporter_left_is_replaced(out):
    left = Staging(out)
    with left.opened({"export": "of a running episode"}):
        (left.new(left.part(0)) / "old.bin").touch()
        left.finish_part(0, {})
    export = written(out)
    export.close(whole=True)
    export.publish()
    assert names(out) == ["frames.csv"]


def test_a_place_that_could_not_be_taken_is_refused(out):
    running = written(out)
    with pytest.raises(InputError, match="no other export is writing"):
        LiveExport(out).open()
    running.close(whole=False)
    out.symlink_to(out.parent / "nowhere")
    with pytest.raises(InputError, match="new or empty"):
        LiveExport(out).check()
    out.unlink()
    out.mkdir()
    (out / "mine").touch()
    with pytest.raises(InputError, match="new or empty"):
        LiveExport(out).open()
    assert names(out.parent) == ["S2_kitti"]


def test_an_unfinished_export_of_bags_is_left_alone(out):
    unfinished = Staging(out)
    with unfinished.opened({"format": "kitti"}):
        unfinished.new(unfinished.part(0))
        unfinished.finish_part(0, {})
    with pytest.raises(InputError, match="without an unfinished export"):
        LiveExport(out).open()
    LiveExport(out).drop()
    assert unfinished.report_of(0) == {}


def whole(out: Path, text: str, *, overwrite: bool = False) -> None:
    export = LiveExport(out, overwrite=overwrite)
    folder = export.open()
    (folder / "frames.csv").write_text(f"frame,step,timestamp\n{text}\n")
    (folder / "training" / "calib").mkdir(parents=True)
    (folder / "training" / "calib" / "000000.txt").write_text(text)
    export.close(whole=True)
    LiveExport(out, overwrite=overwrite).publish()


def test_an_earlier_export_gives_way_where_that_is_asked(out):
    whole(out, "first")
    with pytest.raises(InputError, match="overwrite:=true"):
        LiveExport(out).check()
    whole(out, "second", overwrite=True)
    assert (out / "training" / "calib" / "000000.txt").read_text() == "second"
    assert names(out.parent) == ["S2_kitti"]


@pytest.mark.parametrize("foreign", ["notes.txt", "training/calib/mine.txt", "training/velodyne"])
def test_nothing_but_an_export_gives_way(out, foreign):
    whole(out, "first")
    (out / foreign).symlink_to(out.parent)
    with pytest.raises(InputError, match="new or empty"):
        LiveExport(out, overwrite=True).check()
    assert (out / "frames.csv").is_file()
