from collections import defaultdict
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hand_made_record import LEFT_X_M, NORTHBOUND, RIGHT_X_M, SHOULDER_X_M, crossing
from hypothesis import given, settings
from hypothesis import strategies as st
from traffic_helpers import load_map, states_of

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.simulation.roads.road_network import NO_LANE, LaneKind, RoadNetwork
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.traffic.sumo import mirror as mirror_module
from siren_ros.simulation.traffic.sumo.mirror import (
    DEFAULT_LANE_CHANGE_MODE,
    DEFAULT_SPEED_MODE,
    KEEP_LANE_CHANGE_MODE,
    LaneMatcher,
    Mirror,
)
from siren_ros.simulation.world.actors import ActorClass, Mode, Owner

NETWORK = load_map(None)[1]
WAYS = [
    (connection, network_lane)
    for connection in NETWORK.connections
    if (network_lane := NETWORK.lanes[connection.from_lane]).kind is LaneKind.DRIVING and connection.via
]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, len(WAYS) - 1), st.floats(0.05, 0.95), st.floats(-1.0, 1.0))
def test_points_on_a_lane_are_matched_to_it_at_their_place(number: int, share: float, left: float) -> None:
    connection, lane = WAYS[number]
    edges = (lane.edge, NETWORK.lanes[connection.to_lane].edge)
    matcher = LaneMatcher(NETWORK)
    arc = share * lane.length_m
    x, y = lane.centre.offset_points(arc, left)
    match = matcher.match(edges, (float(x), float(y)), float(lane.centre.heading_rad(arc)), lane.index)
    assert (match.lane, match.position_m) == (lane.index, pytest.approx(arc, abs=1.0))
    assert match.lateral_m == pytest.approx(left, abs=0.2)


def test_beside_the_paths_a_junction_is_road_still() -> None:
    connection, lane = next((way, source) for way, source in WAYS if way.direction == "r")
    via = NETWORK.lanes[connection.via[0]]
    heading = float(via.centre.heading_rad(via.length_m / 2.0))
    edges = (lane.edge, NETWORK.lanes[connection.to_lane].edge)

    def matched(left_m: float) -> int:
        x, y = via.centre.offset_points(via.length_m / 2.0, left_m)
        return LaneMatcher(NETWORK).match(edges, (float(x), float(y)), heading, via.index).lane

    reach_m = via.width_m / 2.0 + 5.0
    assert reach_m > 3.5 > via.width_m / 2.0 + 1.2
    assert matched(3.5) in connection.via
    assert matched(reach_m + 0.1) not in connection.via


CROSSING = crossing()
S_IN = next(edge for edge in CROSSING.edges if edge.edge_id == "s_in")
SHOULDER, RIGHT, LEFT = S_IN.lanes
LINE_X_M = (LEFT_X_M + RIGHT_X_M) / 2.0


@pytest.mark.parametrize(
    ("past_the_line_m", "present", "lane"),
    [
        (0.03, RIGHT, RIGHT),
        (0.07, RIGHT, LEFT),
        (0.03, LEFT, LEFT),
        (-0.03, LEFT, LEFT),
        (-0.07, LEFT, RIGHT),
        (-0.03, RIGHT, RIGHT),
        (0.03, NO_LANE, LEFT),
        (-0.03, NO_LANE, RIGHT),
        (0.03, SHOULDER, LEFT),
        (-0.03, SHOULDER, RIGHT),
    ],
)
def test_a_vehicle_stays_in_its_lane_until_the_neighbour_is_nearer_by_a_margin(
    past_the_line_m: float, present: int, lane: int
) -> None:
    """At d past the line between two equal lanes the neighbour is nearer by 2 d; the margin is 0.1 m."""
    match = LaneMatcher(CROSSING).match((S_IN.index,), (LINE_X_M - past_the_line_m, -70.0), np.pi / 2, present)
    assert match.lane == lane
    centre_x_m = {RIGHT: RIGHT_X_M, LEFT: LEFT_X_M}[lane]
    assert match.lateral_m == pytest.approx(centre_x_m - (LINE_X_M - past_the_line_m))
    assert match.position_m == pytest.approx(50.0)


