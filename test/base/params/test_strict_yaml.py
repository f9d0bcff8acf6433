"""The reader of parameter files names file and line; every kind of file goes through it."""

from pathlib import Path

import pytest

from siren_ros.base.params import plain_yaml
from siren_ros.base.params.resources import named_params_file, params_dir
from siren_ros.base.params.strict_yaml import read_strict_yaml
from siren_ros.errors import InputError
from siren_ros.sensing.look import load_look
from siren_ros.sensing.suite import load_suite
from siren_ros.simulation.dynamics.parameters import read_vehicle_parameters
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.plan import load_drivers

READERS = {"templates": load_template, "presets": load_preset, "suites": load_suite, "looks": load_look}
READERS |= {"drivers": load_drivers}


@pytest.mark.parametrize("kind", READERS)
def test_an_unknown_key_is_refused_with_its_line(kind: str, tmp_path: Path) -> None:
    good = min((params_dir() / kind).glob("*.yaml")).read_text(encoding="utf-8").rstrip("\n")
    file = tmp_path / "mine.yaml"
    file.write_text(f"{good}\nsurprise: 1\n", encoding="utf-8")
    line = good.count("\n") + 2
    with pytest.raises(InputError, match=rf"mine\.yaml:{line}: surprise"):
        READERS[kind](str(file))


def test_an_unknown_key_of_a_vehicle_is_refused_with_its_line(tmp_path: Path) -> None:
    for file in (params_dir() / "vehicles").glob("*.yaml"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    good = (tmp_path / "van.yaml").read_text(encoding="utf-8").rstrip("\n")
    (tmp_path / "van.yaml").write_text(f"{good}\nsurprise: 1\n", encoding="utf-8")
    with pytest.raises(InputError, match=rf"van\.yaml:{good.count(chr(10)) + 2}: surprise"):
        read_vehicle_parameters(tmp_path)


def test_a_suite_names_the_line_of_a_wrong_value(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("lidars:\n  roof:\n    mount: {x_m: 0, y_m: 0, z_m: 3}\n    rate_hz: 7\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"mine\.yaml:4: lidars\.roof\.rate_hz"):
        load_suite(str(file))


def test_the_same_text_is_parsed_once(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(f"key: {tmp_path.name}\n", encoding="utf-8")
    parsed = plain_yaml.compose.cache_info().misses
    for _ in range(3):
        top = read_strict_yaml(file)
        assert top.text("key") == tmp_path.name
    assert plain_yaml.compose.cache_info().misses == parsed + 1
    file.write_text("key: other\n", encoding="utf-8")
    assert read_strict_yaml(file).text("key") == "other"


@pytest.mark.parametrize("name", ["\0.yaml", "x" * 5000 + ".yaml", "~nobody-here/a.yaml", "S99"])
def test_a_name_that_is_no_file_is_answered_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError, match="S1, S2"):
        named_params_file("template", "templates", name)
