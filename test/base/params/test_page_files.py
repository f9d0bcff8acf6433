"""Templates of pages and their parts, from ``params/pages``."""

from pathlib import Path

import pytest
from jinja2 import TemplateNotFound, UndefinedError

from siren_ros.base.params import page_files
from siren_ros.base.params.page_files import page_part, page_template

TEXT = "<p>{{ value }}</p>\n{% if value %}\nyes\n{% endif %}\n"


@pytest.fixture(autouse=True)
def pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "pages" / "made"
    folder.mkdir(parents=True)
    (folder / "page.html").write_text(TEXT, encoding="utf-8")
    (folder / "page.css").write_text("a > b {}\n", encoding="utf-8")
    monkeypatch.setattr(page_files, "params_dir", lambda: tmp_path)


def test_values_are_escaped_and_parts_are_not() -> None:
    assert page_template("made").render(value="<b>") == "<p>&lt;b&gt;</p>\n\nyes\n"
    assert page_template("made").render(value=page_part("made", "page.css")) == "<p>a > b {}\n</p>\n\nyes\n"


def test_texts_of_other_programs_come_without_control_characters() -> None:
    assert page_template("made").render(value="a\x1b[31m\udce9") == "<p>a\\x1b[31m\\udce9</p>\n\nyes\n"


def test_ends_of_lines_are_kept_or_left_out() -> None:
    assert page_template("made", trim_blocks=True).render(value=1) == "<p>1</p>\nyes\n"
    assert page_template("made", keep_trailing_newline=True).render(value=0) == "<p>0</p>\n\n"


def test_a_missing_value_and_a_missing_page_are_errors() -> None:
    with pytest.raises(UndefinedError):
        page_template("made").render()
    with pytest.raises(TemplateNotFound):
        page_template("no_such")
