import itertools
import tempfile
from pathlib import Path

import libsumo
from traffic_helpers import named_map

from siren_ros.simulation.traffic.sumo.call_log import CallLog

VEHICLE = '<additional><vType id="fast" maxSpeed="30"/></additional>'
STEPS = 40


def test_the_same_calls_give_the_same_simulation(tmp_path):
    net = named_map("town")[0].net_path
    with CallLog(tmp_path) as log, tempfile.TemporaryDirectory() as folder:
        types = Path(folder) / "types.add.xml"
        types.write_text(VEHICLE)
        libsumo.start(["sumo", "--net-file", str(net), "--additional-files", str(types), "--no-step-log", "true"])
        edge = next(name for name in libsumo.edge.getIDList() if not name.startswith(":"))
        libsumo.route.add("way", [edge])
        libsumo.vehicle.add("car", "way", typeID="fast")
        for _ in range(STEPS):
            libsumo.simulationStep()
        before = libsumo.vehicle.getIDCount(), libsumo.simulation.getTime()
    libsumo.vehicle.add("later", "way")  # the log is closed
    libsumo.close()
    clock = itertools.count()
    marks = log.replay(lambda: float(next(clock)))
    again = libsumo.vehicle.getIDCount(), libsumo.simulation.getTime()
    libsumo.close()
    assert again == before
    assert marks == [float(mark) for mark in range(STEPS + 1)]
    assert (tmp_path / "types.add.xml").read_text() == VEHICLE
