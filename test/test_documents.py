"""The documents: words that anybody understands, names of what exists, figures and tables that are up to date."""

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import pytest
import yaml
from repository import REPOSITORY

from docsite.code_tables import TABLES
from docsite.documents import documents_of, figure_of, figures_by_hand, rewrite, sources_in
from siren_ros.base.at_import import full_name
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.lab.reproduction.make import read_parts
from siren_ros.lab.reproduction.results import PartResult, read_results
from siren_ros.scoring.judging.verify import verify_episode

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


CONSTANTS: Final = {
    "docs/datasets.md": {"1.25"},
    "docs/detection.md": {"0.11"},
    "docs/environment.md": {"17.7"},
    "docs/library.md": {"1.26"},
    "docs/paper.md": {"0.68", "1.24", "1.28", "1.29"},
    "docs/predictors.md": {"3.10"},
    "docs/sensors.md": {"0.67"},
    "docs/studies.md": {"2.55"},
}
"""Numbers of a document that equal a figure of the results by chance: constants, versions, values of cited sources."""


@pytest.fixture(scope="module")
def results() -> dict[str, PartResult]:
    return read_results(REPOSITORY / "docs" / "results.json")


def test_documents_hold_no_measured_figure_without_its_source(results: dict[str, PartResult]) -> None:
    texts = {path: path.read_text(encoding="utf-8") for path in DOCUMENTS}
    sources = {figure_of(results, "", source): source for text in texts.values() for source in sources_in(text)}
    assert len(sources) > 100
    by_hand = []
    for path, text in texts.items():
        name = path.relative_to(REPOSITORY).as_posix()
        measured = {figure: source for figure, source in sources.items() if figure not in CONSTANTS.get(name, ())}
        by_hand += [f"{name}: {figure}" for figure in figures_by_hand(text, measured)]
    assert not by_hand


NO_FIGURES = {"episodes", "pictures"}
NOT_RUN = {"learning", "train_driver"}
"""Parts that wait for their first run; the documents show no figure of them."""


def test_every_part_of_the_results_is_a_part_of_the_reproduction(results: dict[str, PartResult]) -> None:
    parts = read_parts(REPOSITORY / "params" / "reproduction.yaml", REPOSITORY)
    assert set(results) <= set(parts)
    assert set(parts) - set(results) <= NO_FIGURES | NOT_RUN


def test_the_page_of_the_recording_has_every_check_of_verify(record_of: Callable[..., EpisodeRecord]) -> None:
    documented = re.findall(r"^\| `(\w+)` \| \w", TABLES["checks"](), re.MULTILINE)
    assert documented == [part.name for part in verify_episode(record_of()).checks]
