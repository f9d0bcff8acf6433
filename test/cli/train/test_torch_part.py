"""Parts that an extra installs."""

import math

import pytest

from siren_ros.cli.train.torch_part import torch_part
from siren_ros.errors import InputError


def test_a_part_is_found_by_its_names() -> None:
    assert torch_part("risk", "math", "hypot") is math.hypot


def test_the_message_names_what_is_missing_and_how_to_get_it() -> None:
    with pytest.raises(InputError, match=r"no no_such_module.*--with models siren train risk"):
        torch_part("risk", "no_such_module", "fitted")
