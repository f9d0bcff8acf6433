from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from busy_record import busy_record
from known_outputs import assert_known
from made_records import Track, moving
from scenes import batch_of, lit, showing, with_signal

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, samples_of
from siren_ros.scoring.evaluation.prediction.siren_model.columns import (
    NEIGHBOURS,
    POSITION_SCALE_M,
    SPEED_SCALE_MPS,
    choose_neighbours,
    lane_columns,
    neighbour_columns,
    stop_line_columns,
    target_columns,
)
from siren_ros.scoring.evaluation.prediction.siren_model.paths import choose_paths
from siren_ros.scoring.evaluation.prediction.siren_model.siren_predictor import features_and_names
from siren_ros.simulation.roads.road_network import LaneKind, RoadNetwork
from siren_ros.simulation.world.actors import Lights


def sample_of(batch, actor_id):
    return int(np.flatnonzero(batch.actor_id == actor_id)[0])


def test_emergency_vehicles_come_first_then_the_nearest(straight_road) -> None:
    places = [(100.0, -5.0), (110.0, -5.0), (105.0, -1.75), (60.0, -5.0), (300.0, -5.0)]
    tracks = {actor: moving(*place, 0.0, is_emv=actor == 4) for actor, place in enumerate(places, start=1)}
    batch = batch_of(tracks, straight_road)
    choice = choose_neighbours(batch)
    sample = sample_of(batch, 1)
    there = choice.there[sample]
    assert batch.actors.actor_id[choice.actor[sample, there]].tolist() == [4, 3, 2]
    seen = neighbour_columns(batch, choice)
    assert seen["is_emv"][sample, :4].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert seen["x"][sample, 0] * POSITION_SCALE_M == pytest.approx(-40.0)
    assert all((values[sample, ~there] == 0.0).all() for values in seen.values())
    many = {1 + number: moving(5.0 * number, -5.0, 0.0, steps=161) for number in range(NEIGHBOURS + 4)}
    batch = batch_of(many, straight_road)
    kept = batch.actors.actor_id[choose_neighbours(batch).actor[sample_of(batch, 1)]]
    assert kept.tolist() == list(range(2, NEIGHBOURS + 2)), "the nearest"


def test_siren_indicators_and_sizes_are_seen(straight_road) -> None:
    tracks = {1: moving(100.0, -5.0, 0.0, length_m=5.5), 2: moving(60.0, -5.0, 8.0, is_emv=True)}
    batch = lit(batch_of(tracks, straight_road), 2, Lights.SIREN | Lights.INDICATOR_LEFT)
    seen = neighbour_columns(batch, choose_neighbours(batch))
    sample = sample_of(batch, 1)
    assert [seen[name][sample, 0] for name in ("siren", "beacon", "indicates_left", "brake")] == [1.0, 0.0, 1.0, 0.0]
    target = target_columns(batch)
    assert target["siren"].tolist() == target["is_emv"].tolist() == (batch.actor_id == 2).astype(float).tolist()
    assert target["length"][[sample, sample_of(batch, 2)]] == pytest.approx([0.55, 0.46]), "tens of metres"
    assert target["width"] == pytest.approx(0.9), "1.8 m in pairs of metres"


@pytest.mark.parametrize("rate_radps", [0.3, -0.2])
def test_the_past_in_a_bend(straight_road, rate_radps) -> None:
    """At 6 m/s on a circle: each point of the past is where the circle was, seen from the present."""
    speed, heading = 6.0, 2.0 + rate_radps * STEP_S * np.arange(201)
    radius = speed / rate_radps
    place = 40.0 + radius * np.sin(heading), -30.0 - radius * np.cos(heading)
    states = np.stack((*place, speed * np.cos(heading), speed * np.sin(heading), heading), axis=1)
    target = target_columns(batch_of({1: Track(states)}, straight_road))
    for number in range(1, 16):
        turned = rate_radps * 0.2 * number
        at = -1 - number
        assert target[f"x{at}"][0] * POSITION_SCALE_M == pytest.approx(-radius * np.sin(turned))
        assert target[f"y{at}"][0] * POSITION_SCALE_M == pytest.approx(radius * (1.0 - np.cos(turned)))
        assert target[f"vx{at}"][0] * SPEED_SCALE_MPS == pytest.approx(speed * np.cos(turned))
        assert target[f"vy{at}"][0] * SPEED_SCALE_MPS == pytest.approx(-speed * np.sin(turned))
        if number % 2:
            assert target[f"turned{at}"][0] == pytest.approx(-turned)
    assert f"turned{-1}" not in target, "it is always 0"
    for points in (1, 3, 7):
        turned, time = rate_radps * 0.2 * points, 0.2 * points
        assert target[f"x_gained_in{points}"][0] * SPEED_SCALE_MPS == pytest.approx(
            speed * (1.0 - np.cos(turned)) / time
        )
        assert target[f"y_gained_in{points}"][0] * SPEED_SCALE_MPS == pytest.approx(speed * np.sin(turned) / time)


