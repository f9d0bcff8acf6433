"""Where the parameter files are found, installed and checked out."""

from pathlib import Path

import pytest

from siren_ros.base.params.resources import find_params_dir, params_dir
from siren_ros.errors import InputError


def make_package(folder: Path) -> Path:
    folder.mkdir(parents=True)
    file = folder / "resources.py"
    file.touch()
    return file


def test_a_checkout_holds_them_beside_the_package(tmp_path: Path) -> None:
    file = make_package(tmp_path / "siren_ros")
    (tmp_path / "params").mkdir()
    (tmp_path / "package.xml").touch()
    assert find_params_dir(file, "") == tmp_path / "params"


def test_an_installation_holds_them_in_its_own_prefix(tmp_path: Path) -> None:
    file = make_package(tmp_path / "install/lib/python3.12/site-packages/siren_ros")
    installed = tmp_path / "install/share/siren_ros/params"
    other = tmp_path / "other/share/siren_ros/params"
    for folder in (installed, other):
        folder.mkdir(parents=True)
    assert find_params_dir(file, str(tmp_path / "other")) == installed


def test_a_symlinked_package_belongs_to_its_checkout(tmp_path: Path) -> None:
    make_package(tmp_path / "source/siren_ros")
    (tmp_path / "source/params").mkdir()
    (tmp_path / "source/package.xml").touch()
    link = tmp_path / "build/siren_ros"
    link.parent.mkdir()
    link.symlink_to(tmp_path / "source/siren_ros")
    assert find_params_dir(link / "resources.py", "") == tmp_path / "source/params"


def test_the_ament_index_is_searched_in_its_order(tmp_path: Path) -> None:
    file = make_package(tmp_path / "anywhere/siren_ros")
    for name in ("second", "third"):
        (tmp_path / name / "share/siren_ros/params").mkdir(parents=True)
    path = ":".join(["", *(str(tmp_path / name) for name in ("first", "second", "third"))])
    assert find_params_dir(file, path) == tmp_path / "second/share/siren_ros/params"


def test_an_installation_without_them_is_named(tmp_path: Path) -> None:
    file = make_package(tmp_path / "siren_ros")
    with pytest.raises(InputError, match=r"installation: .*siren_ros.*params"):
        find_params_dir(file, "")


def test_this_installation_has_them() -> None:
    assert (params_dir() / "templates").is_dir()
