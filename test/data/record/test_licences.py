import re
import tomllib

from repository import REPOSITORY

from siren_ros.data.record.licences import LICENCE, LICENCE_URL


def test_one_licence_is_stated_everywhere():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    packages = [REPOSITORY / "package.xml", REPOSITORY / "msg_defs" / "package.xml"]
    stated = [
        project["license"]["text"],
        *(re.search("<license>(.*)</license>", path.read_text())[1] for path in packages),
        re.search("^license: (.*)$", (REPOSITORY / "CITATION.cff").read_text(), re.MULTILINE)[1],
    ]
    assert stated == [LICENCE] * 4
    text = (REPOSITORY / "LICENSE").read_text()
    assert "Apache License" in text
    assert LICENCE_URL.rsplit("/", 1)[0].removeprefix("https://www.") in text
