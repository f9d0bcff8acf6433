"""Links of documents: GitHub shows the files where they lie, the site shows pages of its own tree."""

import posixpath
import re
from pathlib import PurePosixPath
from typing import Final

ROOT_PAGES: Final = {"README.md": "index.md", "CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
"""Documents in the repository's root, and the pages that they are on the site."""
_LINK: Final = re.compile(r"\]\(([^)#\s:]+)(#[^)\s]*)?\)")
_SOURCE: Final = re.compile(r'\bsrc="([^":]+)"')


def page_of(document: str) -> str | None:
    """The path on the site of a file of the repository; None where the site does not have it."""
    if document in ROOT_PAGES:
        return ROOT_PAGES[document]
    return document.removeprefix("docs/") if document.startswith("docs/") else None


def for_the_site(markdown: str, document: PurePosixPath) -> str:
    """The text of a document with its links as the site needs them.

    Args:
        markdown: Its text.
        document: Its path in the repository.

    Returns:
        The text; a link to a file that the site does not have stays as it is, so that the build reports it.
    """
    page = page_of(str(document))
    folder = posixpath.dirname(page or "")

    def moved(target: str) -> str:
        on_site = page_of(posixpath.normpath(posixpath.join(str(document.parent), target)))
        return target if on_site is None else posixpath.relpath(on_site, folder or ".")

    linked = _LINK.sub(lambda link: f"]({moved(link[1])}{link[2] or ''})", markdown)
    return _SOURCE.sub(lambda source: f'src="{moved(source[1])}"', linked)
