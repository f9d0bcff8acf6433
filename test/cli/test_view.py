"""``siren view`` and ``siren export html``: where the page is written, and what opens it."""

import sys
import webbrowser
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest
from datasets.made_bag import write_made_bag

from siren_ros.cli.main import main

WriteBag = Callable[..., Path]


@pytest.fixture(scope="module")
def bag(write_bag: WriteBag, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("viewed") / "bag", duration_s=1.0)


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """Addresses that a browser was asked to open."""
    addresses: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: bool(addresses.append(address)))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return addresses


def test_view_opens_a_page_of_the_episode_at_a_moment(bag, opened, capsys) -> None:
    assert main(["view", str(bag), "--time", "0", "--actor", "2"]) == 0
    assert capsys.readouterr().out.split() == opened
    parts = urlsplit(opened[0])
    assert parts.fragment == "t=0&v=2"
    assert Path(url2pathname(parts.path)).read_text(encoding="utf-8").startswith("<!doctype html>")
    opened.clear()
    assert main(["view", str(bag), "--no-browser"]) == 0
    (address,) = capsys.readouterr().out.split()
    assert (opened, urlsplit(address).scheme, urlsplit(address).fragment) == ([], "file", "")


def test_the_page_is_written_to_a_new_folder_and_the_same_episode_gives_the_same_bytes(bag, tmp_path, capsys) -> None:
    pages = [tmp_path / "new" / name for name in ("a.html", "b.html")]
    for page in pages:
        assert main(["export", "html", str(bag), "--out", str(page)]) == 0
    assert pages[0].read_bytes() == pages[1].read_bytes()
    printed = capsys.readouterr()
    assert f"{pages[0]}: " in printed.out
    assert "the page does not say why vehicles drive as they do" in printed.err, "the episode has no template"
    assert main(["export", "html", str(bag), "--out", str(tmp_path / "page.pdf")]) == 2


def test_live_becomes_the_viewer(becomes) -> None:
    became = becomes(["view", "--live", "--no-browser", "--port", "8123"])
    assert became[:4] == [sys.executable, "-m", "siren_nodes.viewer", "--ros-args"]
    assert became[4:] == ["-p", "browser:=false", "-p", "port:=8123"]


@pytest.mark.parametrize(
    ("options", "named"),
    [(["--live", "bag"], "bag: 'bag'"), (["--live", "--actor", "2"], "actor: '2'"), ([], "bag: ''")],
)
def test_a_bag_or_live_but_not_both(options: list[str], named: str, siren) -> None:
    assert named in siren(["view", *options], 2).err


@pytest.mark.parametrize("words", [["view", "--live"], ["replay", "BAG"]])
def test_what_needs_ros_says_so_where_there_is_none(bag, siren, monkeypatch, words: list[str]) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.setattr("os.execv", lambda *_: pytest.fail("it became another program"))
    assert "a ROS 2 environment" in siren([str(bag) if word == "BAG" else word for word in words], 2).err


def test_sensors_are_a_choice_and_the_command_says_what_is_there(typestore, tmp_path, capsys) -> None:
    bag, page = write_made_bag(tmp_path / "bag", typestore), str(tmp_path / "page.html")
    assert main(["export", "html", str(bag), "--out", page, "--show", "lidar"]) == 0
    assert "siren export: lidar: a sweep every 0.2 s" in capsys.readouterr().err
    assert main(["export", "html", str(bag), "--out", page, "--sensors", "lidar", "--at-most-mb", "0"]) == 0
    assert "siren export: lidar: left out: more than 0 MB" in capsys.readouterr().err
    assert main(["export", "html", str(bag), "--out", page, "--show", "sonar"]) == 2
    assert "of those of the bag: lidar, camera_front, camera_rear" in capsys.readouterr().err
    assert main(["export", "html", str(bag), "--out", page, "--at-most-mb", "-1"]) == 2