def test_a_neighbours_past_as_the_sample_sees_it(straight_road) -> None:
    """The sample drives at 4 m/s in the direction 2.0; the other one, seen for 1.5 s, gets faster in another one."""
    accel, first_mps, heading = 0.8, 5.0, 0.7
    tracks = {
        1: moving(40.0, -30.0, 4.0, yaw_rad=2.0),
        2: moving(55.0, -20.0, first_mps, accel, yaw_rad=heading, first_step=30),
    }
    batch = batch_of(tracks, straight_road)
    seen = neighbour_columns(batch, choose_neighbours(batch))
    sample = sample_of(batch, 1)
    columns = {name: float(values[sample, 0]) for name, values in seen.items()}

    def other(after_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Place and velocity of the other one, some time after it came, in the sample's axes at 3 s."""
        along = first_mps * after_s + 0.5 * accel * after_s**2
        place = np.array([55.0, -20.0]) + along * np.array([np.cos(heading), np.sin(heading)])
        origin = np.array([40.0, -30.0]) + 12.0 * np.array([np.cos(2.0), np.sin(2.0)])
        turn = np.array([[np.cos(2.0), np.sin(2.0)], [-np.sin(2.0), np.cos(2.0)]])
        direction = np.array([np.cos(heading - 2.0), np.sin(heading - 2.0)])
        return turn @ (place - origin), (first_mps + accel * after_s) * direction

    (place, velocity), (before, slower) = other(1.5), other(0.5)
    assert [columns["x"], columns["y"]] == pytest.approx(place / POSITION_SCALE_M)
    assert columns["distance"] == pytest.approx(np.hypot(*place) / POSITION_SCALE_M)
    assert [columns["cos"], columns["sin"]] == pytest.approx([np.cos(heading - 2.0), np.sin(heading - 2.0)])
    assert [columns["vx"], columns["vy"]] == pytest.approx(velocity / SPEED_SCALE_MPS)
    assert columns["closing_x"] == pytest.approx((velocity[0] - 4.0) / SPEED_SCALE_MPS)
    assert [columns["moved_x-6"], columns["moved_y-6"]] == pytest.approx((before - place) / POSITION_SCALE_M)
    assert columns["gained_x-6"] == pytest.approx((velocity[0] - slower[0]) / SPEED_SCALE_MPS)
    assert [columns[f"seen{at}"] for at in (-6, -11, -16)] == [1.0, 0.0, 0.0]
    assert all(columns[f"{name}{at}"] == 0.0 for name in ("moved_x", "moved_y", "gained_x") for at in (-11, -16))


@pytest.mark.parametrize(("away_m", "shown"), [(79.9, True), (80.1, False)])
def test_neighbours_are_shown_up_to_eighty_metres(straight_road, away_m, shown) -> None:
    turned = away_m * np.cos(2.5), away_m * np.sin(2.5)
    batch = batch_of({1: moving(100.0, -5.0, 0.0), 2: moving(100.0 + turned[0], -5.0 + turned[1], 0.0)}, straight_road)
    assert bool(choose_neighbours(batch).there[sample_of(batch, 1)].any()) is shown


def test_a_neighbours_heading_is_that_of_the_present(straight_road) -> None:
    """It turns on the spot by 0.2 rad/s from 0.7 on; the sample stands and looks in the direction 2.0."""
    heading = 0.7 + 0.2 * STEP_S * np.arange(201)
    spot = np.stack((np.full(201, 50.0), np.full(201, -20.0), *np.zeros((2, 201)), heading), axis=1)
    batch = batch_of({1: moving(40.0, -30.0, 0.0, yaw_rad=2.0), 2: Track(spot)}, straight_road)
    seen = neighbour_columns(batch, choose_neighbours(batch))
    for frame in (0, 5):
        sample = int(np.flatnonzero(batch.actor_id == 1)[frame])
        turned = 0.7 + 0.2 * (3.0 + 0.1 * frame) - 2.0
        assert [seen[name][sample, 0] for name in ("cos", "sin")] == pytest.approx([np.cos(turned), np.sin(turned)])


def paths_of(tracks, network, of=1):
    batch = batch_of(tracks, network)
    features, names = features_and_names(batch)
    sample = sample_of(batch, of)
    return dict(zip(names.paths, features.paths[sample].T, strict=True))


def test_leaders_are_those_in_the_strip_of_each_path(crossroads) -> None:
    tracks = {1: moving(-34.0, 0.0, 8.0), 2: moving(30.0, 0.0, 0.0), 3: moving(20.0, 40.0, 0.0, yaw_rad=np.pi / 2)}
    columns = paths_of(tracks, crossroads)
    # The sample stands at x = −10 after 3 s; paths: straight on, left, right.
    assert columns["leader_there"].tolist() == [1.0, 1.0, 0.0, 0.0]
    assert columns["leader_gap"][0] * 100.0 == pytest.approx(40.0 - 4.6, abs=0.01)
    along_left = 10.0 + np.hypot(14.0, 6.0) + np.hypot(6.0, 14.0) + 20.0
    assert columns["leader_gap"][1] * 100.0 == pytest.approx(along_left - 4.6, abs=0.5)
    assert columns["leader_gap"][2] == 1.0
    assert (columns["second_there"] == 0.0).all()


def test_vehicles_behind_and_on_other_lanes_are_no_leaders(straight_road) -> None:
    places = [(60.0, -5.25, 5.0), (40.0, -5.25, 5.0), (80.0, -1.75, 5.0), (95.0, -5.25, 7.0), (110.0, -5.25, 2.0)]
    tracks = {key: moving(*place, is_emv=key == 4) for key, place in enumerate(places, start=1)}
    columns = paths_of(tracks, straight_road)
    assert columns["leader_gap"][0] * 100.0 == pytest.approx(35.0 + 3.0 * 2.0 - 4.6, abs=0.01)
    assert columns["leader_speed"][0] * 10.0 == pytest.approx(7.0)
    assert columns["leader_is_emv"][0] == 1.0
    assert columns["second_speed"][0] * 10.0 == pytest.approx(2.0)
    faster = {1: moving(80.0, -5.25, 2.0, accel_mps2=0.5), 2: moving(60.0, -5.25, 0.0)}
    alone = paths_of(faster, straight_road, of=2)
    assert [alone[f"{name}_there"][0] for name in ("leader", "second")] == [1.0, 0.0]
    assert alone["leader_speed"][0] * 10.0 == pytest.approx(2.0 + 0.5 * 3.0), "that of the present"
    assert alone["second_gap"][0] == 1.0


@pytest.mark.parametrize(("aside_m", "there"), [(2.05, 1.0), (-2.05, 1.0), (2.15, 0.0), (-2.15, 0.0)])
def test_the_strip_is_as_wide_as_both_bodies_and_a_margin(straight_road, aside_m, there) -> None:
    """Two halves of 1.8 m and 0.3 m."""
    columns = paths_of({1: moving(60.0, -5.25, 0.0), 2: moving(75.0, -5.25 + aside_m, 0.0)}, straight_road)
    assert columns["leader_there"][0] == there
    assert columns["leader_gap"][0] == pytest.approx(0.154 - 0.05 if there else 1.0)


def test_the_second_leader_is_the_next_one(straight_road) -> None:
    emv = moving(76.0, -5.25, 3.0, length_m=9.0, is_emv=True)
    tracks = {1: moving(60.0, -5.25, 0.0), 2: emv, 3: moving(70.0, -5.25, 0.0), 4: moving(80.0, -9.0, 0.0)}
    columns = paths_of(tracks, straight_road)
    assert columns["leader_gap"][0] * 100.0 == pytest.approx(10.0 - 4.6, abs=0.01)
    assert columns["second_gap"][0] * 100.0 == pytest.approx(16.0 + 3.0 * 3.0 - 0.5 * (4.6 + 9.0), abs=0.01)
    for name, expected in (("there", [1.0, 1.0]), ("is_emv", [0.0, 1.0]), ("speed", [0.0, 0.3])):
        assert [columns[f"{leader}_{name}"][0] for leader in ("leader", "second")] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("ahead_m", "length_m", "gap_m"),
    [(1.0, 4.6, 1.0 - 4.6), (1.0, 12.0, -5.0), (0.3, 4.6, 0.3 - 4.6), (-0.3, 4.6, None)],
)
def test_a_vehicle_alongside_leads_where_its_centre_is_ahead(straight_road, ahead_m, length_m, gap_m) -> None:
    """Gaps of overlapping bodies end at five metres."""
    tracks = {key: moving(x_m, -5.25, 0.0, length_m=length_m) for key, x_m in ((1, 60.0), (2, 60.0 + ahead_m))}
    columns = paths_of(tracks, straight_road)
    assert columns["leader_there"][0] == float(gap_m is not None)
    assert columns["leader_gap"][0] * 100.0 == pytest.approx(100.0 if gap_m is None else gap_m)


