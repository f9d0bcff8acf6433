from pathlib import Path

import pytest

from docsite.api_pages import api_navigation, api_pages


@pytest.fixture
def library(tmp_path: Path) -> Path:
    files = {
        "__init__.py": '"""The library."""',
        "errors.py": '"""Errors."""',
        "cli/__init__.py": '"""Programs."""',
        "cli/main.py": "",
        "roads/__init__.py": '"""The roads,\nand lanes.\n\nMore."""',
        "roads/lanes.py": "",
        "roads/ends.py": "",
        "roads/maps/__init__.py": '"""Maps."""',
        "roads/maps/read.py": "",
        "world/__init__.py": '"""Only a package."""',
        "world/deep/__init__.py": '"""Below it."""',
        "world/deep/inside.py": "",
        "no_package/data.py": "",
    }
    for name, text in files.items():
        path = tmp_path / "lib" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "lib"


def test_each_package_with_modules_has_a_page_that_names_all_of_them(library: Path) -> None:
    pages = api_pages(library)
    assert list(pages) == [
        "api/index.md",
        "api/lib.md",
        "api/lib.roads.md",
        "api/lib.roads.maps.md",
        "api/lib.world.deep.md",
    ]
    head, _, body = pages["api/lib.roads.md"].partition("---\n\n")
    assert "search:\n  boost: 0." in head
    assert body == "# `lib.roads`\n\nThe roads, and lanes.\n\n::: lib.roads.ends\n\n::: lib.roads.lanes\n"


def test_the_index_says_what_every_package_is(library: Path) -> None:
    index = api_pages(library)["api/index.md"]
    assert "| [`lib.roads.maps`](lib.roads.maps.md) | Maps. |" in index
    assert "| `lib.world` | Only a package. |" in index
    assert "lib.cli" not in index


def test_the_navigation_has_every_page_once(library: Path) -> None:
    assert api_navigation(library) == [
        "api/index.md",
        "api/lib.md",
        {"roads": [{"roads": "api/lib.roads.md"}, {"roads.maps": "api/lib.roads.maps.md"}]},
        {"world": [{"world.deep": "api/lib.world.deep.md"}]},
    ]
