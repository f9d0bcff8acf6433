from hypothesis import given
from hypothesis import strategies as st

from siren_ros.interfaces.message_content import LONGEST_TEXT, shown_text


@given(st.text(max_size=2 * LONGEST_TEXT))
def test_what_is_shown_is_one_printable_line_of_bounded_length(text: str) -> None:
    shown = shown_text(text)
    assert shown.isprintable()
    assert len(shown) <= 10 * LONGEST_TEXT + 40
    if text.isprintable() and len(text) <= LONGEST_TEXT:
        assert shown == text


def test_escape_codes_are_spelled_out_and_a_long_text_says_how_long_it_was() -> None:
    assert shown_text("red \x1b[31m\nnext") == "red \\x1b[31m\\nnext"
    assert shown_text("é\ud800") == "é\\ud800"
    assert shown_text("x" * 100_000) == "x" * LONGEST_TEXT + "… (100000 characters)"
    assert shown_text("abcd", most=3) == "abc… (4 characters)"
