"""What a release states stands once, or the same everywhere; what runs elsewhere calls what runs here."""

import re
import subprocess
import tomllib
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml
from repository import REPOSITORY

import siren_ros

PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCK = (REPOSITORY / "tools" / "environment" / "lock.txt").read_text(encoding="utf-8")


def test_the_version_stands_in_the_package_and_is_repeated_where_formats_demand_it() -> None:
    assert "version" in PROJECT["dynamic"]
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == siren_ros.__version__
    for package in ("package.xml", "msg_defs/package.xml"):
        assert ET.parse(REPOSITORY / package).findtext("version") == siren_ros.__version__  # noqa: S314 - our file


@pytest.mark.parametrize("extra", ["", *PROJECT["optional-dependencies"]])
def test_the_lock_has_a_version_within_each_range(extra: str) -> None:
    packaging = pytest.importorskip("packaging.requirements")
    locked = dict(line.split(" ;")[0].split("==") for line in LOCK.splitlines())
    ranges = PROJECT["optional-dependencies"][extra] if extra else PROJECT["dependencies"]
    for text in ranges:
        requirement = packaging.Requirement(text)
        if requirement.name == "siren_ros":
            continue
        version = locked[requirement.name.lower().replace("_", "-").replace(".", "-")]
        assert requirement.specifier.contains(version), (text, version)


def steps() -> list[str]:
    listing = subprocess.run([REPOSITORY / ".ci" / "run", "--list"], check=True, capture_output=True, text=True)
    return listing.stdout.split()


def called(text: str) -> list[str]:
    return [step for line in re.findall(r"\.ci/run((?: [a-z]+)+)", text) for step in line.split()]


def test_the_workflows_leave_no_step_out() -> None:
    workflows = "".join(
        path.read_text(encoding="utf-8") for path in Path(REPOSITORY, ".github/workflows").glob("*.yml")
    )
    assert set(called(re.sub(r" *#.*", "", workflows))) == set(steps())