def test_lanes_of_another_edge_need_no_margin() -> None:
    """Just beyond the stop line the path is nearest, and the lane that ended is left at once."""
    n_out = next(edge for edge in CROSSING.edges if edge.edge_id == "n_out")
    match = LaneMatcher(CROSSING).match((S_IN.index, n_out.index), (RIGHT_X_M, -19.95), np.pi / 2, RIGHT)
    assert CROSSING.lanes[match.lane].kind is LaneKind.INTERNAL
    assert match.lateral_m == pytest.approx(0.0)


@pytest.mark.parametrize(("outside_m", "belongs"), [(1.19, True), (1.21, False)])
def test_a_point_belongs_to_a_lane_up_to_1_2_m_outside_its_edge(outside_m: float, belongs: bool) -> None:
    """To the left of the leftmost lane, whose half width is 1.75 m."""
    front = (LEFT_X_M - 1.75 - outside_m, -70.0)
    match = LaneMatcher(CROSSING).match((S_IN.index,), front, np.pi / 2, NO_LANE)
    assert (match.lane == LEFT) is belongs
    assert match.lateral_m == pytest.approx(1.75 + outside_m if belongs else 0.0)


@pytest.mark.parametrize("turned", [1.19, -1.19, 1.21, -1.21])
def test_lanes_count_up_to_1_2_rad_off_the_heading(turned: float) -> None:
    match = LaneMatcher(CROSSING).match((S_IN.index,), (LEFT_X_M, -70.0), np.pi / 2 + turned, NO_LANE)
    assert (match.lane != NO_LANE) is (abs(turned) < 1.2)


OWN_SPEED_FACTOR = 0.87
CLEARED = TrafficDrivers().cleared_pace * OWN_SPEED_FACTOR
NAME, ACTOR = "car", 5
VEHICLE: Any = SimpleNamespace(
    name=NAME, length_m=4.0, route=("s_in", "n_out"), is_emv=False, actor_class=ActorClass.SEDAN
)
STANDING = {"actor_id": ACTOR, "x_m": RIGHT_X_M, "y_m": -100.0, "yaw_rad": 0.5 * np.pi, "owner": Owner.SUMO}


def mirror_on(network: RoadNetwork, length_scale: float = 1.0) -> Mirror:
    population: Any = SimpleNamespace(length_scale=defaultdict(lambda: length_scale), scale_of=lambda _: length_scale)
    return Mirror(network, population, TrafficDrivers())


class FakeVehicles:
    """libsumo's domain of vehicles, as far as a mirror uses it: it stores what it is told."""

    def __init__(self) -> None:
        self.settings = settings_in_mirror()
        self.previous_speed_mps = 0.0
        self.moved_to: list[tuple[Any, ...]] = []
        self.route_id, self.route = mirror_module.route_id(NAME), VEHICLE.route

    def setPreviousSpeed(self, name: str, speed_mps: float) -> None:  # noqa: N802 - libsumo's name
        assert name == NAME
        self.previous_speed_mps = speed_mps

    def moveToXY(self, name: str, *place: Any) -> None:  # noqa: N802 - libsumo's name
        assert name == NAME
        self.moved_to.append(place)

    def getRouteID(self, name: str) -> str:  # noqa: N802 - libsumo's name
        assert name == NAME
        return self.route_id

    def setRouteID(self, name: str, route_id: str) -> None:  # noqa: N802 - libsumo's name
        assert (name, route_id) == (NAME, mirror_module.route_id(NAME))
        self.route_id, self.route = route_id, VEHICLE.route

    def getRoute(self, name: str) -> tuple[str, ...]:  # noqa: N802 - libsumo's name
        assert name == NAME
        return self.route

    def getRoadID(self, name: str) -> str:  # noqa: N802 - libsumo's name
        return self.getRoute(name)[self.getRouteIndex(name)]

    def getRouteIndex(self, name: str) -> int:  # noqa: N802 - libsumo's name
        assert name == NAME
        return 0

    def __getattr__(self, name: str) -> Any:
        kind, setting = name[:3], name[3:]
        if kind == "get":
            return lambda _vehicle: self.settings[setting]
        assert kind == "set"
        return lambda _vehicle, value: self.settings.__setitem__(setting, value)


