"""The page as HTML: its template and its styles are files in ``params/pages/study``."""

from pathlib import Path
from typing import Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from siren_ros.params.resources import params_dir
from siren_ros.study_report.content import Page

_FOLDER: Final = Path("pages", "study")


def html_of(page: Page) -> str:
    """The whole page in one file, with its styles."""
    folder = params_dir() / _FOLDER
    environment = Environment(
        loader=FileSystemLoader(folder), autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True
    )
    css = Markup((folder / "page.css").read_text(encoding="utf-8"))  # noqa: S704 - our own file
    return environment.get_template("page.html").render(page=page, css=css)
