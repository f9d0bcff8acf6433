"""Pages that are made from the code have what the code has."""

import re

from repository import REPOSITORY

from docsite.command_page import command_page
from docsite.message_page import message_page


def test_the_page_of_the_command_has_every_verb_task_and_format() -> None:
    page = command_page()
    headings = {line for line in page.splitlines() if line.startswith("## ")}
    assert {"## `siren`", "## `siren info`", "## `siren evaluate yield`", "## `siren export nuscenes`"} <= headings
    assert "## `siren generate risk`" in headings
    assert len(headings) == page.count("## `siren")
    assert "--population {region,all}" in page


def test_the_page_of_the_command_has_the_options_of_every_command() -> None:
    page = command_page()
    assert re.findall(r"^usage: (siren[\w -]*) \[-h\]$", page, re.MULTILINE) == []
    assert all(option in page for option in ("--draw-seed N", "--pictures", "--evaluations N", "--only PART"))


def test_the_page_of_the_messages_has_every_type_with_its_fields() -> None:
    page = message_page(REPOSITORY / "msg_defs" / "msg")
    assert page.count("\n## `siren_msgs/") == len(list((REPOSITORY / "msg_defs" / "msg").glob("*.msg")))
    assert "float64 busy_s" in page
