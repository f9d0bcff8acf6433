"""Stop and yield signs as netconvert's plain XML: the type of a junction and the priority of its approaches."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from xml.etree.ElementTree import Element, tostring


def normal_edges(net: Element) -> Iterator[Element]:
    """The edges of a net outside junctions."""
    return (edge for edge in net.iterfind("edge") if edge.get("function", "normal") == "normal")


def control_patches(
    net: Element, stopping: Collection[str], yielding: Collection[str], is_driven_on: Callable[[Element], bool]
) -> tuple[list[Element], Mapping[str, int]]:
    """Node patches and edge priorities for signs.

    A junction is an all-way stop where all of its approaches have a stop sign, and a priority stop where some have.
    Signed approaches get less priority than the others. Junctions with signals stay as they are.

    Args:
        net: A net of netconvert.
        stopping: Ids of the edges that end at a stop sign.
        yielding: Ids of the edges that end at a yield sign.
        is_driven_on: Whether an edge counts as an approach.

    Returns:
        ``node`` elements, and the new priority of each signed edge by id.
    """
    incoming: dict[str, list[Element]] = {}
    for edge in normal_edges(net):
        if is_driven_on(edge):
            incoming.setdefault(edge.attrib["to"], []).append(edge)
    types = {junction.attrib["id"]: junction.get("type", "") for junction in net.iterfind("junction")}
    nodes: list[Element] = []
    priorities: dict[str, int] = {}
    for junction_id, edges in incoming.items():
        if types.get(junction_id, "").startswith("traffic_light"):
            continue
        stops = [edge for edge in edges if edge.attrib["id"] in stopping]
        signed = [edge for edge in edges if edge.attrib["id"] in stopping or edge.attrib["id"] in yielding]
        if stops:
            kind = "allway_stop" if len(stops) == len(edges) else "priority_stop"
            nodes.append(Element("node", id=junction_id, type=kind))
        others = [_priority(edge) for edge in edges if edge not in signed]
        for edge in signed:
            priorities[edge.attrib["id"]] = min([_priority(edge), *others]) - 1
    return nodes, priorities


def document(tag: str, elements: Iterable[Element]) -> bytes:
    """One of netconvert's plain XML files: ``nodes``, ``edges`` or ``connections``."""
    root = Element(tag)
    root.extend(elements)
    text: bytes = tostring(root, encoding="utf-8")
    return text


def _priority(edge: Element) -> int:
    return int(edge.get("priority", "1"))