@pytest.fixture(name="sumo")
def _sumo(monkeypatch: pytest.MonkeyPatch) -> FakeVehicles:
    vehicles = FakeVehicles()
    monkeypatch.setattr(mirror_module, "libsumo", SimpleNamespace(vehicle=vehicles, TraCIException=RuntimeError))
    return vehicles


class Driver:
    """Steps a mirror with one vehicle that drives north at 10 m/s."""

    def __init__(self) -> None:
        self.mirror = mirror_on(CROSSING)
        self.step = 0
        self.vehicles = {ACTOR: VEHICLE}

    def __call__(self, owner: Owner, mode: Mode, residual_m: float = 0.0) -> None:
        x, y = Polyline.through(NORTHBOUND).at(20.0 + 0.5 * self.step)
        row = {"actor_id": ACTOR, "x_m": float(x), "y_m": float(y), "yaw_rad": 1.5707963267948966, "vy_mps": 10.0}
        states = states_of(self.step, [{**row, "owner": owner, "mode": mode, "residual_m": residual_m}])
        self.mirror.apply(states, self.vehicles, {NAME: ACTOR}, {NAME: (S_IN.index,)})
        self.step += 1


def settings_in_mirror(**changed: Any) -> dict[str, Any]:
    modes = {"LaneChangeMode": DEFAULT_LANE_CHANGE_MODE, "SpeedMode": DEFAULT_SPEED_MODE}
    return {"SpeedFactor": OWN_SPEED_FACTOR, **modes, "LateralAlignment": "center", "Speed": -1.0, **changed}


@pytest.mark.parametrize(
    "phases",
    [
        [Mode.YIELD_DEFERRED],
        [Mode.YIELD_KEEP_LANE],
        [Mode.YIELD_DEFERRED, Mode.YIELD_KEEP_LANE],
        [Mode.YIELD_KEEP_LANE, Mode.YIELD_DEFERRED],
        [Mode.YIELD_DEFERRED, Mode.YIELD_DEFERRED, Mode.YIELD_KEEP_LANE, Mode.YIELD_DEFERRED],
    ],
)
def test_a_vehicle_gets_its_own_settings_back_after_a_yield(sumo: FakeVehicles, phases: list[Mode]) -> None:
    drive = Driver()
    for _ in range(2):
        drive(Owner.SUMO, Mode.NOMINAL)
        assert sumo.settings == settings_in_mirror()
        for phase in phases:
            drive(Owner.SUMO, phase)
            assert sumo.settings != settings_in_mirror()
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings == settings_in_mirror()
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings == settings_in_mirror()


@pytest.mark.parametrize(
    ("lane", "is_emv", "keep"), [(RIGHT, False, 0), (RIGHT, True, 0), (SHOULDER, True, 0), (SHOULDER, False, 4)]
)
def test_only_a_civilian_on_a_shoulder_is_put_where_it_may_not_be(
    sumo: FakeVehicles, lane: int, is_emv: bool, keep: int
) -> None:
    """SUMO looks for the lanes that are closed to a vehicle, pedestrian crossings among them, where it is told so."""
    vehicle: Any = SimpleNamespace(**{**vars(VEHICLE), "is_emv": is_emv})
    x, y = CROSSING.lanes[lane].centre.at(20.0)
    row = {"actor_id": ACTOR, "x_m": float(x), "y_m": float(y), "yaw_rad": 0.5 * np.pi, "vy_mps": 10.0}
    states = states_of(0, [{**row, "owner": Owner.ROS, "mode": Mode.ROUTE_FOLLOW, "residual_m": 0.0}])
    mirror_on(CROSSING).apply(states, {ACTOR: vehicle}, {NAME: ACTOR}, {NAME: (S_IN.index,)})
    (place,) = sumo.moved_to
    assert place[:2] == ("s_in", CROSSING.lanes[lane].position)
    assert place[-1] == keep