def lines_of(batch):
    choice = choose_paths(batch.network, batch.xy_m, batch.yaw_rad, batch.speed_mps)
    return choice, stop_line_columns(batch, choice)


def lanes_of(batch):
    return lane_columns(batch.network, lines_of(batch)[0])


def test_the_stop_line_and_what_its_signal_shows_on_each_path(crossroads) -> None:
    batch = showing(batch_of({1: moving(-40.0, 0.0, 8.0)}, with_signal(crossroads, "rGy")), "rGy")
    choice, lines = lines_of(batch)
    assert choice.there[0].tolist() == [True, True, True, False]
    # 24 m further on after 3 s; the bumper is 2.3 m ahead of the centre.
    assert lines["line0_distance"][0, :3] * 100.0 == pytest.approx(40.0 - 24.0 - 2.3)
    # The straight path is link 1, the left one link 0, the right one link 2.
    for path, names in enumerate((("green", "priority"), ("red", "left"), ("yellow",))):
        for name in names:
            assert np.flatnonzero(lines[f"line0_{name}"][0]).tolist() == [path], name
    columns = lane_columns(batch.network, choice)
    assert all(values[0, 3] == 0.0 for values in columns.values()), "a path that is none is in no lane"
    assert columns["limit"][0, 0] > 0.0
    assert (lines["line1_there"] == 0.0).all()
    assert (lines["line1_distance"][0] == 1.0).all()


