"""What mkdocs.yml asks for while the site is built: mkdocs calls these functions by their names.

Everything else of the site is in ``docsite`` and knows nothing of mkdocs.
"""

import re
from pathlib import Path, PurePosixPath
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from docsite.api_pages import api_navigation, api_pages
from docsite.built_pages import faults_of_site
from docsite.command_page import command_page
from docsite.links import ROOT_PAGES, for_the_site
from docsite.message_page import message_page

REPOSITORY = Path(__file__).resolve().parents[1]
_FILM = re.compile(r"^\[Film\]\((\S+\.mp4)\)", re.MULTILINE)
_LONG_PATH = re.compile(r"(?<=<code>)(?:\w+/){3,}[\w.]+(?=</code>)")
_VIDEO = r'<video src="\1" controls muted loop playsinline width="800"></video>\n\nFilm'


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """The pages of the API go where the navigation names their section."""
    for section in config.nav or []:
        if isinstance(section, dict) and section.get("API reference") == "api/":
            section["API reference"] = api_navigation()
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that are made from the code, and those of the repository's root."""
    made = {
        **{page: (REPOSITORY / document).read_text(encoding="utf-8") for document, page in ROOT_PAGES.items()},
        **api_pages(REPOSITORY / "siren_ros"),
        "command.md": command_page(),
        "messages.md": message_page(REPOSITORY / "msg_defs" / "msg"),
    }
    for path, text in made.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Page, **_: Any) -> str:
    """Turns links between documents into links between pages, and shows films."""
    path = page.file.src_uri
    document = next((root for root, made in ROOT_PAGES.items() if made == path), f"docs/{path}")
    return for_the_site(_FILM.sub(_VIDEO, markdown), PurePosixPath(document))


def on_page_content(html: str, **_: Any) -> str:
    """Lets long paths of files break after a slash, so that tables fit the page."""
    return _LONG_PATH.sub(lambda path: path[0].replace("/", "/<wbr>"), html)


def on_post_build(config: MkDocsConfig) -> None:
    """Fails the build where a page asks the network for something, or names a file or an anchor that is not there."""
    faults = faults_of_site(Path(config.site_dir))
    if faults:
        raise PluginError("\n".join(["the built pages have faults:", *faults]))
