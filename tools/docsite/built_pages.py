"""Checks of the built site: whatever its pages name is in it, and nothing asks the network for anything."""

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

_LOADED_LINKS: Final = {"stylesheet", "icon", "preload", "prefetch", "preconnect", "dns-prefetch", "manifest"}
"""``<link rel=…>`` that a browser follows by itself."""
_STYLE_URL: Final = re.compile(rb"url\(\s*['\"]?(?:https?:)?//[^)]*\)|@import\s+['\"](?:https?:)?//")


@dataclass
class _Page(HTMLParser):
    """What a page names: its anchors, its links, and what a browser loads for it."""

    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    loaded: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = {name: value or "" for name, value in attrs}
        self.anchors |= {named[name] for name in ("id", "name") if name in named}
        if tag == "a" and "href" in named:
            self.links.append(named["href"])
        loads = tag == "link" and not _LOADED_LINKS.isdisjoint(named.get("rel", "").split())
        self.loaded += [named[name] for name in ("src", "poster") if name in named]
        self.loaded += [named["href"]] if loads else []


def _read(path: Path) -> _Page:
    page = _Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def _is_external(target: str) -> bool:
    return bool(urlsplit(target).netloc) or urlsplit(target).scheme in ("mailto", "data", "tel")


def _file_of(page: Path, target: str, site: Path) -> Path:
    """The file that a link within the site leads to."""
    path = unquote(urlsplit(target).path)
    base = site if path.startswith("/") else page.parent
    file = page if not path else (base / path.lstrip("/")).resolve()
    return file / "index.html" if file.is_dir() else file


def faults_of_site(site: Path) -> list[str]:
    """What is wrong with the built pages, one line for each fault.

    Args:
        site: Folder of the built site.

    Returns:
        Pages that load something from elsewhere, links to missing files, links to missing anchors.
    """
    site = site.resolve()
    pages = {path: _read(path) for path in sorted(site.rglob("*.html"))}
    faults = []
    for path, page in pages.items():
        name = path.relative_to(site)
        faults += [f"{name}: a browser would load {url} from elsewhere" for url in page.loaded if urlsplit(url).netloc]
        for target in dict.fromkeys([*page.links, *page.loaded]):
            if _is_external(target) or path.name == "404.html":
                continue
            file = _file_of(path, target, site)
            anchor = unquote(urlsplit(target).fragment)
            if not file.is_file():
                faults.append(f"{name}: links to {target}, which does not exist")
            elif anchor and file in pages and anchor not in pages[file].anchors:
                faults.append(f"{name}: links to {target}; that page has no such anchor")
    faults += [
        f"{path.relative_to(site)}: loads {url.decode()} from elsewhere"
        for path in sorted(site.rglob("*.css"))
        for url in _STYLE_URL.findall(path.read_bytes())
    ]
    return faults