def test_where_the_edges_of_the_carriageway_are(straight_road) -> None:
    lane = lanes_of(batch_of({1: moving(20.0, -5.0, 8.0)}, straight_road))
    assert lane["offset"][0, 0] * 2.0 == pytest.approx(0.25)
    assert lane["to_right_edge"][0, 0] * 5.0 == pytest.approx(1.75 + 0.25)
    assert lane["to_left_edge"][0, 0] * 5.0 == pytest.approx(1.75 + 3.5 - 0.25)
    assert lane["limit"][0, 0] * 10.0 == pytest.approx(13.89)


def at(x_m: float, y_m: float, network: RoadNetwork, yaw_rad: float = 0.0, speed_mps: float = 0.0):
    """The batch of a vehicle that is somewhere at the present, after 3 s."""
    start = x_m - 3.0 * speed_mps * np.cos(yaw_rad), y_m - 3.0 * speed_mps * np.sin(yaw_rad)
    return batch_of({1: moving(*start, speed_mps, yaw_rad=yaw_rad)}, network)


@pytest.mark.parametrize(("past_m", "there"), [(-0.1, 1.0), (0.9, 1.0), (1.1, 0.0), (2.3, 0.0)])
def test_a_line_counts_until_the_bumper_is_a_metre_past_it(crossroads, past_m, there) -> None:
    _, lines = lines_of(at(past_m - 2.3, 0.0, crossroads))
    assert lines["line0_there"][0].max() == there
    assert lines["line0_distance"][0, 0] * 100.0 == pytest.approx(max(-past_m, 0.0) if there else 100.0)


def two_lines(network: RoadNetwork) -> RoadNetwork:
    """The lane behind the crossroads ends after 30 m at another junction, where the way goes straight on."""
    lanes = list(network.lanes)
    lanes[2] = replace(lanes[2], centre=Polyline.through([(40.0, 0.0), (70.0, 0.0)]))
    lanes.append(replace(lanes[2], index=7, edge=7, centre=Polyline.through([(70.0, 0.0), (170.0, 0.0)])))
    edges = (*network.edges, replace(network.edges[2], index=7, lanes=(7,)))
    onward = replace(network.connections[1], from_lane=2, to_lane=7, via=(), gives_way=True)
    return replace(network, lanes=tuple(lanes), edges=edges, connections=(*network.connections, onward))


def test_the_next_two_lines_of_a_path(crossroads) -> None:
    network = two_lines(crossroads)
    for x_m, ahead_m in ((-10.0, (10.0, 80.0)), (-1.0, (70.0 + 1.0,))):
        _, lines = lines_of(at(x_m, 0.0, network, speed_mps=8.0))
        there = [lines[f"line{number}_there"][0, 0] for number in (0, 1)]
        assert there == [1.0, float(len(ahead_m) == 2)]
        for number, away_m in enumerate(ahead_m):
            assert lines[f"line{number}_distance"][0, 0] * 100.0 == pytest.approx(away_m - 2.3)
            gives_way = lines[f"line{number}_gives_way"][0, 0]
            assert gives_way == float(number == len(ahead_m) - 1)
            assert lines[f"line{number}_must_stop"][0, 0] == 0.0
            assert lines[f"line{number}_straight"][0, 0] == 1.0