def test_a_deferred_yield_hurries_and_a_cleared_lane_is_kept_at_less_speed(sumo: FakeVehicles) -> None:
    drive, factor = Driver(), TrafficDrivers().waiting_pace
    assert factor > OWN_SPEED_FACTOR
    drive(Owner.SUMO, Mode.YIELD_DEFERRED)
    assert sumo.settings == settings_in_mirror(SpeedFactor=factor)
    assert drive.mirror.deferred() == {NAME}
    drive(Owner.SUMO, Mode.YIELD_KEEP_LANE)
    assert sumo.settings == settings_in_mirror(SpeedFactor=CLEARED, LaneChangeMode=KEEP_LANE_CHANGE_MODE)
    assert drive.mirror.deferred() == set()
    sumo.settings.update(settings_in_mirror(SpeedFactor=1.9))
    fast = Driver()
    for mode in (Mode.YIELD_DEFERRED, Mode.NOMINAL):
        fast(Owner.SUMO, mode)
        assert sumo.settings["SpeedFactor"] == 1.9, "a fast driver is not slowed down"


def test_a_vehicle_that_ros_drove_is_handed_back_with_its_own_settings(sumo: FakeVehicles) -> None:
    drive = Driver()
    drive(Owner.SUMO, Mode.NOMINAL)
    drive(Owner.ROS, Mode.YIELD_PULL_OVER)
    assert len(sumo.moved_to) == 1
    sumo.settings.update(Speed=3.0, SpeedMode=0, LateralAlignment="right", LaneChangeMode=0)
    drive(Owner.SUMO, Mode.REJOIN)
    assert (sumo.settings, sumo.previous_speed_mps) == (settings_in_mirror(), pytest.approx(10.0))
    assert len(sumo.moved_to) == 1


def test_a_vehicle_that_sumo_found_on_another_road_is_put_back_before_it_is_handed_back(sumo: FakeVehicles) -> None:
    drive = Driver()
    drive(Owner.ROS, Mode.YIELD_PULL_OVER)
    sumo.route_id, sumo.route = "made by SUMO", ("w_in", "e_out")
    sumo.settings["SpeedMode"] = 0
    drive(Owner.SUMO, Mode.REJOIN)
    edge_id, _, x_m, y_m, *_ = sumo.moved_to[1]
    assert edge_id == "s_in"
    assert sumo.moved_to[0][2:4] == pytest.approx((x_m, y_m + 0.5))
    assert sumo.settings["SpeedMode"] == 0
    sumo.route_id, sumo.route = "made by SUMO", ("s_in",)
    drive(Owner.SUMO, Mode.REJOIN)
    assert sumo.settings == settings_in_mirror()
    assert sumo.route == VEHICLE.route
    assert len(sumo.moved_to) == 2


def test_a_binding_outlasts_a_stretch_in_which_ros_drives(sumo: FakeVehicles) -> None:
    drive = Driver()
    drive(Owner.SUMO, Mode.YIELD_DEFERRED)
    for _ in range(3):
        drive(Owner.ROS, Mode.YIELD_LANE_CHANGE)
    drive(Owner.SUMO, Mode.YIELD_KEEP_LANE)
    assert sumo.settings == settings_in_mirror(SpeedFactor=CLEARED, LaneChangeMode=KEEP_LANE_CHANGE_MODE)
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings == settings_in_mirror()


