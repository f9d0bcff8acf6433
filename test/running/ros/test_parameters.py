"""Parameters of the nodes: declared from dataclasses, checked, and written down in the parameter file."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
import rclpy
import yaml
from dds_domains import shared_domain
from rclpy.node import Node
from rclpy.parameter import Parameter
from repository import REPOSITORY

from siren_ros.base.params.parameters import parameter
from siren_ros.errors import EXIT_BAD_INPUT, InputError
from siren_ros.running.ros import node_configs
from siren_ros.running.ros.parameters import check_names, declare_config, defaults_of


@dataclass(frozen=True)
class Config:
    count: int = parameter(3, "How many.", minimum=0, maximum=10)
    length_m: float = parameter(2.5, "How long.", minimum=0.0)
    level: str = parameter("", "Which.", choices=("", "L1"))
    on: bool = parameter(True, "Whether.")
    names: list[str] = parameter(["a"], "Who.")


FIELDS = {field.name: field for field in dataclasses.fields(Config)}


@pytest.fixture
def make_node() -> Iterator[Any]:
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=shared_domain())
    nodes: list[Node] = []

    def make(**values: Any) -> Node:
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        nodes.append(Node("configured", context=context, parameter_overrides=overrides))
        return nodes[-1]

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown(context=context)


def test_defaults_are_the_dataclass(make_node: Any) -> None:
    node = make_node()
    assert declare_config(node, Config) == Config()
    assert node.get_parameter("count").value == 3
    descriptor = node.describe_parameter("count")
    assert descriptor.description == "How many."
    assert (descriptor.integer_range[0].from_value, descriptor.integer_range[0].to_value) == (0, 10)


def test_overrides_are_taken(make_node: Any) -> None:
    node = make_node(count=7, length_m=4, level="L1", on=False, names=["x", "y"])
    assert declare_config(node, Config) == Config(7, 4.0, "L1", False, ["x", "y"])
    assert node.get_parameter("length_m").value == 4.0


def test_the_graph_cannot_ask_what_a_sealed_episode_is(make_node: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("siren_ros.running.ros.parameters.SEALED", set())
    node = make_node(salt="secret.hex", template="S4", seed=17)
    config = declare_config(node, node_configs.SumoBridgeConfig)
    assert (config.salt, config.template, config.seed) == ("secret.hex", "S4", 17)
    told = [node.get_parameter(name).value for name in ("salt", "template", "seed")]
    assert told == ["", "S2", 0]
    later = make_node(count=7)  # another node of the process
    assert declare_config(later, Config).count == 7
    assert later.get_parameter("count").value == 3


def test_a_bad_value_is_refused_by_name(make_node: Any) -> None:
    with pytest.raises(InputError) as caught:
        declare_config(make_node(count=11), Config)
    error = caught.value
    assert (error.parameter, error.allowed, error.exit_code) == ("count", "an integer from 0 to 10", EXIT_BAD_INPUT)


def test_misspelt_names_are_refused() -> None:
    check_names({"count": 1, "use_sim_time": True, "qos_overrides./clock.depth": 3}, FIELDS)
    with pytest.raises(InputError, match="cuont: 1 cannot be used; allowed: one of the parameters count, length_m"):
        check_names({"cuont": 1}, FIELDS)


PARAMS = yaml.safe_load((REPOSITORY / "params" / "nodes.yaml").read_text(encoding="utf-8"))
CONFIGS = {
    "".join(part.capitalize() for part in node.split("_")): node
    for node in (*node_configs.DEFAULT_PARTICIPANTS, "kitti_exporter", "detector", "player", "viewer", "cosim")
}


def test_the_file_holds_every_default_and_nothing_else() -> None:
    assert {node: content["ros__parameters"] for node, content in PARAMS.items()} == {
        node: defaults_of(getattr(node_configs, f"{name}Config")) for name, node in CONFIGS.items()
    }
