"""The page as HTML: its template and its styles are files in ``params/pages/study``."""

from typing import Final

from siren_ros.params.page_files import page_part, page_template
from siren_ros.study_report.content import Page

_PAGE: Final = "study"


def html_of(page: Page) -> str:
    """The whole page in one file, with its styles."""
    return page_template(_PAGE, keep_trailing_newline=True).render(page=page, css=page_part(_PAGE, "page.css"))
