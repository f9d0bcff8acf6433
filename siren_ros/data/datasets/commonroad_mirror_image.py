"""Mirrors a CommonRoad scenario about its x axis.

A scenario with left-hand traffic is written as the mirror image of one with right-hand traffic.
"""

from typing import Final
from xml.etree.ElementTree import Element

from siren_ros.simulation.roads.mirror_image import OTHER_SIDE, negated

_SIDES: Final = ("left", "right", "Left", "Right")
_LANELET: Final = ("leftBound", "rightBound", "predecessor", "successor", "adjacentLeft", "adjacentRight")
"""Tags of a lanelet that come first, in the order of the schema."""
_ARMS: Final = ("incomingLanelet", "Right", "Straight", "Left")
"""Endings of the tags of an intersection's arm, in the order of the schema."""


def mirror_commonroad(root: Element) -> None:
    """Exchange left and right in place: coordinates, angles, names and the order of elements."""
    for tag in ("y", "orientation", "orientation/exact"):
        for number in root.iterfind(f".//{tag}"):
            if number.text and number.text.strip():
                number.text = negated(number.text)
    for direction in root.iter("direction"):
        direction.text = OTHER_SIDE.get(direction.text or "", direction.text)
    for lanelet in root.iter("lanelet"):
        for child in lanelet:
            child.tag = _exchanged(child.tag)
        lanelet[:] = sorted(lanelet, key=lambda child: _rank(_LANELET, child.tag))
    for arm in root.iter("incoming"):
        for child in arm:
            child.tag = _exchanged(child.tag)
        arm[:] = sorted(arm, key=lambda child: _rank(_ARMS, child.tag))


def _exchanged(tag: str) -> str:
    side = next((side for side in _SIDES if tag.startswith(side) or tag.endswith(side)), "")
    return tag.replace(side, OTHER_SIDE[side]) if side else tag


def _rank(order: tuple[str, ...], tag: str) -> int:
    return next((rank for rank, end in enumerate(order) if tag.endswith(end)), len(order))
