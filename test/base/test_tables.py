"""Tables as text, files and pages, with intervals; templates of pages and their parts."""

import base64
import csv
import hashlib
import json
import math
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy
from jinja2 import TemplateNotFound, UndefinedError
from markupsafe import Markup

from siren_ros.base import tables
from siren_ros.base.tables import (
    BLOCKS_MIN,
    NOTHING,
    UNBOUNDED_NOTE,
    Bounds,
    Cell,
    Interval,
    Table,
    counted,
    csv_text,
    interval_of_json,
    mean_of_intervals,
    render_page,
    share_interval,
    shown,
    text_of,
)

SURE = Interval(2.284, 2.104, 2.426, BLOCKS_MIN)
FEW = Interval(0.5, 0.25, 0.75, BLOCKS_MIN - 1)
TABLE = Table(
    "scores",
    "Scores of <both>",
    ("model", "ADE/FDE", "error", "n_%"),
    (("one & two", (1.444, 3.7), SURE, 1234), ("b", (1.0, None), NOTHING, 5)),
    specs={"error": ".1f"},
    reference=(("paper", "", None, 0.25),),
)


@pytest.mark.parametrize(
    ("cell", "spec", "text"),
    [
        *[(None, ".2f", "–"), ("", ".2f", ""), (0.0, ".2f", "0.00"), (-2.0, ".2f", "-2.00"), (1.26, ".1f", "1.3")],
        *[(0.126, ".0%", "13%"), (math.nan, ".2f", "–"), (1234, ".2f", "1,234"), ((1.444, None), ".2f", "1.44/–")],
        *[((1.444, 3.7, Bounds(SURE)), ".1f", "1.4/3.7 [2.1, 2.4]"), (SURE, ".2f", "2.28 [2.10, 2.43]")],
        *[(SURE, "+.1f", "+2.3 [+2.1, +2.4]"), (Interval(-2.0, -3.0, 1.0, 5), "+.2f", "-2.00 [-3.00, +1.00]")],
        *[(FEW, ".0%", "50% [–]"), (Bounds(FEW), ".2f", "[–]"), (NOTHING, ".2f", "–"), (Bounds(NOTHING), ".2f", "–")],
        *[(1e200, ".2f", "1e+200"), (-2.5e13, ".2f", "-2.5e+13"), (9.9e11, ".2f", "990000000000.00")],
        (Interval(-2.5e13, -3e13, 1.0, 9), ".2f", "-2.5e+13 [-3e+13, 1.00]"),
        (("17 of 20", Bounds(share_interval(17, 20))), ".0%", "17 of 20 [64%, 95%]"),
        (("0 of 5", Bounds(share_interval(0, 5))), ".0%", "0 of 5 [0%, 43%]"),
        (("3 of 4", Bounds(share_interval(3, 4))), ".0%", "3 of 4 [–]"),
    ],
)
def test_how_a_cell_is_written(cell: Cell, spec: str, text: str) -> None:
    assert shown(cell, spec) == text


def test_names_of_other_programs_are_printable_in_every_form() -> None:
    name = "a\x1b[31m\udce9\n"
    table = Table("names", name, ("model", name), ((name, (name, 1.0)),))
    forms = ("\n".join(table.text()), table.csv(), table.html(), str(table.json()).replace("\\\\", "\\"))
    for form in (*forms, table.latex().replace(r"\textbackslash{}", "\\")):
        assert form.replace("\n", "").isprintable()
        assert form.count("\\x1b[31m\\udce9\\n") >= 3


def test_text_has_a_column_for_each_title() -> None:
    assert TABLE.text() == [
        "Scores of <both>",
        "model      ADE/FDE    error           n_%",
        "one & two  1.44/3.70  2.3 [2.1, 2.4]  1,234",
        "b          1.00/–     –               5",
        "paper                 –               0.25",
    ]
    assert Table("t", "", ("model", "n"), (("a", 12), ("", ""))).text() == ["model  n", "a      12", ""]