def test_a_vehicle_that_left_takes_its_binding_with_it(sumo: FakeVehicles) -> None:
    drive = Driver()
    drive(Owner.SUMO, Mode.YIELD_DEFERRED)
    drive.mirror.forget(NAME)
    sumo.settings.update(settings_in_mirror(SpeedFactor=1.1))
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings == settings_in_mirror(SpeedFactor=1.1)
    drive(Owner.ROS, Mode.YIELD_PULL_OVER)
    drive.mirror.forget(NAME)
    assert NAME not in drive.mirror.places
    sumo.settings.update(Speed=3.0)
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings == settings_in_mirror(SpeedFactor=1.1, Speed=3.0), "it is not handed back"
    assert sumo.previous_speed_mps == 10.0, "of the step in which ROS drove"


def placed(sumo: FakeVehicles, **state: float) -> tuple[float, float, float]:
    """Where and at which angle a vehicle is put that turns and slides."""
    drive = Driver()
    row = {"actor_id": ACTOR, "x_m": RIGHT_X_M, "y_m": -100.0, "yaw_rad": 1.5, "vx_mps": 0.6, "vy_mps": 8.0}
    states = states_of(0, [{**row, **state, "owner": Owner.ROS}])
    drive.mirror.apply(states, drive.vehicles, {NAME: ACTOR}, {NAME: (S_IN.index,)})
    _, _, x, y, angle_deg, _ = sumo.moved_to[-1]
    return x, y, angle_deg


@pytest.mark.parametrize("rate", [0.4, -0.4])
def test_a_pose_is_extrapolated_by_a_step_in_place_and_heading(sumo: FakeVehicles, rate: float) -> None:
    x, y, angle_deg = placed(sumo, yaw_rate_radps=rate)
    yaw = 1.5 + 0.05 * rate
    assert angle_deg == pytest.approx((90.0 - np.degrees(yaw)) % 360.0)
    assert (x, y) == pytest.approx((RIGHT_X_M + 0.03 + 2.0 * np.cos(yaw), -100.0 + 0.4 + 2.0 * np.sin(yaw)))


JOINED_M = 0.4


def joined() -> RoadNetwork:
    """The crossing, with a path of 0.4 m behind the northbound lane, which ends at −20 m."""
    lanes = list(CROSSING.lanes)
    for connection in CROSSING.connections_from[S_IN.lanes[1]]:
        (via,) = connection.via
        lanes[via] = replace(lanes[via], centre=Polyline.through([(RIGHT_X_M, -20.0), (RIGHT_X_M, -20.0 + JOINED_M)]))
    return replace(CROSSING, lanes=tuple(lanes))


@pytest.mark.parametrize(
    ("front_m", "put_m"), [(-20.2, -20.2), (-20.05, -20.1), (-19.9, -20.1), (-19.7, -19.5)], ids=str
)
def test_no_front_is_put_where_two_pieces_of_a_road_are_joined(
    sumo: FakeVehicles, front_m: float, put_m: float
) -> None:
    mirror, edges = mirror_on(joined()), (S_IN.index, CROSSING.edge_by_id["n_out"].index)
    row = {"actor_id": ACTOR, "x_m": RIGHT_X_M, "y_m": front_m - 2.0, "yaw_rad": 0.5 * np.pi, "owner": Owner.ROS}
    mirror.apply(states_of(0, [row]), {ACTOR: VEHICLE}, {NAME: ACTOR}, {NAME: edges})
    assert sumo.moved_to[-1][2:4] == pytest.approx((RIGHT_X_M, put_m))


