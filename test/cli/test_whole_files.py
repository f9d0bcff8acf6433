"""What a command writes has its final name only once it is whole, on a disk that is full too."""

import resource
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from siren_ros.cli.main import main
from siren_ros.errors import whole_file

COMMANDS = {
    "plot.png": ("plot", "{bag}"),
    "film.mp4": ("video", "{bag}", "--frames", "20"),
    "sheet.png": ("sense", "{bag}", "--time-s", "1", "--sensors", "lidar"),
    "yield.json": ("evaluate", "yield", "{bag}", "--workers", "1"),
    "yield.parquet": ("evaluate", "yield", "{bag}", "--workers", "1"),
    "diversity.json": ("evaluate", "diversity", "{bag}", "--workers", "1"),
    "rows.csv": ("compare-paper", "{bag}", "--models", "cv", "--workers", "1"),
}


@pytest.fixture(scope="module")
def bags(write_bag: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    root = tmp_path_factory.mktemp("bags")
    return {"bag": str(write_bag(root / "own", duration_s=9.0))}


@contextmanager
def files_of_at_most(size_bytes: int) -> Iterator[None]:
    """Every file is refused beyond a size, as a full disk refuses it: Python ignores the signal and gets the error."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("name", COMMANDS)
def test_nothing_half_written_has_the_final_name(bags, tmp_path, name, capsys) -> None:
    out = tmp_path / name
    out.write_bytes(b"what stood there before")
    command = [word.format(**bags) for word in COMMANDS[name]]
    (tmp_path / "first").mkdir()
    main([*command, "--out", str(tmp_path / "first" / name)])  # what is compiled then is kept in files of its own
    shutil.rmtree(tmp_path / "first")
    with files_of_at_most(100):
        assert main([*command, "--out", str(out)]) == 2
    message = capsys.readouterr().err.splitlines()[-1]
    assert "can be written (" in message
    assert "File too large" in message
    assert out.read_bytes() == b"what stood there before"
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize("reason", [OSError, KeyboardInterrupt])
def test_of_a_file_that_is_not_finished_nothing_stays(tmp_path: Path, reason: type[BaseException]) -> None:
    out = tmp_path / "page.html"

    def write() -> None:
        with whole_file(out) as file:
            file.write_text("half", encoding="utf-8")
            assert not out.exists()
            raise reason

    with pytest.raises(reason):
        write()
    assert not list(tmp_path.iterdir())
    with whole_file(out) as file:
        file.write_text("whole", encoding="utf-8")
    assert [(path.name, path.read_text(encoding="utf-8")) for path in tmp_path.iterdir()] == [("page.html", "whole")]


def test_a_device_is_written_itself_and_a_link_leads_to_its_file(bags, tmp_path, capsys) -> None:
    assert main(["evaluate", "diversity", bags["bag"], "--workers", "1", "--out", "/dev/null"]) == 0
    assert Path("/dev/null").is_char_device()
    link, target = tmp_path / "link.json", tmp_path / "target.json"
    link.symlink_to(target)
    assert main(["evaluate", "diversity", bags["bag"], "--workers", "1", "--out", str(link)]) == 0
    assert link.is_symlink()
    assert target.read_text(encoding="utf-8").startswith("[")
    assert capsys.readouterr().err == ""
