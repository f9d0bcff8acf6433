from pathlib import PurePosixPath

import pytest

from docsite.links import for_the_site, page_of


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