def test_what_the_dash_of_an_interval_says_is_told_once_and_where_there_is_one() -> None:
    bounds_only = Table("t", "", ("a",), ((Bounds(FEW),),))
    in_a_pair = Table("t", "", ("a",), (((1.0, FEW),),))
    assert [table.has_unbounded for table in (TABLE, bounds_only, in_a_pair)] == [False, True, True]
    assert text_of([TABLE, TABLE]) == [*TABLE.text(), "", *TABLE.text()]
    assert text_of([bounds_only, in_a_pair]) == ["a", "[–]", "", "a", "1.00/0.50 [–]", UNBOUNDED_NOTE]
    assert text_of([]) == []


def test_csv_and_json_have_the_values() -> None:
    rows = list(csv.reader(TABLE.csv().splitlines()))
    assert rows == [list(TABLE.head), *map(list, TABLE.cells())]
    assert csv_text(("a", "b"), [(1, None), ("x,y", 0.5)]) == 'a,b\n1,\n"x,y",0.5\n'
    content = json.loads(json.dumps(TABLE.json(), allow_nan=False))
    assert (content["key"], content["caption"], content["head"]) == (TABLE.key, TABLE.caption, list(TABLE.head))
    interval = {"value": 2.284, "low": 2.104, "high": 2.426, "episodes": 5}
    assert content["rows"] == [["one & two", [1.444, 3.7], interval, 1234], ["b", [1.0, None], None, 5]]
    assert content["reference"] == [["paper", "", None, 0.25]]
    bounds = replace(TABLE, head=("a",), rows=((Bounds(SURE),), (Bounds(FEW),), (math.nan,)), reference=())
    assert bounds.json()["rows"] == [[[2.104, 2.426]], [None], [None]]