def test_how_a_vehicle_stands_in_its_lane_and_what_is_left_of_the_road(crossroads) -> None:
    lane = lanes_of(at(-10.0, 0.4, crossroads, yaw_rad=-0.1))
    assert lane["offset"][0, :3] == pytest.approx(np.full(3, 0.2))
    assert lane["sin_turned"][0, :3] == pytest.approx(np.full(3, np.sin(-0.1)))
    assert lane["turn"][0, :3] == pytest.approx([0.0, np.pi / 2.0, np.pi / 2.0])
    assert lane["half_width"][0, 0] == pytest.approx(0.25 * 3.5)
    assert [lane[name][0, 0] for name in ("lane", "shoulder", "across", "shoulder_right")] == [1.0, 0.0, 0.0, 0.0]
    assert lanes_of(at(100.0, 0.0, crossroads))["ends"][0, 0] * 100.0 == pytest.approx(40.0)
    assert lanes_of(at(30.0, 0.0, crossroads))["across"][0, 0] == 1.0


def test_a_shoulder_is_seen_and_does_not_widen_the_carriageway(crossroads) -> None:
    lanes, edges = list(crossroads.lanes), list(crossroads.edges)
    lanes[0] = replace(lanes[0], position=1)
    verge = Polyline.through([(-100.0, -3.0), (0.0, -3.0)])
    lanes.append(replace(lanes[0], index=7, position=0, kind=LaneKind.SHOULDER, centre=verge, width_m=2.5))
    edges[0] = replace(edges[0], lanes=(7, 0))
    network = replace(crossroads, lanes=tuple(lanes), edges=tuple(edges))
    for y_m, expected in ((0.3, ("lane", 1.0, 1.75 + 0.3, 1.75 - 0.3)), (-3.0, ("shoulder", 0.0, 1.25, 1.25 + 3.5))):
        columns = {name: values[0, 0] for name, values in lanes_of(at(-60.0, y_m, network)).items()}
        kind, shoulder_right, right_m, left_m = expected
        assert columns[kind] == 1.0
        assert columns["shoulder_right"] == shoulder_right
        assert columns["to_right_edge"] * 5.0 == pytest.approx(right_m)
        assert columns["to_left_edge"] * 5.0 == pytest.approx(left_m)


def test_a_link_that_the_signal_did_not_show_is_unknown(crossroads) -> None:
    """The signal of three links was recorded with two: the way to the right is the third."""
    batch = showing(batch_of({1: moving(-40.0, 0.0, 8.0)}, with_signal(crossroads, "rGy")), "rG")
    _, lines = lines_of(batch)
    assert lines["line0_there"][0].tolist() == [1.0, 1.0, 1.0, 0.0]
    assert lines["line0_signal"][0].tolist() == [1.0, 1.0, 0.0, 0.0]
    assert lines["line0_yellow"][0].tolist() == [0.0] * 4
    _, lines = lines_of(replace(batch, signals={}))
    assert (lines["line0_there"][0, 0], lines["line0_signal"][0, 0]) == (1.0, 0.0), "not recorded"


def test_every_column_of_a_busy_episode() -> None:
    """Of each column the mean and two samples: an EMV, and a driver that makes way; of people the second one."""
    batch = samples_of(busy_record(), HistoryWindow(), Population.ALL).batch
    features, names = features_and_names(batch)
    two = [int(np.flatnonzero((batch.actor_id == actor) & (batch.sample_step == 100))[0]) for actor in (1, 2)]
    found: dict[str, object] = {}
    for kind in ("target", "neighbours", "paths"):
        values = getattr(features, kind).astype(float)
        for number, name in enumerate(getattr(names, kind)):
            column = values[..., number]
            found[f"{kind}.{name}"] = [float(column.mean()), *column[two].reshape(2, -1)[:, :3].ravel().tolist()]
    found["points"] = features.path_points_m[two][:, :2, ::8].reshape(2, -1)
    found["spacing_m"], found["there"] = features.path_spacing_m[two], features.path_there[two]
    found["neighbours"] = batch.actors.actor_id[choose_neighbours(batch).actor[two]]
    assert_known(Path(__file__).parent / "known" / "columns.json", found, digits=4, decimals=5)
