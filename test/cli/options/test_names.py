"""Names in one word of a command line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.cli.options.names import names_in


@pytest.mark.parametrize(
    ("text", "names"),
    [("cv,idm", ("cv", "idm")), (" cv , idm ", ("cv", "idm")), ("cv,,idm,", ("cv", "idm")), ("", ()), (" , ", ())],
)
def test_names_stand_between_commas(text: str, names: tuple[str, ...]) -> None:
    assert names_in(text) == names


@given(st.lists(st.from_regex(r"[a-z][a-z0-9_.]{0,8}", fullmatch=True)))
def test_joined_names_come_back_in_their_order(names: list[str]) -> None:
    assert names_in(",".join(names)) == tuple(names)
