"""Road networks of maps, compiled and read once in a process, for tests of every folder."""

from functools import cache
from pathlib import Path

from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.netconvert import run_netconvert
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import RoadNetwork


@cache
def network_of_map(source: Path | None = None) -> RoadNetwork:
    """The network of a file or of a built-in map by its name; of the town where none is given."""
    return parse_road_network(compile_map(source).read_bytes())


def plain_net(folder: Path, nodes: str, edges: str, connections: str = "") -> Path:
    """A net file in a folder, made of netconvert's plain nodes, edges and connections, each an element's content."""
    folder.mkdir(parents=True, exist_ok=True)
    options = []
    for kind, content in (("node", nodes), ("edge", edges), ("connection", connections)):
        path = folder / f"plain.{kind}.xml"
        path.write_text(f"<{kind}s>{content}</{kind}s>")
        options += [f"--{kind}-files", str(path)]
    net = folder / "plain.net.xml"
    net.write_bytes(run_netconvert([*options, "--no-turnarounds"], net, "plain"))
    return net
