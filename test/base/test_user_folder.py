"""Where caches and logs go: below the home, and elsewhere where there is none that can be written."""

import os
import stat
from pathlib import Path

import pytest

from siren_ros.base.user_folder import default_cache_dir, private_folder, user_folder
from siren_ros.errors import InputError


@pytest.fixture(autouse=True)
def _temporary(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


def test_it_lies_below_the_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    assert user_folder(".cache/x") == home / ".cache/x"
    assert (home / ".cache/x").is_dir()


@pytest.mark.parametrize("blocked", ["absent", "a file in the way"])
def test_a_home_that_cannot_be_written_is_left_alone(
    blocked: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    home = tmp_path / "home"
    if blocked != "absent":
        home.mkdir()
        (home / ".cache").touch()
    monkeypatch.setenv("HOME", str(home))
    own = tmp_path / f"siren_ros_{os.geteuid()}"
    assert user_folder(".cache/x") == user_folder(".cache/x") == own / ".cache/x"
    assert (own / ".cache/x").is_dir()
    assert stat.S_IMODE(own.stat().st_mode) == 0o700
    assert home.exists() == (blocked != "absent")


def test_without_home_the_systems_list_of_users_counts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("HOME")
    monkeypatch.setattr("pathlib.Path.home", lambda: (_ for _ in ()).throw(RuntimeError("no such user")))
    assert user_folder(".ros/log") == tmp_path / f"siren_ros_{os.geteuid()}" / ".ros/log"


def test_a_folder_that_somebody_else_put_there_is_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "none"))
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (tmp_path / f"siren_ros_{os.geteuid()}").symlink_to(theirs)
    folder = user_folder("log")
    assert folder.parent.name.startswith("siren_ros_")
    assert folder.is_dir()
    assert list(theirs.iterdir()) == []


def test_without_any_place_the_home_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "none"))
    (tmp_path / "file").touch()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))
    with pytest.raises(InputError, match=r"^HOME: .* or a folder for temporary files, that can be written"):
        user_folder("log")


@pytest.mark.parametrize("planted", ["a link", "a file", "open to others"])
def test_a_private_folder_is_never_one_that_others_can_reach(planted: str, tmp_path: Path) -> None:
    name, theirs = f"x-{planted.replace(' ', '-')}", tmp_path / "theirs"
    theirs.mkdir()
    if planted == "a link":
        (tmp_path / name).symlink_to(theirs)
    elif planted == "a file":
        (tmp_path / name).touch()
    else:
        (tmp_path / name).mkdir()
        (tmp_path / name).chmod(0o777)
    folder = private_folder(name)
    assert folder != tmp_path / name
    assert not folder.is_symlink()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert private_folder(name) == folder, "one process has one"
    assert list(theirs.iterdir()) == []


def test_the_environment_says_where_the_cache_is(monkeypatch, tmp_path):
    monkeypatch.setenv("SIREN_CACHE_DIR", str(tmp_path / "own"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert default_cache_dir() == tmp_path / "own"
    monkeypatch.delenv("SIREN_CACHE_DIR")
    assert default_cache_dir() == tmp_path / "xdg" / "siren"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_cache_dir() == tmp_path / ".cache" / "siren"
