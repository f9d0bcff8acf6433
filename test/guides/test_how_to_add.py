"""Each guide of ``docs/how_to_add``, followed to the letter in a copy of the repository."""

import csv
import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from evaluation.made_video_sets import draw_films, small_video_set
from followed_guide import FollowedGuide, follow
from mcap.reader import make_reader
from recorded_episode import sensed_recording, tracked_recording

from siren_ros.data.interfaces.messages import typestore
from siren_ros.scoring.evaluation.risk.video_set import write_set
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.roads.road_network import LaneKind
from siren_ros.simulation.world.actors import ActorClass


@pytest.fixture
def followed(request: pytest.FixtureRequest, tmp_path: Path) -> FollowedGuide:
    """A copy in which the guide of this name was followed."""
    return follow(request.param, tmp_path / "siren")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An episode with LiDAR and front camera."""
    return sensed_recording(tmp_path_factory)


def of(guide: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("followed", [guide], indirect=True)


def output_of(followed: FollowedGuide, bag: Path | None = None) -> str:
    """The output of the guide's commands, all of which end well; ``bags/S2_L2_seed0`` is the given bag."""
    if bag is not None:
        (followed.root / "bags").mkdir()
        (followed.root / "bags" / "S2_L2_seed0").symlink_to(bag)
    done = [followed.run(command) for command in followed.commands]
    assert [(each.args, each.stderr) for each in done if each.returncode] == []
    return "".join(each.stdout for each in done)


@of("dataset_format")
def test_a_dataset_format(followed: FollowedGuide, bag: Path) -> None:
    output_of(followed, bag)
    (written,) = (followed.root / "speeds").rglob("speeds.csv")
    with written.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 5
    assert all(0.0 <= float(row["mean_speed_mps"]) < 40.0 for row in rows)


@of("predictor")
def test_a_predictor(followed: FollowedGuide, tmp_path_factory: pytest.TempPathFactory) -> None:
    assert "standstill" in output_of(followed, tracked_recording(tmp_path_factory))


@of("detector")
def test_a_detector(followed: FollowedGuide, bag: Path) -> None:
    assert "ten_metres_ahead" in output_of(followed, bag)


@of("sensor")
def test_a_sensor(followed: FollowedGuide) -> None:
    output_of(followed)
    (bag,) = (followed.root / "studies" / "ranges").rglob("*.mcap")
    with bag.open("rb") as file:
        measured = [
            typestore().deserialize_cdr(message.data, schema.name)
            for schema, channel, message in make_reader(file).iter_messages()
            if schema is not None and channel.topic == "/emv/rangefinder/range"
        ]
    assert len(measured) == 10
    assert {message.header.frame_id for message in measured} == {"rangefinder"}
    # The ray falls by 30 degrees from 1.5 m onto the road, or onto a vehicle in front of that place.
    assert max(message.range for message in measured) == pytest.approx(3.0, abs=0.01)


@of("vlm_client")
def test_a_client_for_language_models(followed: FollowedGuide) -> None:
    (followed.root / "videos").mkdir()
    write_set(small_video_set(followed.root / "videos"))
    draw_films(followed.root / "videos")
    output_of(followed)
    answers = json.loads((followed.root / "scores" / "answers_fixed.json").read_text(encoding="utf-8"))
    assert set(answers.values()) == {"Normal"}


@of("map_source")
def test_a_map_source(followed: FollowedGuide) -> None:
    network = parse_road_network(Path(output_of(followed).strip()).read_bytes())
    assert sum(lane.kind is LaneKind.DRIVING for lane in network.lanes) == 4


def made_rows(followed: FollowedGuide, study: str) -> list[dict[str, Any]]:
    """The rows of the study that the guide's commands make."""
    output_of(followed)
    return pq.read_table(followed.root / "studies" / study / "manifest.parquet").to_pylist()


@pytest.mark.parametrize(
    ("followed", "study", "made"),
    [
        ("template", "S9", {("S9", "L1", "paper"), ("S9", "L0", "paper")}),
        ("placement", "S9", {("S9", "L2", "paper")}),
        ("preset", "hesitant", {("S2", "L2", "hesitant")}),
    ],
    indirect=["followed"],
)
def test_what_episodes_are_made_of(followed: FollowedGuide, study: str, made: set[tuple[str, str, str]]) -> None:
    rows = made_rows(followed, study)
    assert {row["status"] for row in rows} == {"complete"}
    assert {(row["template"], row["level"], row["preset"]) for row in rows} == made
    assert len(rows) == len(made)


@of("actor_class")
def test_an_actor_class(followed: FollowedGuide) -> None:
    (row,) = made_rows(followed, "S9")
    (bag,) = (followed.root / "studies" / "S9" / row["bag"]).glob("*.mcap")
    with bag.open("rb") as file:
        spawned = [
            actor
            for schema, channel, message in make_reader(file).iter_messages()
            if schema is not None and channel.topic == "/siren/traffic_state"
            for actor in typestore().deserialize_cdr(message.data, schema.name).spawned
        ]
    taxis = [actor for actor in spawned if actor.actor_class == len(ActorClass)]
    assert taxis
    assert [actor.height_m for actor in taxis] == pytest.approx([1.6] * len(taxis))


_COUNTED = """
from siren_ros import EpisodeRequest, make_episode
import libsumo
from siren_ros.simulation.traffic.sumo.behind_buses import BehindBuses
from siren_ros.simulation.world.actors import ActorClass

tell, told = BehindBuses.apply, []

def apply(self, vehicles):
    tell(self, vehicles)
    for name in vehicles:
        leader, _ = libsumo.vehicle.getLeader(name, 50.0) or ("", 0.0)
        own_s = vehicles[name].driver.tau_s
        behind = leader in vehicles and vehicles[leader].actor_class is ActorClass.BUS
        assert abs(libsumo.vehicle.getTau(name) - (2.5 if behind else own_s)) < 1e-5, name
        told.append(behind)

BehindBuses.apply = apply
values = "demand.district_per_lane_km=15"  # enough vehicles that some follow a bus
make_episode(EpisodeRequest(template="S1", seed=0, duration_s=2.0, values=values), "counted")
print(sum(told), "of", len(told))
"""


@of("sumo_rule")
def test_a_rule_for_sumos_drivers(followed: FollowedGuide) -> None:
    output_of(followed)
    (followed.root / "counted.py").write_text(_COUNTED, encoding="utf-8")
    done = followed.run("./env python counted.py")
    assert done.stderr == ""
    behind, every = map(int, done.stdout.split(" of "))
    assert 0 < behind < every


def certificate_of(followed: FollowedGuide, driver: str) -> Any:
    followed.run(*followed.commands)
    return json.loads((followed.root / "exam" / driver / "certificate.json").read_text(encoding="utf-8"))


@of("exam_driver")
def test_an_exam_driver(followed: FollowedGuide) -> None:
    content = certificate_of(followed, "stops")
    (episode,) = content["episodes"]
    assert (content["driver"], episode["no_result"]) == ("stops", "")
    assert any(mark["clause"] == "contact" and mark["grade"] == "pass" for mark in episode["marks"])


@of("rulebook_clause")
def test_a_rulebook_clause(followed: FollowedGuide, bag: Path) -> None:
    (followed.root / "bags").mkdir()
    (followed.root / "bags" / "S2_L2_seed0").symlink_to(bag)
    (episode,) = certificate_of(followed, "calm")["episodes"]
    assert [(mark["clause"], mark["unit"]) for mark in episode["marks"]] == [("calm", "m/s")]
