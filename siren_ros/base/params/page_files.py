"""Parts of the HTML pages that commands write: jinja2 templates, styles and scripts in ``params/pages``."""

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from siren_ros.base.params.resources import params_dir
from siren_ros.errors import shown_text


def page_template(page: str, *, trim_blocks: bool = False, keep_trailing_newline: bool = False) -> Template:
    """Load a page's template; values are escaped, and a missing value is an error. The options are jinja2's."""
    environment = Environment(
        loader=FileSystemLoader(params_dir() / "pages" / page),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=trim_blocks,
        keep_trailing_newline=keep_trailing_newline,
        finalize=_written,
    )
    return environment.get_template("page.html")


def _written(value: object) -> object:
    """A text without control characters, which names from other programs and files may contain."""
    return shown_text(value, len(value)) if type(value) is str else value


def page_part(page: str, name: str) -> Markup:
    """A file of a page, such as its styles, that is inserted unchanged."""
    return Markup((params_dir() / "pages" / page / name).read_text(encoding="utf-8"))  # noqa: S704 - our own file
