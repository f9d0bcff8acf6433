"""Pages of the site: of code, built ones, links between them, and pictures."""

import ast
import re
from pathlib import Path, PurePosixPath

import numpy as np
import pytest
from hand_made_record import EASTBOUND, LEFT_X_M, NORTHBOUND, SOUTHBOUND, Driven, at_speed, crossing, hand_made, line
from repository import REPOSITORY

from docsite.api_pages import api_navigation, api_pages, public_types
from docsite.built_pages import faults_of_site
from docsite.command_page import command_page
from docsite.links import for_the_site, page_of
from docsite.message_page import message_page
from docsite.pictures import film_start_s
from docsite.sensor_pictures import tiled, vehicles_ahead

FUNCTIONS = '''"""Public functions."""
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lib.roads.lanes import Lane
    from lib.roads.ends import End, Inside
    from other import Foreign


def read(path: str, lane: Lane | None = None) -> Iterator[End]:
    from lib.roads.read import found

    return found(path)


def close(end: End, foreign: Foreign) -> None: ...


def _hidden(inside: Inside) -> Inside: ...
'''


@pytest.fixture
def library(tmp_path: Path) -> Path:
    files = {"__init__.py": '"""The library."""', "errors.py": "class Bad(Exception): ...", "api.py": FUNCTIONS}
    for name, text in files.items():
        path = tmp_path / "lib" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "lib"


def test_the_pages_have_the_public_functions_in_the_order_of_the_file_and_the_errors(library: Path) -> None:
    pages = api_pages(library)
    assert pages["api/index.md"].endswith("\n\n::: lib.api.read\n\n::: lib.api.close\n")
    assert "::: lib.errors.Bad\n" in pages["api/errors.md"]
    named = [page if isinstance(page, str) else next(iter(page.values())) for page in api_navigation()]
    assert named == list(pages)


def test_the_types_are_those_of_public_signatures(library: Path) -> None:
    assert public_types(ast.parse(FUNCTIONS), "lib") == ["lib.roads.ends.End", "lib.roads.lanes.Lane"]
    offered = "from lib.api import read as read\nfrom lib.errors import Bad\nfrom lib.seat.seats import Seat as Seat\n"
    (library / "__init__.py").write_text(f'"""The library."""\n{offered}')
    body = api_pages(library)["api/types.md"].partition("# Types\n\n")[2]
    assert body == "::: lib.roads.ends.End\n\n::: lib.roads.lanes.Lane\n\n::: lib.seat.seats.Seat\n"


def site_of(folder: Path, **pages: str) -> Path:
    for name, body in pages.items():
        path = folder / name / "index.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"<html><body>{body}</body></html>")
    (folder / "picture.png").write_bytes(b"")
    return folder


@pytest.mark.parametrize(
    "body",
    [
        '<a href="../b/">page</a>',
        '<a href="../b/#here">anchor</a>',
        '<a href="#own">anchor</a><h1 id="own">x</h1>',
        '<a href="https://example.org/page">elsewhere, when the reader follows it</a>',
        '<a href="mailto:a@b">mail</a>',
        '<img src="../picture.png">',
        '<video poster="../picture.png"></video>',
        '<link rel="canonical" href="https://example.org/">',
        '<img src="data:image/png;base64,AA==">',
        '<a href="/b/">from the top</a>',
    ],
)
def test_sound_pages_have_no_faults(tmp_path: Path, body: str) -> None:
    assert faults_of_site(site_of(tmp_path, a=body, b='<h2 id="here">b</h2>')) == []


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ('<a href="../c/">x</a>', "a/index.html: links to ../c/, which does not exist"),
        ('<a href="../b/#there">x</a>', "a/index.html: links to ../b/#there; that page has no such anchor"),
        ('<a href="#own">x</a>', "a/index.html: links to #own; that page has no such anchor"),
        ('<img src="../other.png">', "a/index.html: links to ../other.png, which does not exist"),
        (
            '<script src="https://cdn.example.org/x.js"></script>',
            "a/index.html: a browser would load https://cdn.example.org/x.js from elsewhere",
        ),
        (
            '<link rel="stylesheet" href="//fonts.example.org/css">',
            "a/index.html: a browser would load //fonts.example.org/css from elsewhere",
        ),
        (
            '<link rel="preconnect" href="https://example.org">',
            "a/index.html: a browser would load https://example.org from elsewhere",
        ),
    ],
)
def test_each_fault_is_named(tmp_path: Path, body: str, fault: str) -> None:
    assert faults_of_site(site_of(tmp_path, a=body, b='<h2 id="here">b</h2>')) == [fault]
    for number, rule in enumerate(('@import "https://e.org/a.css";', "a { src: url(//e.org/f.woff2) }")):
        (tmp_path / f"own{number}.css").write_text("a { src: url(own.woff2) }" + rule)
    assert [line.partition(": loads ")[0] for line in faults_of_site(tmp_path)[1:]] == ["own0.css", "own1.css"]