def test_latex_has_as_many_columns_and_no_special_characters() -> None:
    assert TABLE.latex().splitlines() == [
        "% Scores of <both>",
        r"\begin{tabular}{lccc}",
        r"\toprule",
        r"model & ADE/FDE & error & n\_\% \\",
        r"\midrule",
        r"one \& two & 1.44/3.70 & 2.3 [2.1, 2.4] & 1,234 \\",
        r"b & 1.00/-- & -- & 5 \\",
        r"\midrule",
        r"paper &  & -- & 0.25 \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]
    assert r"m/s\textsuperscript{2} & L2 $-$ L1 \\" in Table("t", "", ("m/s²", "L2 − L1"), ()).latex()
    assert replace(TABLE, reference=()).latex().count(r"\midrule") == 1


def test_html_is_well_formed_and_what_is_written_into_it_stays_text() -> None:
    long = replace(TABLE, rows=((*TABLE.rows[0][:3], "a cell with very many letters <in it>"),))
    table = ET.fromstring(long.html("page_"))  # noqa: S314 - the page that was just made
    assert table.get("id") == "page_scores"
    assert table.findtext("caption") == "Scores of <both>"
    head, *rows = [[cell.text or "" for cell in row] for row in table.iter("tr")]
    assert (head, rows) == (list(long.head), [list(row) for row in long.cells()])
    assert [cell.get("class") for cell in table.iter("td")] == [None, None, "long", None, None, None]


def test_one_and_several() -> None:
    assert [counted(number, "bag") for number in (0, 1, 2, 1234)] == ["0 bags", "1 bag", "2 bags", "1,234 bags"]


def test_five_blocks_bound_a_value_and_four_do_not() -> None:
    assert [Interval(1.0, 0.5, 1.5, blocks).bounded for blocks in (0, 1, 4, 5)] == [False, False, False, True]
    assert [Interval(1.0, 0.5, 1.5, blocks).valid for blocks in (0, 1)] == [False, True]
    assert not Interval(1.0, 0.5, 1.5, 5, scatter_known=False).bounded
    assert not NOTHING.valid


@pytest.mark.parametrize(("part", "whole"), [(0, 5), (3, 5), (20, 20), (17, 40)])
@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_a_share_has_wilsons_interval(part: int, whole: int, confidence: float) -> None:
    interval = share_interval(part, whole, confidence)
    expected = scipy.stats.binomtest(part, whole).proportion_ci(confidence, method="wilson")
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert (interval.value, interval.blocks) == (part / whole, whole)
    assert share_interval(0, 0, confidence) == NOTHING


def test_a_mean_of_shares_is_surer_than_each() -> None:
    """Of three equal parts each distance is divided by √3; what was not measured does not count."""
    share = share_interval(12, 20)
    mean = mean_of_intervals([share, NOTHING, share, share], 60)
    assert (mean.value, mean.blocks) == (pytest.approx(0.6), 60)
    assert mean.low == pytest.approx(0.6 - (0.6 - share.low) / np.sqrt(3.0))
    assert mean.high == pytest.approx(0.6 + (share.high - 0.6) / np.sqrt(3.0))
    assert mean_of_intervals([NOTHING], 3) == NOTHING
    assert mean_of_intervals([share_interval(5, 5), share_interval(9, 9)], 14).high == 1.0


def test_an_interval_is_read_from_a_file_as_it_was_written() -> None:
    sure, few = Interval(1.0, 0.5, 1.5, 6), Interval(1.0, 0.5, 1.5, 4)
    assert interval_of_json(sure.json()) == sure
    assert few.json() == {"value": 1.0, "low": None, "high": None, "episodes": 4}
    assert (interval_of_json(few.json()).value, interval_of_json(few.json()).bounded) == (1.0, False)
    assert NOTHING.json()["value"] is None
    assert [interval_of_json(content) for content in (NOTHING.json(), None, {})] == [NOTHING] * 3
    for known in (True, False):
        assert Interval(0.5, 0.25, 0.75, 6, known).scaled(100.0) == Interval(50.0, 25.0, 75.0, 6, known)
    both = {"value": 0.5, "low": 0.4, "high": 0.7}  # an older command names no episodes
    assert interval_of_json(both) == Interval(0.5, 0.4, 0.7, 5)
    assert not interval_of_json({**both, "episodes": 4}).bounded
    for lacking in ("low", "high"):
        single = interval_of_json({**both, lacking: None, "episodes": 9})
        assert (single.valid, single.bounded) == (True, False)


FRAME = (
    "<style>{{ style }}</style>{{ style_hash }}\n{% block body %}{% endblock %}"
    "{% if script %}{{ script }}{{ script_hash }}{% endif %}"
)
TEXT = '{% extends "base.html" %}\n{% block body %}<p>{{ value }}</p>\n{% if value %}\nyes\n{% endif %}{% endblock %}'
STYLE = ":root {}\na > b {}\n"


def hash_of(text: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def test_a_page_has_styles_and_script_with_their_hashes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "pages" / "made"
    folder.mkdir(parents=True)
    for file, text in (("../base.html", FRAME), ("../base.css", ":root {}\n"), ("page.html", TEXT)):
        (folder / file).write_text(text, encoding="utf-8")
    (folder / "page.css").write_text("a > b {}\n", encoding="utf-8")
    monkeypatch.setattr(tables, "params_dir", lambda: tmp_path)
    head, rest = render_page("made", value=0).split("\n<p>")
    assert (head, rest) == (f"<style>{STYLE}</style>{hash_of(STYLE).replace('+', '&#43;')}", "0</p>\n")
    assert "<p>&lt;b&gt;</p>\nyes\n" in render_page("made", value="<b>")
    assert "<p><b></p>" in render_page("made", value=Markup("<b>"))
    assert "<p>a\\x1b[31m\\udce9</p>" in render_page("made", value="a\x1b[31m\udce9")
    (folder / "page.js").write_text("if (a < b) c();", encoding="utf-8")
    assert render_page("made", value=0).endswith(f"if (a < b) c();{hash_of('if (a < b) c();')}")
    with pytest.raises(UndefinedError):
        render_page("made")
    with pytest.raises(TemplateNotFound):
        render_page("no_such", value=1)
