"""A bag played in a stand-in server by CARLA's own client: the server shows the bag, and what is written is like it."""

import math
from itertools import zip_longest

import numpy as np
import pytest
from carla_server import play_words

from siren_ros.cli.main import main
from siren_ros.data.interfaces.carla import carla_lights, signal_colour
from siren_ros.data.interfaces.measurements import from_point_cloud
from siren_ros.data.recording.bag_reader import open_bag, read_episode
from siren_ros.running.carla.check import examine
from siren_ros.running.carla.play import play
from siren_ros.simulation.world.actors import ActorClass

pytest.importorskip("carla", reason="CARLA's client has no wheel for this machine")

OURS = {"/siren/sensing", "/siren/markers", "/emv/ground_truth", "/emv/ground_truth/boxes"}


def shown_id(thing, record):
    role = thing.attributes()["role_name"]
    return record.emv_ids[0] if role == "hero" else int(role.removeprefix("siren_"))


def test_the_server_shows_the_bag_and_the_new_bag_is_like_it(bag, server, tmp_path, capsys):
    before = server.get("settings")
    assert main(play_words(bag, server.port(), tmp_path / "out")) == 0
    assert "complete after 20 steps" in capsys.readouterr().out
    record, last = read_episode(bag), server.get("history")[-20:]
    movements = {(each.signal_id, each.signal_link) for each in record.network.connections if each.signal_id}
    assert movements
    for states, traffic, things in zip(record.states, record.traffic, last, strict=True):
        shown = {shown_id(one, record): one for one in things.values() if "role_name" in one.attributes()}
        assert sorted(shown) == states.actor_id.tolist()
        for row, actor_id in enumerate(states.actor_id.tolist()):
            thing, yaw_rad = shown[actor_id], float(states.yaw_rad[row])
            ahead = (
                0.1 if record.actors[actor_id].actor_class not in {ActorClass.MOTORCYCLE, ActorClass.BICYCLE} else 0.0
            )
            x, y = states.x_m[row] - ahead * math.cos(yaw_rad), states.y_m[row] - ahead * math.sin(yaw_rad)
            assert thing.pose[:3] == pytest.approx([x, -y, -0.02 * bool(ahead)], abs=0.001)
            assert math.remainder(thing.pose[4] + math.degrees(yaw_rad), 360.0) == pytest.approx(0.0, abs=0.01)
            assert (thing.lights, thing.physics) == (carla_lights(int(states.lights[row])), False)
        letters = {signal.signal_id: signal.state for signal in traffic.signals}
        for sign in (one for one in things.values() if one.sign):
            signal, _, link = sign.sign.rpartition("_")
            if (signal, int(link)) in movements:  # the others are of crosswalks
                assert sign.state == signal_colour(letters[signal][int(link)])
    assert (server.get("settings"), server.get("frozen")) == (before, False)
    assert {one.kind for one in server.get("actors").values()} == {"traffic.traffic_light"}
    changed = {}
    with open_bag(bag) as old, open_bag(tmp_path / "out") as new:
        for ours, theirs in zip_longest(old.messages(), new.messages()):
            assert (ours.topic, ours.type_name, ours.time_ns) == (theirs.topic, theirs.type_name, theirs.time_ns)
            if ours.cdr != theirs.cdr:
                changed.setdefault(ours.topic, []).append(theirs)
        sensed = {topic for topic in old.type_names if "lidar" in topic or "image" in topic}
        assert changed.keys() - OURS == sensed
        assert set(changed) >= {"/siren/sensing", *sensed}
        points = from_point_cloud(changed["/emv/lidar/points"][0].read())
        sent = np.array([[5.0, -1.0 - k, -1.0] for k in range(8)])
        order = np.argsort(-points["ring"].astype(int))
        np.testing.assert_allclose(np.stack([points[name] for name in "xyz"], axis=1)[order], sent)
        depth = changed["/emv/camera_front/depth/image_raw"][0].read()
        assert (depth.height, depth.width, depth.encoding) == (48, 64, "32FC1")
        assert "CARLA 0.9.16" in changed["/siren/sensing"][0].read().data
    assert main(["info", str(tmp_path / "out")]) == 0
    assert ", sensed by CARLA 0.9.16, preset" in capsys.readouterr().out
    assert main(["info", str(bag)]) == 0
    assert "sensed by" not in capsys.readouterr().out


def test_a_check_finds_what_a_server_has_and_what_it_does_not(server, bag):
    address = f"127.0.0.1:{server.port()}"
    record = read_episode(bag)
    found = examine(address, record=record)
    assert found["verdict"] == []
    lit = sum(each.signal_id is not None for each in record.network.connections)
    assert found["signals"].startswith(f"{lit} of ")
    assert max(pose["away_m"] for pose in found["poses"]) < 0.001
    assert found["messages"]["/emv/lidar/points"] == 3
    server.set(blueprints={"vehicle.audi.a2": (3.7, 1.8, 1.5), "walker.pedestrian.0001": (0.4, 0.4, 1.8)})
    assert (
        "no blueprint of its own for ambulance: vehicle.audi.a2 stands for it"
        in examine(address, record=record)["verdict"]
    )


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        *[("never tick", "time-out"), ("drop a frame", "no frame"), ("die spawning", "time-out")],
        ("refuse spawn", "Spawn failed"),
    ],
)
def test_a_fault_of_the_server_ends_the_episode_with_a_partial_bag(fault, said, server, bag, tmp_path):
    server.set(fault=(fault, 5))
    recorded = play(bag, tmp_path / "out", f"127.0.0.1:{server.port()}", timeout_s=1.0)
    assert recorded.outcome.end == "failed"
    assert said in recorded.outcome.reason
    assert "\n" not in recorded.outcome.reason
    assert not (tmp_path / "out").exists()
    if fault in {"drop a frame", "refuse spawn"}:
        assert not server.get("settings")[0]
        assert {one.kind for one in server.get("actors").values()} == {"traffic.traffic_light"}
