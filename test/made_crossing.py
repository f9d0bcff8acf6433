"""Nets of a few straight streets, made by netconvert for a test: a crossing whose arms end after some metres."""

from pathlib import Path

from siren_ros.simulation.roads.maps.netconvert import run_netconvert

CROSSING = {"c": (0, 0), "n": (0, 60), "e": (80, 0), "s": (0, -70), "w": (-300, 0)}
ARMS = ("n c", "e c", "s c", "w c")


def made_net(
    folder: Path, nodes: dict[str, tuple[float, float]], streets: tuple[str, ...], *options: str, narrow: str = ""
) -> bytes:
    """A net of streets with two lanes each way, or one at ``narrow`` nodes; the node ``c`` has a signal."""
    kinds = {name: ' type="traffic_light"' if name == "c" else "" for name in nodes}
    marks = (f'<node id="{name}" x="{x}" y="{y}"{kinds[name]}/>' for name, (x, y) in nodes.items())
    ends = [street.split() for street in streets]
    ways = [*ends, *([b, a] for a, b in ends)]
    edges = (
        f'<edge id="{a}_{b}" from="{a}" to="{b}" numLanes="{1 if {a, b} & set(narrow) else 2}" speed="13.9"/>'
        for a, b in ways
    )
    (folder / "x.nod.xml").write_text(f"<nodes>{''.join(marks)}</nodes>")
    (folder / "x.edg.xml").write_text(f"<edges>{''.join(edges)}</edges>")
    files = ("-n", str(folder / "x.nod.xml"), "-e", str(folder / "x.edg.xml"))
    common = ("--xml-validation", "never", "--no-warnings", "--offset.disable-normalization")
    return run_netconvert((*files, *common, *options), folder / "out.net.xml", "made")
