"""A running episode whose sensors are a server's: its messages are those of its bag played there; faults are named."""

from itertools import zip_longest
from types import SimpleNamespace

import pytest
from carla_server import SIZES, carla_server, signals_in
from recorded_episode import quick_template

from siren_ros.data.datasets.simulator_scenarios import opendrive_of
from siren_ros.data.recording.bag_reader import open_bag
from siren_ros.running.carla.play import play
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.net_parser import parse_road_network

pytest.importorskip("carla", reason="CARLA's client has no wheel for this machine")


@pytest.fixture(scope="module")
def town():
    net = compile_map(None).read_bytes()
    description = SimpleNamespace(map_name="town")
    return opendrive_of(
        SimpleNamespace(network=parse_road_network(net), net_xml=net.decode(), description=description)
    ).decode()


def test_a_live_episode_holds_what_its_bag_holds_when_it_is_played(cosim, town, tmp_path):
    template = quick_template("S2")
    with carla_server(town, SIZES, signals_in(town)) as server:
        address = f"127.0.0.1:{server.port()}"
        words = (f"template:={template}", "duration_s:=1.0", f"carla:={address}", "bag:=live", "kitti:=false")
        run = cosim(*words, cwd=tmp_path)
        assert run.code == 0, run.err
        assert not server.get("settings")[0]
        assert {one.kind for one in server.get("actors").values()} == {"traffic.traffic_light"}
        play(tmp_path / "live", tmp_path / "played", address)
        with open_bag(tmp_path / "live") as live, open_bag(tmp_path / "played") as played:
            count = 0
            for one, other in zip_longest(live.messages(), played.messages()):
                assert (one.topic, one.time_ns, one.cdr) == (other.topic, other.time_ns, other.cdr)
                count += one.topic == "/emv/lidar/points"
        assert count == 20
        server.set(fault=("refuse spawn", 0))
        run = cosim(*(words[:3]), "bag:=broken", "kitti:=false", cwd=tmp_path)
        assert run.code == 1
        assert "sensor_sim" in run.err
        assert "Spawn failed" in run.err
        assert not server.get("settings")[0]
