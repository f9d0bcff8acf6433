"""Types of junctions and priorities of their approaches, out of signs on a junction of four roads."""

import pytest
from defusedxml.ElementTree import fromstring

from siren_ros.roads.maps.junction_control import control_patches, document, normal_edges

NET = """<net>
<edge id=":J_0" function="internal"/><edge id=":J_w" function="walkingarea"/>
<edge id="n" to="J" priority="5"/><edge id="e" to="J" priority="3"/><edge id="s" to="J"/>
<edge id="w" to="J" priority="4"/>
<edge id="path" to="J" priority="-7"/><edge id="away" to="K" priority="9"/>
<junction id="J" type="{kind}"/><junction id="K" type="priority"/></net>"""


def patched(stopping: str, yielding: str = "", kind: str = "priority") -> tuple[dict[str, str], dict[str, int]]:
    """Types of nodes and priorities of edges; nobody drives on the path."""
    net = fromstring(NET.format(kind=kind))
    nodes, priorities = control_patches(
        net, stopping.split(), yielding.split(), lambda edge: edge.attrib["id"] != "path"
    )
    return {node.attrib["id"]: node.attrib["type"] for node in nodes}, dict(priorities)


def test_edges_outside_junctions_are_the_normal_ones() -> None:
    net = fromstring(NET.format(kind="priority"))
    assert [edge.attrib["id"] for edge in normal_edges(net)] == ["n", "e", "s", "w", "path", "away"]


@pytest.mark.parametrize(
    ("stopping", "yielding", "nodes", "priorities"),
    [
        ("", "", {}, {}),
        ("n", "", {"J": "priority_stop"}, {"n": 0}),
        ("n e s w", "", {"J": "allway_stop"}, {"n": 4, "e": 2, "s": 0, "w": 3}),
        ("n e w", "", {"J": "priority_stop"}, {"n": 0, "e": 0, "w": 0}),
        ("", "s", {}, {"s": 0}),
        ("", "n", {}, {"n": 0}),
        ("n", "s", {"J": "priority_stop"}, {"n": 2, "s": 0}),
        ("path away", "", {"K": "allway_stop"}, {"away": 8}),
    ],
)
def test_signs_lower_their_approaches_below_the_others(
    stopping: str, yielding: str, nodes: dict[str, str], priorities: dict[str, int]
) -> None:
    """One less than the least of the approaches without a sign and the own one; 1 where nothing is stated."""
    assert patched(stopping, yielding) == (nodes, priorities)


@pytest.mark.parametrize("kind", ["traffic_light", "traffic_light_right_on_red"])
def test_a_signal_outranks_signs(kind: str) -> None:
    assert patched("n", "e", kind) == ({}, {})


def test_a_plain_file_holds_the_elements() -> None:
    net = fromstring(NET.format(kind="priority"))
    nodes, _ = control_patches(net, ["n"], [], lambda _: True)
    root = fromstring(document("nodes", nodes))
    assert root.tag == "nodes"
    assert [dict(one.attrib) for one in root] == [{"id": "J", "type": "priority_stop"}]