def test_a_vehicle_is_found_again_beyond_the_edges_that_sumo_expects_it_on(sumo: FakeVehicles) -> None:
    """On the opposite lane SUMO's place on the route stays behind."""
    mirror, out = mirror_on(CROSSING), CROSSING.edge_by_id["n_out"]
    x, y = CROSSING.lanes[out.lanes[-1]].centre.at(10.0)
    row = {"actor_id": ACTOR, "x_m": float(x), "y_m": float(y), "yaw_rad": 0.5 * np.pi, "owner": Owner.ROS}
    far = tuple(edge.index for edge in CROSSING.edges if edge.edge_id in {"e_in", "w_in", "e_out", "w_out"})[:3]
    mirror.apply(states_of(0, [row]), {ACTOR: VEHICLE}, {NAME: ACTOR}, {NAME: (*far, out.index)})
    assert sumo.moved_to[-1][0] == "n_out"


SHIFTED = replace(CROSSING, sumo_offset_m=(100.0, -40.0))


class Realigned(FakeVehicles):
    """A vehicle of SUMO that is somewhere else than the simulated one."""

    def __init__(self, front: tuple[float, float]) -> None:
        super().__init__()
        self.front = front
        self.speed_mps = 10.0
        self.back: list[tuple[str, float]] = []

    def getSpeed(self, _name: str) -> float:  # noqa: N802 - libsumo's name
        return self.speed_mps

    def getLaneID(self, _name: str) -> str:  # noqa: N802 - libsumo's name
        return "s_in_0"

    def getPosition(self, _name: str) -> tuple[float, float]:  # noqa: N802 - libsumo's name
        return self.front

    def moveTo(self, name: str, lane: str, at_m: float) -> None:  # noqa: N802 - libsumo's name
        assert name == NAME
        self.back.append((lane, at_m))


@pytest.mark.parametrize(
    ("ahead_m", "aside_m", "brought"), [(3.0, 0.0, True), (0.9, 0.0, False), (0.0, 3.0, True), (-1.1, 0.0, False)]
)
def test_sumos_vehicle_is_brought_back_where_that_moves_it_by_a_metre(
    monkeypatch: pytest.MonkeyPatch, ahead_m: float, aside_m: float, brought: bool
) -> None:
    """The simulated front is 22.5 m after the lane's beginning a step later; SUMO's frame is shifted.

    From behind it comes up by itself.
    """
    place = (RIGHT_X_M + aside_m, -120.0 + 22.5 + ahead_m)
    vehicles = Realigned((place[0] + 100.0, place[1] - 40.0))
    monkeypatch.setattr(mirror_module, "libsumo", SimpleNamespace(vehicle=vehicles))
    mirror = mirror_on(SHIFTED, 2.0)
    row = {**STANDING, "vy_mps": 10.0}
    other = {**row, "actor_id": 3, "residual_m": 9.0}
    for residual_m, far in ((1.6, True), (1.4, False)):
        vehicles.back.clear()
        states = states_of(0, [other, {**row, "residual_m": residual_m}])
        mirror.apply(states, {ACTOR: VEHICLE}, {NAME: ACTOR}, {NAME: (S_IN.index,)})
        assert mirror.realigned == ({ACTOR: residual_m} if brought and far else {})
        assert vehicles.back == ([("s_in_1", pytest.approx(45.0))] if brought and far else [])
    assert vehicles.previous_speed_mps == (pytest.approx(20.0) if brought else 0.0)


@pytest.mark.parametrize(("turned_rad", "brought"), [(0.5, True), (-0.5, False)])
def test_who_drives_is_left_alone_behind_the_simulated_front_in_the_direction_of_this(
    monkeypatch: pytest.MonkeyPatch, turned_rad: float, brought: bool
) -> None:
    """To the left of a front that points left, and a little back, is ahead of it: 2 m · sin 0.5 − 0.5 m · cos 0.5."""
    yaw_rad = np.pi / 2 + turned_rad
    front = RIGHT_X_M + 2.0 * np.cos(yaw_rad), -100.0 + 2.0 * np.sin(yaw_rad)
    vehicles = Realigned((front[0] - 2.0, front[1] - 0.5))
    monkeypatch.setattr(mirror_module, "libsumo", SimpleNamespace(vehicle=vehicles))
    states = states_of(0, [{**STANDING, "yaw_rad": yaw_rad, "residual_m": 2.1}])
    mirror_on(CROSSING).apply(states, {ACTOR: VEHICLE}, {NAME: ACTOR}, {NAME: (S_IN.index,)})
    assert len(vehicles.back) == brought


