import argparse
import math

import pytest

from siren_ros.cli.main import main
from siren_ros.cli.options.numbers import check_numbers
from siren_ros.errors import InputError


@pytest.mark.parametrize("value", [0.5, 2.0, 3, None])
def test_numbers_within_their_limits_pass(value: float | None) -> None:
    check_numbers(argparse.Namespace(timeout_s=value), {"timeout_s": (0.5, 3.0)})


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.49, 3.01])
def test_others_are_refused_by_name(value: float) -> None:
    with pytest.raises(InputError) as refused:
        check_numbers(argparse.Namespace(timeout_s=value), {"timeout_s": (0.5, 3.0)})
    assert str(refused.value) == f"timeout_s: {value!r} cannot be used; allowed: a number from 0.5 to 3"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["calibrate", "bag", "--seed", "-1"], "calibrate: seed: -1 "),
        (["generate", "risk", "--out", "set", "--seed", "-1"], "generate: seed: -1 "),
        (["generate", "risk", "--out", "set", "--retries", "-1"], "generate: retries: -1 "),
        (["train", "detection", "bag", "--out", "a.onnx", "--minutes", "nan"], "train: minutes: nan "),
        (["train", "prediction", "--out", "a", "--validation-seeds", "-1"], "train: validation_seeds: -1 "),
        (["train", "risk", "--out", "a", "--seed", "-1"], "train: seed: -1 "),
    ],
)
def test_commands_refuse_them_before_anything_else(
    words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert capsys.readouterr().err.startswith(f"siren {line}cannot be used; allowed: a")
