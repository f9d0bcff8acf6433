"""The documents: words that anybody understands, names of what exists, figures and tables that are up to date."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
import yaml
from repository import REPOSITORY

from docsite.code_tables import TABLES
from docsite.documents import documents_of, rewrite
from siren_ros.base.at_import import full_name
from siren_ros.lab.reproduction.results import read_results

DOCUMENTS: Final = documents_of(REPOSITORY)
PRIVATE_WORDS: Final = re.compile(r"\b(spells?|foot|rooms?|crew|seats?(?!/|\.\w)|besides?|carried)\b", re.IGNORECASE)
"""Words that mean something else to the reader than they once meant here."""
SOURCE_FOLDERS: Final = ("siren_ros", "nodes", "test", "params", "docs", "tools", "msg_defs", "examples", "launch")
SOURCE_SUFFIXES: Final = (".py", ".sh", ".msg")

parametrized = pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.name))


def quoted(text: str) -> Iterator[str]:
    """What stands between backticks within a line."""
    yield from re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL))


def is_there(name: str) -> bool:
    """Whether a quoted name is no file of ours, or a file or folder that exists."""
    if name.split("/", maxsplit=1)[0] in SOURCE_FOLDERS and "/" in name:
        return any(REPOSITORY.glob(name.rstrip("/")))
    if "/" not in name and name.endswith(SOURCE_SUFFIXES):
        return (REPOSITORY / name).is_file() or any(
            path.name == name for folder in SOURCE_FOLDERS for path in (REPOSITORY / folder).rglob(name)
        )
    return True


@parametrized
def test_documents_use_no_private_words(path: Path) -> None:
    lines = [
        f"{number}: {line.strip()}"
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if PRIVATE_WORDS.search(line)
    ]
    assert not lines


@parametrized
def test_files_that_documents_name_exist(path: Path) -> None:
    names = [name for name in quoted(path.read_text(encoding="utf-8")) if re.fullmatch(r"[\w./*-]+", name)]
    assert not [name for name in names if not is_there(name)]


@parametrized
def test_pages_and_pictures_that_documents_link_to_exist(path: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", path.read_text(encoding="utf-8"))
    assert not [link for link in links if "://" not in link and not (path.parent / link).is_file()]


@parametrized
def test_figures_and_tables_of_documents_are_up_to_date(path: Path, tmp_path: Path) -> None:
    copy = tmp_path / path.name
    copy.write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
    changed = rewrite(copy, tmp_path, read_results(REPOSITORY / "docs" / "results.json"), TABLES)
    assert not changed, f"./env python tools/write_documents.py writes {path.relative_to(REPOSITORY)}"


class _Navigation(yaml.SafeLoader):
    """Reads mkdocs.yml without what its tags would call."""


_Navigation.add_multi_constructor("", lambda *_: None)  # type: ignore[no-untyped-call] # PyYAML's stubs


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.relative_to(REPOSITORY).as_posix())
def test_documents_are_whole_as_they_are(path: Path) -> None:
    """Nothing fills them in later, so a name in double braces is a hole."""
    assert re.findall(r"\{\{.*", path.read_text(encoding="utf-8")) == []


def pages_of(navigation: object) -> Iterator[str]:
    """The pages that a part of the site's navigation names."""
    if isinstance(navigation, str):
        yield navigation
    elif isinstance(navigation, dict):
        yield from pages_of(list(navigation.values()))
    elif isinstance(navigation, list):
        for part in navigation:
            yield from pages_of(part)


def test_every_page_has_its_place_in_the_navigation_of_the_site() -> None:
    navigation = yaml.load((REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8"), _Navigation)["nav"]  # noqa: S506 - a safe loader
    named = sorted(pages_of(navigation))
    pages = {str(page.relative_to(REPOSITORY / "docs")) for page in (REPOSITORY / "docs").rglob("*.md")}
    missing = sorted(pages - set(named))
    assert not missing, f"add {', '.join(missing)} to `nav` in mkdocs.yml, in the section where its readers look"
    assert len(named) == len(set(named)), "a page stands in the navigation twice"


def test_pictures_and_films_are_small() -> None:
    largest = {".webp": 100_000, ".png": 100_000, ".jpg": 100_000, ".mp4": 300_000}
    files = [path for path in (REPOSITORY / "docs").rglob("*.*") if path.suffix in largest]
    assert {path.suffix for path in files} >= {".webp", ".mp4"}
    assert not [f"{path}: {path.stat().st_size} bytes" for path in files if path.stat().st_size > largest[path.suffix]]


def anchors_of(markdown: str) -> set[str]:
    """The anchors of a document's headings, as GitHub and the site make them."""
    text = re.sub(r"^```.*?^```", "", markdown, flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


@parametrized
def test_headings_that_documents_link_to_exist(path: Path) -> None:
    links = re.findall(r"\]\(([^)#:\s]*)#([^)\s]+)\)", path.read_text(encoding="utf-8"))
    targets = [((path.parent / target).resolve() if target else path, anchor) for target, anchor in links]
    missing = [
        f"{target.name}#{anchor}"
        for target, anchor in targets
        if target.is_file() and anchor not in anchors_of(target.read_text(encoding="utf-8"))
    ]
    assert not missing


@parametrized
def test_modules_that_documents_run_exist(path: Path) -> None:
    modules = re.findall(r"-m (siren_ros[\w.]*\w)", path.read_text(encoding="utf-8"))
    assert not [
        name for name in modules if not (REPOSITORY / full_name(name).replace(".", "/")).with_suffix(".py").is_file()
    ]


@parametrized
def test_tests_that_documents_name_exist(path: Path) -> None:
    named = re.findall(r"`(test/[\w/]+\.py)`", path.read_text(encoding="utf-8"))
    assert not [name for name in named if not (REPOSITORY / name).is_file()]


@pytest.mark.parametrize(
    "path", sorted((REPOSITORY / "params").rglob("*.*ml")), ids=lambda path: f"{path.parent.name}/{path.name}"
)
def test_parameter_files_use_no_private_words(path: Path) -> None:
    assert not PRIVATE_WORDS.findall(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("folder", ["siren_ros", "nodes"])
def test_packages_introduce_themselves_without_private_words(folder: str) -> None:
    introductions = {
        str(path.relative_to(REPOSITORY)): ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        for path in (REPOSITORY / folder).rglob("__init__.py")
    }
    assert not [name for name, text in introductions.items() if not text or PRIVATE_WORDS.search(text)]
