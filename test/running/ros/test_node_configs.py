"""The parameter file says what the dataclasses say."""

import dataclasses

import pytest
import yaml
from repository import REPOSITORY

from siren_ros.running.ros import node_configs
from siren_ros.running.ros.parameters import allowed_text, defaults_of

PARAMS = yaml.safe_load((REPOSITORY / "params" / "nodes.yaml").read_text(encoding="utf-8"))
CONFIGS = {
    "".join(part.capitalize() for part in node.split("_")): node
    for node in (*node_configs.DEFAULT_PARTICIPANTS, "kitti_exporter", "detector", "player", "viewer", "cosim")
}


@pytest.mark.parametrize("node", CONFIGS.values())
def test_the_file_holds_every_default_and_nothing_else(node: str) -> None:
    name = next(prefix for prefix, value in CONFIGS.items() if value == node)
    config_type = getattr(node_configs, f"{name}Config")
    assert PARAMS[node]["ros__parameters"] == defaults_of(config_type)


def test_the_file_has_no_other_nodes() -> None:
    assert set(PARAMS) == set(CONFIGS.values())


@pytest.mark.parametrize("name", CONFIGS)
def test_every_parameter_is_described(name: str) -> None:
    config_type = getattr(node_configs, f"{name}Config")
    defaults = defaults_of(config_type)
    for field in dataclasses.fields(config_type):
        assert field.metadata["description"].endswith(".")
        assert allowed_text(field, type(defaults[field.name]))
        assert dataclasses.is_dataclass(config_type)
