"""What a user types after ``--ros-args`` arrives, or is refused in one line."""

import pytest
import yaml

rclpy = pytest.importorskip("rclpy", reason="needs ROS")

from rclpy.context import Context  # noqa: E402

from siren_ros.errors import InputError  # noqa: E402
from siren_ros.ros.programs.program import quoted, reading_arguments  # noqa: E402


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
