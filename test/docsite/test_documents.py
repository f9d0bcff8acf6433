import re

import pytest

from docsite.documents import figure_of, figures_by_hand, rewrite, sources_in
from siren_ros.errors import InputError
from siren_ros.lab.reproduction.results import PartResult

RESULTS = {
    "town": PartResult("", (), {}, 1.0, {"S1.holds": "20/20", "S1.ade_m": 1.994, "S2.ade_m": -2.5, "ade_m": 0.25})
}
TABLES = {"checks": lambda: "| a | |\n|---|---|\n| `b` | c d |"}


@pytest.fixture
def after_writing(tmp_path):
    """What a document holds after it was written; it must not change when it is written again."""

    def after_writing(text: str) -> str:
        page = tmp_path / "page.md"
        page.write_text(text, encoding="utf-8")
        assert rewrite(page, tmp_path, RESULTS, TABLES) == (page.read_text(encoding="utf-8") != text)
        assert not rewrite(page, tmp_path, RESULTS, TABLES)
        return page.read_text(encoding="utf-8")

    return after_writing


@pytest.mark.parametrize("before", ["", "7", "20/19", "-0.5", "+1,000.25", "12%", "–"])
def test_a_figure_stands_before_its_source_whatever_stood_there(before, after_writing) -> None:
    text = f"5 seeds ({before}<!--=town.S1.holds-->/{before}<!--=town.S1.ade_m:.2f--> m)"
    assert after_writing(text) == "5 seeds (20/20<!--=town.S1.holds-->/1.99<!--=town.S1.ade_m:.2f--> m)"


def test_a_column_has_its_source_in_the_header(after_writing) -> None:
    head = "|template|ADE<!--=**{town.*.ade_m:+.1f}** m ({town.*.ade_m:.2f})-->|text|\n|---|:-:|---|\n"
    rows = "|S1||a|\n|[S2](S2.md)|old|`b`|\n|mean<!--*=-->|||\n|the first<!--*=S1-->||c|\n|S1|none<!--by hand-->||\n"
    assert after_writing(f"{head}{rows}\n|S1|x|y|\n") == (
        f"{head}|S1|**+2.0** m (1.99)|a|\n|[S2](S2.md)|**-2.5** m (-2.50)|`b`|\n|mean<!--*=-->|**+0.2** m (0.25)||\n"
        "|the first<!--*=S1-->|**+2.0** m (1.99)|c|\n|S1|none<!--by hand-->||\n\n|S1|x|y|\n"
    )


def test_a_table_stands_between_its_comments(after_writing) -> None:
    text = "a\n<!-- table of checks -->\nold\n\nold\n<!-- end of table -->\nb\n"
    assert after_writing(text) == (
        "a\n<!-- table of checks -->\n\n|a||\n|---|---|\n|`b`|c d|\n\n<!-- end of table -->\nb\n"
    )


@pytest.mark.parametrize("source", ["town.S9.holds", "moon.S1.holds", "town.S1.holds:.2f"])
def test_a_wrong_source_is_named_with_its_document(source, after_writing) -> None:
    with pytest.raises(InputError, match=rf"page\.md.*{re.escape(source)}"):
        after_writing(f"# Page\n1.99<!--={source}-->\n")


def test_a_table_that_does_not_exist_is_named_with_its_document(after_writing) -> None:
    with pytest.raises(InputError, match=r"page\.md.*nothing.*checks"):
        after_writing("<!-- table of nothing -->\n<!-- end of table -->\n")


def test_measured_figures_without_a_source_are_found() -> None:
    sourced = "1.99<!--=town.S1.ade_m:.2f-->\n<!-- table of checks -->\n1.99\n<!-- end of table -->\n"
    columns = "|a|b<!--={town.*.ade_m:.2f}-->|\n|---|---|\n|S1|1.99|\n"
    assert sources_in(f"{sourced}{columns}") == ["town.S1.ade_m:.2f"] * 2
    sources = {figure_of(RESULTS, "page.md", source): source for source in ("town.S1.ade_m:.2f", "town.ade_m:.1f")}
    by_hand = "error 1.99 m\nversion 1.99.1, file v1.99, 11.99, 1.991\nhalf of 0.2\n"
    assert figures_by_hand(sourced + by_hand + columns, sources) == ["1.99: write 1.99<!--=town.S1.ade_m:.2f-->"]