def test_the_pages_of_the_command_and_of_the_messages_have_all_of_them() -> None:
    page = command_page()
    assert {"## `siren`", "## `siren generate risk`", "## `siren export nuscenes`"} <= set(page.splitlines())
    assert re.findall(r"^usage: (siren[\w -]*) \[-h\]$", page, re.MULTILINE) == []
    assert all(option in page for option in ("--draw-seed N", "--pictures", "--evaluations N", "--only PART"))
    page = message_page(REPOSITORY / "msg_defs" / "msg")
    assert page.count("\n## `siren_msgs/") == len(list((REPOSITORY / "msg_defs" / "msg").glob("*.msg")))
    assert "float64 busy_s" in page


@pytest.mark.parametrize(
    ("document", "page"),
    [
        ("README.md", "index.md"),
        ("CHANGELOG.md", "changelog.md"),
        ("docs/maps.md", "maps.md"),
        ("docs/templates/S1.md", "templates/S1.md"),
        ("docs/images/lidar.png", "images/lidar.png"),
        ("LICENSE", None),
        ("siren_ros/errors.py", None),
    ],
)
def test_documents_of_the_root_and_of_docs_are_on_the_site(document: str, page: str | None) -> None:
    assert page_of(document) == page


@pytest.mark.parametrize(
    ("document", "written", "on_site"),
    [
        ("README.md", "[a](docs/maps.md#sites)", "[a](maps.md#sites)"),
        ("README.md", "![a](docs/images/b.png)", "![a](images/b.png)"),
        ("README.md", "[a](CHANGELOG.md)", "[a](changelog.md)"),
        ("docs/maps.md", "[a](../README.md#what)", "[a](index.md#what)"),
        ("docs/maps.md", "[a](sensors.md)", "[a](sensors.md)"),
        ("docs/maps.md", "[a](#sites)", "[a](#sites)"),
        ("docs/templates/S1.md", "[a](../maps.md)", "[a](../maps.md)"),
        ("docs/templates/S1.md", "[a](../../CONTRIBUTING.md)", "[a](../contributing.md)"),
        ("docs/templates/S1.md", "[a](S2.md)", "[a](S2.md)"),
        ("README.md", "[a](https://example.org/docs/b.md)", "[a](https://example.org/docs/b.md)"),
        ("README.md", "[a](LICENSE)", "[a](LICENSE)"),
        ("docs/templates/S1.md", '<video src="films/S1.mp4">', '<video src="films/S1.mp4">'),
        ("README.md", '<img src="docs/images/b.png">', '<img src="images/b.png">'),
    ],
)
def test_links_lead_to_the_same_place(document: str, written: str, on_site: str) -> None:
    assert for_the_site(f"Text {written} text", PurePosixPath(document)) == f"Text {on_site} text"


@pytest.mark.parametrize(
    ("site_time_s", "duration_s", "start_s"),
    [
        (30.0, 45.0, 11.0),  # 26 s that end 7 s after the site
        (44.0, 45.0, 19.0),  # the episode ends before that
        (9.0, 45.0, 0.0),  # the EMV is there soon
        (None, 40.0, 14.0),  # never
    ],
)
def test_a_film_shows_the_way_to_the_site(site_time_s: float | None, duration_s: float, start_s: float) -> None:
    assert film_start_s(site_time_s, duration_s) == start_s


def test_pictures_are_tiled_row_by_row() -> None:
    shades = [np.full((2, 3, 3), shade, np.uint8) for shade in (10, 20, 30)]
    whole = tiled(shades, 2)
    assert whole.shape == (8, 10, 3)
    assert [whole[0, 0, 0], whole[1, 9, 0], whole[7, 2, 0], whole[7, 9, 0], whole[3, 0, 0]] == [10, 20, 30, 0, 0]


def test_the_vehicles_ahead_are_those_of_its_direction_nearest_first() -> None:
    left = line((LEFT_X_M, -120.0), (LEFT_X_M, 110.0))
    starts = {1: (NORTHBOUND, 40.0), 2: (NORTHBOUND, 90.0), 3: (left, 60.0), 4: (NORTHBOUND, 20.0)}
    starts |= {5: (SOUTHBOUND, 100.0), 6: (EASTBOUND, 100.0)}
    record = hand_made(crossing(), {key: Driven(path, at_speed(at, 5.0, 20)) for key, (path, at) in starts.items()})
    assert vehicles_ahead(record, 0.5, 2) == [3, 2]
    assert vehicles_ahead(record, 0.5, 1) == [3]
