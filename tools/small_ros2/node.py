"""``ros2 node list`` and ``ros2 node info``."""

import argparse

from small_ros2.ros_graph import DISCOVERY_S, discovered_nodes, node_named, observer


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declares the verbs."""
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    listing = verbs.add_parser("list", help="list the nodes")
    listing.set_defaults(main=list_nodes)
    info = verbs.add_parser("info", help="print the topics and services of a node")
    info.add_argument("node", help="name of the node")
    info.set_defaults(main=print_info)
    for verb in (listing, info):
        verb.add_argument(
            "--spin-time",
            type=float,
            default=DISCOVERY_S,
            metavar="S",
            help=f"at most so many s of discovery ({DISCOVERY_S})",
        )


def list_nodes(arguments: argparse.Namespace) -> int:
    """Prints the full names, sorted."""
    with observer("small_ros2_node_list") as node:
        for name in sorted(discovered_nodes(node, arguments.spin_time)):
            print(name)
    return 0


def print_info(arguments: argparse.Namespace) -> int:
    """Prints what a node publishes, subscribes to, offers and calls, in the real ros2's layout."""
    with observer("small_ros2_node_info") as node:
        full = node_named(node, arguments.node, arguments.spin_time)
        namespace, _, name = full.rpartition("/")
        here = (name, namespace or "/")
        print(full)
        for title, ask in (
            ("Subscribers", node.get_subscriber_names_and_types_by_node),
            ("Publishers", node.get_publisher_names_and_types_by_node),
            ("Service Servers", node.get_service_names_and_types_by_node),
            ("Service Clients", node.get_client_names_and_types_by_node),
        ):
            print(f"  {title}:")
            for topic, types in sorted(ask(*here)):
                print(f"    {topic}: {', '.join(types)}")
    return 0
