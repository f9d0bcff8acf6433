"""What a user types behind a node's name: it arrives, or is refused in one line; and the help."""

import subprocess
import sys
from dataclasses import fields

import pytest
import yaml

rclpy = pytest.importorskip("rclpy", reason="needs ROS")

from rclpy.context import Context  # noqa: E402

from siren_ros.errors import InputError  # noqa: E402
from siren_ros.running.ros import node_configs  # noqa: E402
from siren_ros.running.ros.programs.processes import answer, help_text, outside_ros, quoted  # noqa: E402
from siren_ros.running.ros.programs.program import reading_arguments  # noqa: E402


def run_node(node: str, *words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", f"siren_nodes.{node}", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_a_node_explains_its_parameters() -> None:
    run = run_node("emv_controller", "--help")
    assert (run.returncode, run.stderr) == (0, "")
    text = " ".join(run.stdout.split())
    for field in fields(node_configs.EmvControllerConfig):
        assert f" {field.name}:=" in text
        assert field.metadata["description"] in text


def test_the_help_names_defaults_and_what_is_allowed() -> None:
    text = " ".join(help_text("siren-player", node_configs.PlayerConfig, "Plays.").split())
    assert text.startswith("usage: siren-player [--ros-args [-p NAME:=VALUE]")
    assert "rate:=1.0 Simulated seconds per wall second. (a number from 0.01 to 100)" in text
    assert "loop:=false Begin again at the end." in text


def test_a_node_refuses_what_ros_leaves_to_it() -> None:
    run = run_node("cosim", "participants:=[a b]", "--ros-args", "-p", "seed:=1")
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.startswith("cosim: arguments: 'participants:=[a b]' cannot be used")
    assert run.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (("template:=S1", "sensors:=none"), "`--ros-args -p template:=S1 -p sensors:=none`?"),
        (("-p", "map:=my town.xml"), "`--ros-args -p 'map:=my town.xml'`?"),
        (("--start-timeout-s=3",), "`--ros-args -p start_timeout_s:=3`?"),
        (("nonsense:=1",), "--help prints the parameters"),
    ],
)
def test_the_refusal_names_what_was_meant(
    words: tuple[str, ...], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert answer(words, "cosim", node_configs.CosimConfig, "") == 2
    assert capsys.readouterr().err.rstrip().endswith(meant)


def test_what_ros_takes_is_not_looked_at() -> None:
    assert outside_ros(["--ros-args", "-p", "a:=b", "-r", "--help"]) == ()
    assert outside_ros(["x", "--ros-args", "-p", "a:=b", "--", "y", "--ros-args"]) == ("x", "y")


def test_texts_that_yaml_would_change_are_quoted() -> None:
    texts = ("a: b", "a:", "a #b", "C:\\a: b", 'say "a": b', "a:b", "a#b", "emv.speed_mps=12.5,duration_s=60")
    for text in texts:
        (_, _, _, argument) = quoted(["cosim", "--ros-args", "-p", f"bag:={text}"])
        assert yaml.safe_load(argument.removeprefix("bag:=")) == text


@pytest.mark.parametrize("argument", ['bag:="a: b"', "topics:=['a: b']", "a:={b: c}", "seed:=3", "nonsense"])
def test_what_is_yaml_already_stays(argument: str) -> None:
    assert quoted(["-p", argument]) == ["-p", argument]
    assert quoted(["--params-file", "a: b", "-r", "a: b"]) == ["--params-file", "a: b", "-r", "a: b"]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["-p", "bag:=b\udcff"], "text in UTF-8"),
        (["-p", "nonsense"], "'-p nonsense'"),
        (["--frobnicate"], "--frobnicate"),
        (["--params-file", "/nowhere"], "/nowhere"),
    ],
)
def test_what_ros_cannot_read_is_bad_input(words: list[str], named: str) -> None:
    with pytest.raises(InputError) as refused, reading_arguments():
        rclpy.init(args=["cosim", "--ros-args", *words], context=Context())
    assert named in str(refused.value)
    assert "\n" not in str(refused.value)


def test_other_errors_are_no_bad_input() -> None:
    with pytest.raises(RuntimeError, match="logging"), reading_arguments():
        raise RuntimeError("failed to initialize logging: no home")


def test_a_node_without_ros_says_what_is_missing() -> None:
    program = "import sys; sys.modules['rclpy'] = None; import siren_nodes.cosim"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (2, "")
    assert "rclpy" in run.stderr
    assert "`siren episode`" in run.stderr
    assert run.stderr.count("\n") == 1
