from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.reproduction.documents import filled, marks_in, unmarked_figures, write_blocks
from siren_ros.reproduction.results import PartResult

RESULTS = {"town": PartResult("", (), {}, 1.0, {"S1.holds": "20/20", "S1.ade_m": 1.994})}


def test_marks_become_figures() -> None:
    text = "holds {{ town.S1.holds }}, {{town.S1.ade_m:.2f}} m"
    assert filled(text, RESULTS, "page.md") == "holds 20/20, 1.99 m"
    assert list(marks_in(text)) == [("town", "S1.holds", None), ("town", "S1.ade_m", ".2f")]


@pytest.mark.parametrize("mark", ["{{ town.S9.holds }}", "{{ moon.S1.holds }}", "{{ town.S1.holds:.2f }}"])
def test_a_wrong_mark_is_named_with_its_line(mark: str) -> None:
    with pytest.raises(InputError, match=r"page\.md:2"):
        filled(f"# Page\n{mark}\n", RESULTS, "page.md")


def test_a_block_is_written_from_its_file(tmp_path: Path) -> None:
    (tmp_path / "table.md").write_text("| {{ town.S1.ade_m:.1f }} |\n", encoding="utf-8")
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- results: table.md -->\nold\n<!-- end of results -->\nb\n", encoding="utf-8")
    assert write_blocks(page, RESULTS)
    assert page.read_text(encoding="utf-8") == "a\n<!-- results: table.md -->\n| 2.0 |\n<!-- end of results -->\nb\n"
    assert not write_blocks(page, RESULTS)


def test_figures_that_are_written_by_hand_are_found() -> None:
    marked = {"1.99": "{{ town.S1.ade_m:.2f }}", "2.0": "{{ town.S1.ade_m:.1f }}"}
    text = "error 1.99 m\nversion 1.99.1, file v1.99, 11.99, 1.991\nhalf of 2.0\n"
    assert unmarked_figures(text, marked) == ["1: 1.99, write {{ town.S1.ade_m:.2f }}"]
