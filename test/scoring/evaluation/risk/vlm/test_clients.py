"""The table of clients: every setting is an option, and only what is asked for is made."""

import argparse

import pytest

from siren_ros.cli.evaluation import risk as evaluate_risk
from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.risk.vlm.clients import CLIENTS


def asked(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    evaluate_risk.add_arguments(parser)
    return parser.parse_args(["set", *words])


def test_every_setting_is_an_option_with_its_default() -> None:
    arguments = vars(asked())
    for client in CLIENTS:
        for name, setting in client.settings.items():
            assert arguments[name] == ([] if setting.repeated else setting.default), name
    names = [name for client in CLIENTS for name in client.settings]
    assert len(names) == len(set(names))
    assert list(evaluate_risk.models_asked(asked())) == [], "without a name no model is made"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--retries", "-1"], "retries"),
        (["--timeout-s", "nan"], "timeout_s"),
        (["--most-tokens", "0"], "most_tokens"),
        (["--model", "m"], "base-url"),
        (["--local-model", "/nowhere"], "local-model"),
    ],
)
def test_what_a_client_refuses(words: list[str], named: str) -> None:
    with pytest.raises(InputError, match=named):
        list(evaluate_risk.models_asked(asked(*words)))
