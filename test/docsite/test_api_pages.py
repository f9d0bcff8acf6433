import ast
from pathlib import Path

import pytest

from docsite.api_pages import api_navigation, api_pages, public_types

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


def test_the_first_page_has_the_public_functions_in_the_order_of_the_file(library: Path) -> None:
    assert api_pages(library)["api/index.md"].endswith("\n\n::: lib.api.read\n\n::: lib.api.close\n")


def test_the_types_are_those_of_public_signatures(library: Path) -> None:
    assert public_types(ast.parse(FUNCTIONS), "lib") == ["lib.roads.ends.End", "lib.roads.lanes.Lane"]
    head, _, body = api_pages(library)["api/types.md"].partition("---\n\n")
    assert "search:\n  boost: 0." in head
    assert body == "# Types\n\n::: lib.roads.ends.End\n\n::: lib.roads.lanes.Lane\n"


def test_the_types_are_also_those_that_the_top_package_offers_itself(library: Path) -> None:
    offered = "from lib.api import read as read\nfrom lib.errors import Bad\nfrom lib.seat.seats import Seat as Seat\n"
    (library / "__init__.py").write_text(f'"""The library."""\n{offered}')
    body = api_pages(library)["api/types.md"].partition("# Types\n\n")[2]
    assert body == "::: lib.roads.ends.End\n\n::: lib.roads.lanes.Lane\n\n::: lib.seat.seats.Seat\n"


def test_the_errors_have_a_page(library: Path) -> None:
    assert "::: lib.errors.Bad\n" in api_pages(library)["api/errors.md"]


def test_the_navigation_has_every_page_once(library: Path) -> None:
    named = [page if isinstance(page, str) else next(iter(page.values())) for page in api_navigation()]
    assert named == list(api_pages(library))
