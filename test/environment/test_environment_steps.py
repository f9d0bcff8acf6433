"""The steps that make the environment, the browser's among them."""

import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from environment_support import REPOSITORY, STEPS, Checkout, clean_environment, run_shell

from siren_ros.running.ros.transport.dds import profile_name

USABLE = "import sysconfig, os, ensurepip; assert os.path.exists(sysconfig.get_path('include') + '/Python.h')"


def fake_python(folder: Path, name: str, script: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return path


def base_python() -> str:
    """The interpreter below the tests' own environment, where it can make environments."""
    major, minor, *_ = sys.version_info
    path = os.path.realpath(Path(sys.base_prefix, "bin", f"python{major}.{minor}"))
    if subprocess.run([path, "-c", USABLE], capture_output=True, check=False).returncode:
        pytest.skip("the tests' Python has no headers or no ensurepip")
    return path


def test_an_interpreter_that_runs_is_found(tmp_path: Path) -> None:
    """After one that does not run; among those that pyenv holds; below an environment."""
    real, find = base_python(), "find_python; echo $python"
    fake_python(tmp_path / "bin", "python3.12", "echo 'pyenv: python3.12: command not found' >&2; exit 127")
    fake_python(tmp_path / "bin", "python3.11", f'exec {real} "$@"')
    version = f"{sys.version_info[0]}.{sys.version_info[1]}"
    fake_python(tmp_path / f"pyenv/versions/{version}.99/bin", f"python{version}", f'exec {real} "$@"')
    for found in (
        run_shell(find, tmp_path, PATH=f"{tmp_path}/bin:{os.environ['PATH']}"),
        run_shell(f"type() {{ return 1; }}; {find}", tmp_path, PYENV_ROOT=str(tmp_path / "pyenv")),
        run_shell(find, tmp_path, SIREN_PYTHON=sys.executable),
    ):
        assert found.stdout.strip() == real


@pytest.mark.parametrize("script", ["exit 1", "echo /usr/bin/python3.11; exit 3"])
def test_a_named_interpreter_that_cannot_be_used_is_named(tmp_path: Path, script: str) -> None:
    path = fake_python(tmp_path / "bin", "python", script)
    result = run_shell("find_python", tmp_path, SIREN_PYTHON=str(path))
    assert result.returncode == 2
    assert result.stderr.count("\n") == 1
    assert f"SIREN_PYTHON: '{path}' cannot be used; allowed: " in result.stderr


def test_without_root_the_line_to_run_is_printed(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    result = run_shell(
        "missing_packages() { echo libone; echo libtwo; }; apt-get() { :; }; ensure_system_packages; echo went on",
        tmp_path,
        user="nobody" if os.geteuid() == 0 else None,
    )
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr.splitlines()[-1] == (
        "sudo apt-get update && sudo apt-get install -y --no-install-recommends libone libtwo"
    )


def test_a_half_installed_package_is_forgotten(tmp_path: Path) -> None:
    site = tmp_path / "venv/lib/python3.11/site-packages"
    for name, files in (("whole", ["METADATA", "RECORD"]), ("half", ["METADATA"])):
        (site / f"{name}-1.0.dist-info").mkdir(parents=True)
        for file in files:
            (site / f"{name}-1.0.dist-info" / file).touch()
    assert run_shell("forget_half_installed", tmp_path).returncode == 0
    assert [path.name for path in site.iterdir()] == ["whole-1.0.dist-info"]


def test_a_copied_environment_is_not_sound(tmp_path: Path) -> None:
    original = tmp_path / "original"
    subprocess.run([base_python(), "-m", "venv", "--without-pip", original], check=True)
    (next(original.glob("lib/python3.*/site-packages")) / "pip.py").touch()  # real ones take seconds
    fake_python(original / "bin", "pip", f"{original}/bin/python")
    verdict = "venv={}; venv_is_sound && echo sound || echo not sound"
    assert run_shell(verdict.format(original), tmp_path).stdout == "sound\n"
    shutil.copytree(original, tmp_path / "copy", symlinks=True)
    assert run_shell(verdict.format(tmp_path / "copy"), tmp_path).stdout == "not sound\n"
    next(original.glob("lib/python3.*/site-packages/pip.py")).unlink()
    assert run_shell(verdict.format(original), tmp_path).stdout == "not sound\n"


def source_variables(tmp_path: Path, shell: str = "bash", **variables: str) -> dict[str, str]:
    """What a shell has set after it read the file that ./env sources, twice."""
    (tmp_path / "venv/lib/python3.11/site-packages/ros_one.libs").mkdir(parents=True, exist_ok=True)
    (tmp_path / "venv/.siren").mkdir(exist_ok=True)
    assert run_shell("write_variables", tmp_path).returncode == 0
    file = tmp_path / "venv/.siren/environment.sh"
    result = subprocess.run(
        [shell, "-c", f". {file}; . {file}; env -0"],
        env=clean_environment(**variables),
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(entry.split("=", 1) for entry in result.stdout.split("\0") if entry)


@pytest.mark.parametrize("shell", ["bash", "sh"])
def test_variables_are_set_once_and_keep_what_there_was(tmp_path: Path, shell: str) -> None:
    venv = tmp_path / "venv"
    variables = source_variables(tmp_path, shell, AMENT_PREFIX_PATH="/overlay", LD_LIBRARY_PATH="/other")
    assert variables["AMENT_PREFIX_PATH"] == f"/overlay:{venv}"
    assert variables["LD_LIBRARY_PATH"] == f"{venv}/lib:{venv}/lib/python3.11/site-packages/ros_one.libs:/other"
    assert variables["PATH"].startswith(f"{venv}/bin:")
    assert variables["PATH"].count(f"{venv}/bin") == 1


def test_compiled_python_is_kept_in_the_environment_where_it_may_not_lie_beside_the_sources(tmp_path: Path) -> None:
    variables = source_variables(tmp_path, PYTHONDONTWRITEBYTECODE="1")
    assert variables["PYTHONPYCACHEPREFIX"] == str(tmp_path / "venv/pycache")
    assert "PYTHONDONTWRITEBYTECODE" not in variables
    assert "PYTHONPYCACHEPREFIX" not in source_variables(tmp_path)
    variables = source_variables(tmp_path, PYTHONDONTWRITEBYTECODE="1", PYTHONPYCACHEPREFIX="/own")
    assert (variables["PYTHONPYCACHEPREFIX"], variables["PYTHONDONTWRITEBYTECODE"]) == ("/own", "1")


def test_the_profile_of_fast_dds_is_set_up_unless_the_user_has_a_profile(tmp_path: Path) -> None:
    for chosen in ({}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, {"ROS_STATIC_PEERS": "10.0.0.1"}):
        variables = source_variables(tmp_path, **chosen)
        assert variables["FASTRTPS_DEFAULT_PROFILES_FILE"] == str(REPOSITORY / "params" / profile_name(variables))
        asked = chosen.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        assert variables["ROS_AUTOMATIC_DISCOVERY_RANGE"] == asked
    variables = source_variables(tmp_path, FASTDDS_DEFAULT_PROFILES_FILE="/own.xml")
    assert "FASTRTPS_DEFAULT_PROFILES_FILE" not in variables


def collected_extras(tmp_path: Path, installed: str | None, *asked: str) -> "subprocess.CompletedProcess[str]":
    """The extras that the next environment will have, of a pyproject.toml with ``dev`` and ``models``."""
    (tmp_path / "pyproject.toml").write_text(
        '[project]\nname = "x"\n[project.optional-dependencies]\ndev = ["a"]\nmodels = ["torch"]\n'
    )
    state = tmp_path / "venv/.siren"
    state.mkdir(parents=True, exist_ok=True)
    if installed is not None:
        (state / "extras").write_text(installed)
    fake_python(tmp_path / "venv/bin", "python", f'exec {sys.executable} "$@"')
    words = " ".join(asked)
    script = f"cd {tmp_path}; asked_extras=({words}); collect_extras; printf '%s\\n' \"${{extras[@]}}\""
    return run_shell(script, tmp_path)


def test_extras_add_up_and_only_those_that_setup_has_are_there(tmp_path: Path) -> None:
    assert collected_extras(tmp_path, None, "models").stdout.split() == ["models"]
    assert collected_extras(tmp_path, "dev\nold\n", "models", "dev").stdout.split() == ["dev", "models"]
    result = collected_extras(tmp_path, "dev\n", "modles")
    assert result.returncode == 2
    assert result.stderr == "env: --with: 'modles' cannot be used; allowed: dev, models\n"


def test_uv_gets_what_is_set_for_pip_and_keeps_what_is_set_for_itself() -> None:
    variables = runpy.run_path(str(STEPS / "uv_like_pip.py"))["uv_variables"]
    settings = {
        "index-url": "https://mirror/simple",
        "extra-index-url": "\nhttps://a\nhttps://b",
        "find-links": "/x /y",
        "cert": "/etc/cert.pem",
        "no-index": "true",
        "verbose": "1",
    }
    assert variables(settings, {"SSL_CERT_FILE": "/mine"}) == {
        "UV_DEFAULT_INDEX": "https://mirror/simple",
        "UV_INDEX": "https://a https://b",
        "UV_FIND_LINKS": "/x,/y",
        "UV_NO_INDEX": "1",
        "UV_INDEX_STRATEGY": "unsafe-best-match",
    }


NODES = sorted(path.stem for path in (REPOSITORY / "nodes").glob("[a-z]*.py"))


def declared_executables(*arguments: str) -> dict[str, str]:
    """What setup.py declares when it is called with these commands: the function behind each name."""
    scripts: dict[str, str] = {}

    def setup(**keywords: Any) -> None:
        scripts.update(line.split(" = ") for line in keywords["entry_points"]["console_scripts"])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("setuptools.setup", setup)
        patch.setattr(sys, "argv", ["setup.py", *arguments])
        patch.chdir(REPOSITORY)
        runpy.run_path("setup.py")
    return scripts


@pytest.mark.parametrize("command", ["install", "develop", "egg_info"])
def test_colcon_installs_the_nodes_under_their_own_names(command: str) -> None:
    assert sorted(declared_executables(command)) == sorted(["siren", *NODES])


def test_pip_installs_nodes_with_the_projects_name_and_ros2_run_finds_them(tmp_path: Path) -> None:
    metadata = tmp_path / "venv/lib/python3.11/site-packages/siren_ros-0.1.0.dist-info"
    metadata.mkdir(parents=True)
    scripts = declared_executables("-q", "editable_wheel", "--dist-dir", "x")
    assert scripts == declared_executables("bdist_wheel") == declared_executables("dist_info")
    assert all(name == "siren" or name.startswith("siren-") for name in scripts)
    lines = [f"{name} = {function}" for name, function in scripts.items()]
    (metadata / "entry_points.txt").write_text("\n".join(["[console_scripts]", *lines, ""]))
    old = tmp_path / "venv/lib/siren_ros/gone"
    old.parent.mkdir()
    old.touch()
    result = run_shell("ros=sourced; mkdir -p $venv/bin $state; install_runnables", tmp_path)
    assert result.returncode == 0, result.stderr
    links = {path.name: path.readlink().as_posix() for path in old.parent.iterdir()}
    assert sorted(links) == sorted(["siren", *NODES])
    assert links["siren"] == "../../bin/siren"
    assert links["kitti_exporter"] == "../../bin/siren-kitti-exporter"


NO_BROWSER = 'find_browser() { return 1; }; run_step() { shift 2; echo "$*"; return ${FAILS-0}; };'


def test_the_browser_comes_with_dev_and_without_root_its_line_is_said(tmp_path: Path) -> None:
    script = NO_BROWSER + "apt-get() { :; }; extras=(dev models); ensure_browser; echo went on"
    result = run_shell(script, tmp_path, user="nobody" if os.geteuid() == 0 else None)
    assert result.stdout == "went on\n"
    assert "sudo apt-get install -y --no-install-recommends chromium-headless-shell" in result.stderr
    assert run_shell(script.replace("dev", ""), tmp_path, user=None).stderr == ""
    script = "mkdir -p $state; find_browser() { echo /usr/bin/one; }; extras=(dev); ensure_browser; cat $state/browser"
    assert run_shell(script, tmp_path).stdout == "/usr/bin/one\n"


@pytest.mark.parametrize(("browser", "calls"), [("", 1), ("/bin/true\n", 1), ("/no/such/browser\n", 2)])
def test_a_machine_that_lost_the_browser_gets_it_again(checkout: Checkout, browser: str, calls: int) -> None:
    checkout.env("true")
    (checkout.root / ".venv/.siren/browser").write_text(browser)
    checkout.env("true")
    assert len(checkout.calls()) == calls
