"""Exports the episode's map as OpenDRIVE: SUMO's netconvert converts the compiled net."""

import tempfile
from pathlib import Path
from typing import Final

from defusedxml.ElementTree import fromstring

from siren_ros.data.datasets.files import FileWriter, document
from siren_ros.data.datasets.formats import EpisodeReport, FilesExporter
from siren_ros.data.record.episode_source import EpisodeSource
from siren_ros.simulation.roads.maps.mirrored_net import mirrored_net
from siren_ros.simulation.roads.maps.mirrored_opendrive import mirrored_opendrive
from siren_ros.simulation.roads.maps.netconvert import run_netconvert
from siren_ros.simulation.roads.mirror_image import right_hand_image

_HEADER: Final = {"revMajor": "1", "revMinor": "5", "date": "1970-01-01T00:00:00"}
_OBJECT: Final = {
    "dynamic": "no",
    "zOffset": "0",
    "validLength": "0",
    "orientation": "none",
    "pitch": "0",
    "roll": "0",
    "height": "0",
}
"""Attributes that OpenDRIVE 1.5 requires and netconvert leaves out: the object is static, upright and on the road."""


class OpenDriveExporter(FilesExporter):
    """Writes one file per map; episodes on the same map share it."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:  # noqa: ARG002 - the interface of all formats
        """Write the map."""
        files.write(f"{source.map_label}.xodr", opendrive_of(source))
        return EpisodeReport({"lanes": len(source.network.lanes)})


def opendrive_of(source: EpisodeSource) -> bytes:
    """The map as OpenDRIVE 1.5, in the ``map`` frame.

    netconvert names its files 1.4, but the outlines of objects and the header's offset that it writes came with 1.5.
    Raises MapError: netconvert cannot write it.
    """
    left_hand, net = source.network.left_hand, source.net_xml.encode()
    if left_hand:  # netconvert writes lanes as if traffic kept right
        net = mirrored_net(net)
    x_m, y_m = right_hand_image(source.network).sumo_offset_m
    with tempfile.TemporaryDirectory() as folder:
        net_path, output = Path(folder) / "map.net.xml", Path(folder) / "map.xodr"
        net_path.write_bytes(net)
        options = ["--sumo-net-file", str(net_path), "--opendrive-output", str(output)]
        # SUMO's coordinates are map coordinates plus the net's offset.
        moved = ["--offset.x", f"{-x_m:.6f}", "--offset.y", f"{-y_m:.6f}"]
        # Bends stay polygons. netconvert could fit curves, but these leave the lanes by up to 0.4 m.
        plain = ["--opendrive-output.straight-threshold", "180"]
        run_netconvert([*options, *moved, *plain], Path(folder) / "again.net.xml", source.description.map_name)
        drive = output.read_bytes()
        root = fromstring(mirrored_opendrive(drive) if left_hand else drive)
    for header in root.iter("header"):
        header.attrib.update(_HEADER)
    for thing in root.iter("object"):
        thing.attrib.update({**_OBJECT, **thing.attrib})
    return document(root)
