"""Lowers the speed limits of a compiled map, so that a scenario has the same traffic on every map."""

import hashlib
from dataclasses import replace
from typing import Final
from xml.etree.ElementTree import tostring

from defusedxml.ElementTree import fromstring

from siren_ros.roads.maps.map_compiler import CompiledMap, store_net

_RECIPE: Final = "1"
"""Part of the cache key: raised whenever the way in which limits are lowered changes."""


def with_speed_limit(compiled: CompiledMap, limit_mps: float) -> CompiledMap:
    """The map with no lane's speed limit above a limit; the map itself where none is.

    The paper's traffic drives at the limit that CARLA gives to roads without a sign, 30 km/h. Higher limits of a map
    would leave nothing for an EMV at 50 km/h to pass. The lowered net is kept in the cache of compiled maps.

    Args:
        compiled: A compiled map.
        limit_mps: The highest limit that remains.

    Raises:
        InputError: The cache folder cannot be written.
    """
    key = hashlib.sha256(f"{_RECIPE} {limit_mps:.2f} {compiled.sha256}".encode()).hexdigest()
    path = compiled.net_path.with_name(f"{compiled.name}-{key[:20]}.net.xml")
    try:
        net = path.read_bytes()
    except OSError:
        net = lowered_limits(compiled.read_bytes(), limit_mps)
        store_net(path, net)
    digest = hashlib.sha256(net).hexdigest()
    return compiled if digest == compiled.sha256 else replace(compiled, net_path=path, sha256=digest)


def lowered_limits(net: bytes, limit_mps: float) -> bytes:
    """A SUMO net with no lane's limit above ``limit_mps``; the same bytes where none was above."""
    root = fromstring(net)
    fast = [lane for lane in root.iter("lane") if float(lane.get("speed", "0")) > limit_mps]
    if not fast:
        return net
    for lane in fast:
        lane.set("speed", f"{limit_mps:.2f}")
    return bytes(tostring(root, encoding="utf-8", xml_declaration=True))
