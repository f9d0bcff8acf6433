"""The API reference: one page for each package of the library, written by mkdocstrings from the source text."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

PROGRAMS: Final = ("cli", "benchmarks")
"""Packages of programs: nobody imports them; they have other pages."""

_FOUND_LAST: Final = "---\nsearch:\n  boost: 0.3\n---\n\n"
"""The search shows documents before pages of the API."""


def _packages(library: Path) -> Iterator[Path]:
    """Folders of the library with modules of their own, by path."""
    for folder in [library, *sorted(path for path in library.rglob("*") if path.is_dir())]:
        inside = folder.relative_to(library).parts
        if (folder / "__init__.py").is_file() and inside[:1] not in {(name,) for name in PROGRAMS}:
            yield folder


def _dotted(library: Path, path: Path) -> str:
    return ".".join(path.relative_to(library.parent).with_suffix("").parts)


def _summary(module: Path) -> str:
    """The first paragraph of a module's docstring, on one line."""
    text = ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or ""
    return " ".join(text.split("\n\n")[0].split())


def _modules(folder: Path) -> list[Path]:
    return sorted(path for path in folder.glob("*.py") if path.name != "__init__.py")


def api_pages(library: Path) -> dict[str, str]:
    """The pages by their path on the site.

    Args:
        library: Folder of the library's top package.

    Returns:
        An index with a line for each package, and a page for each package that has modules.
    """
    rows = []
    pages = {}
    for folder in _packages(library):
        name = _dotted(library, folder)
        modules = _modules(folder)
        summary = _summary(folder / "__init__.py")
        rows.append(f"| {f'[`{name}`]({name}.md)' if modules else f'`{name}`'} | {summary} |")
        if modules:
            blocks = "\n\n".join(f"::: {_dotted(library, module)}" for module in modules)
            pages[f"api/{name}.md"] = f"{_FOUND_LAST}# `{name}`\n\n{summary}\n\n{blocks}\n"
    introduction = (
        "# API reference\n\nEverything public of the library, from its docstrings. "
        "The plan of the code says which package may import which.\n\n| package | content |\n|---|---|\n"
    )
    return {"api/index.md": introduction + "\n".join(rows) + "\n", **pages}


def api_navigation(library: Path) -> list[Any]:
    """The navigation's part: the index, and the packages below the top package that they belong to."""
    sections: dict[str, list[Any]] = {}
    for path in api_pages(library):
        name = path.removeprefix("api/").removesuffix(".md")
        if name in ("index", library.name):
            continue
        sections.setdefault(name.split(".")[1], []).append({".".join(name.split(".")[1:]): path})
    return ["api/index.md", f"api/{library.name}.md", *({name: pages} for name, pages in sections.items())]
