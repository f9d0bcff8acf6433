"""``ros2 param list`` and ``ros2 param get``."""

import argparse
import time
from typing import Any, Final

import rclpy
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from small_ros2.errors import CommandError
from small_ros2.ros_graph import DISCOVERY_S, POLL_S, discovered_nodes, node_named, observer

ANSWER_S: Final = 5.0
WORDS: Final = {
    ParameterType.PARAMETER_BOOL: "Boolean value is",
    ParameterType.PARAMETER_INTEGER: "Integer value is",
    ParameterType.PARAMETER_DOUBLE: "Double value is",
    ParameterType.PARAMETER_STRING: "String value is",
    ParameterType.PARAMETER_BYTE_ARRAY: "Byte values are",
    ParameterType.PARAMETER_BOOL_ARRAY: "Boolean values are",
    ParameterType.PARAMETER_INTEGER_ARRAY: "Integer values are",
    ParameterType.PARAMETER_DOUBLE_ARRAY: "Double values are",
    ParameterType.PARAMETER_STRING_ARRAY: "String values are",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the verbs."""
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    listing = verbs.add_parser("list", help="list the parameters of all nodes, or of one")
    listing.add_argument("node", nargs="?", help="name of the node")
    listing.set_defaults(main=list_parameters)
    get = verbs.add_parser("get", help="print the value of a parameter")
    get.add_argument("node", help="name of the node")
    get.add_argument("name", help="name of the parameter")
    get.add_argument("--hide-type", action="store_true", help="print the value only")
    get.set_defaults(main=print_parameter)
    for verb in (listing, get):
        verb.add_argument(
            "--spin-time",
            type=float,
            default=DISCOVERY_S,
            metavar="S",
            help=f"at most so many s of discovery ({DISCOVERY_S})",
        )


def _call(node: Node, kind: Any, service: str, request: Any) -> Any:
    """The answer of a service; None where there is none in time."""
    client = node.create_client(kind, service)
    deadline_s = time.monotonic() + ANSWER_S
    future = None
    while time.monotonic() < deadline_s:
        if future is None and client.service_is_ready():
            future = client.call_async(request)
        if future is not None and future.done():
            return future.result()
        rclpy.spin_once(node, timeout_sec=POLL_S)
    return None


def list_parameters(arguments: argparse.Namespace) -> int:
    """Prints the parameters below the name of their node."""
    with observer("small_ros2_param_list") as node:
        if arguments.node:
            names = [node_named(node, arguments.node, arguments.spin_time)]
        else:
            names = sorted(discovered_nodes(node, arguments.spin_time))
        for name in names:
            answer = _call(node, ListParameters, f"{name}/list_parameters", ListParameters.Request())
            if answer is None:
                continue  # a node without parameter services
            if not arguments.node:
                print(f"{name}:")
            for parameter in sorted(answer.result.names):
                print(f"  {parameter}")
    return 0


def print_parameter(arguments: argparse.Namespace) -> int:
    """Prints one value in the real ros2's words."""
    with observer("small_ros2_param_get") as node:
        name = node_named(node, arguments.node, arguments.spin_time)
        answer = _call(node, GetParameters, f"{name}/get_parameters", GetParameters.Request(names=[arguments.name]))
    if answer is None:
        raise CommandError(f"node '{name}' does not answer")
    if not answer.values or answer.values[0].type == ParameterType.PARAMETER_NOT_SET:
        raise CommandError(f"node '{name}' has no parameter '{arguments.name}'")
    value = parameter_value_to_python(answer.values[0])
    print(value if arguments.hide_type else f"{WORDS[answer.values[0].type]}: {value}")
    return 0