@pytest.mark.parametrize(
    ("residual_m", "simulated_mps", "sumo_mps", "brought"),
    [
        (0.5, 0.0, 0.0, True),
        (0.3, 0.0, 0.0, False),
        (0.5, 0.2, 0.0, False),
        (0.5, 0.0, 0.2, False),
        (1.6, 0.0, 0.2, False),
        (1.6, 0.0, 0.0, True),
    ],
    ids=["both stand", "near enough", "still rolls", "starts", "comes up from afar", "far off"],
)
def test_where_both_stand_sumos_vehicle_is_brought_to_where_the_simulated_one_stopped(
    monkeypatch: pytest.MonkeyPatch, residual_m: float, simulated_mps: float, sumo_mps: float, brought: bool
) -> None:
    vehicles = Realigned((RIGHT_X_M, -98.0 - residual_m))
    vehicles.speed_mps = sumo_mps
    monkeypatch.setattr(mirror_module, "libsumo", SimpleNamespace(vehicle=vehicles))
    mirror = mirror_on(CROSSING)
    states = states_of(0, [{**STANDING, "vy_mps": simulated_mps, "residual_m": residual_m}])
    mirror.apply(states, {ACTOR: VEHICLE}, {NAME: ACTOR}, {NAME: (S_IN.index,)})
    assert mirror.realigned == ({ACTOR: residual_m} if brought else {})
    assert vehicles.back == ([("s_in_1", pytest.approx(22.0))] if brought else [])


def test_nobody_is_brought_back_onto_a_lane_that_is_closed_to_civilians(monkeypatch: pytest.MonkeyPatch) -> None:
    vehicles = Realigned((RIGHT_X_M + 5.0, -97.5))
    monkeypatch.setattr(mirror_module, "libsumo", SimpleNamespace(vehicle=vehicles))
    states = states_of(0, [{**STANDING, "vy_mps": 10.0, "residual_m": 9.0}])
    closed = replace(CROSSING, lanes=tuple(replace(lane, civilian_allowed=False) for lane in CROSSING.lanes))
    for network, realigned in ((CROSSING, {ACTOR: 9.0}), (closed, {})):
        mirror = mirror_on(network)
        mirror.apply(states, {ACTOR: VEHICLE}, {NAME: ACTOR}, {NAME: (S_IN.index,)})
        assert mirror.realigned == realigned
    assert len(vehicles.back) == 1


def test_a_cyclist_is_brought_back_in_the_cycle_lane_which_is_no_lane_of_cars(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulated front is 22 m after the lane's beginning, beside its middle."""
    cycle = replace(CROSSING.lanes[S_IN.lanes[0]], kind=LaneKind.CYCLE, civilian_allowed=False)
    network = replace(CROSSING, lanes=(cycle, *CROSSING.lanes[1:]))
    cyclist = SimpleNamespace(**{**vars(VEHICLE), "actor_class": ActorClass.BICYCLE})
    states = states_of(0, [{**STANDING, "residual_m": 0.5, "x_m": SHOULDER_X_M - 1.6}])
    for vehicle, lane in ((cyclist, "s_in_0"), (VEHICLE, "s_in_1")):
        vehicles = Realigned((SHOULDER_X_M, -97.0))
        vehicles.speed_mps = 0.0
        monkeypatch.setattr(mirror_module, "libsumo", SimpleNamespace(vehicle=vehicles))
        mirror_on(network).apply(states, {ACTOR: vehicle}, {NAME: ACTOR}, {NAME: (S_IN.index,)})
        assert vehicles.back == [(lane, pytest.approx(22.0))]
