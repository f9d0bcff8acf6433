"""Populations of drivers, plans of traffic, and the head of a jam."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_streets import A_LEFT, A_RIGHT, B_LEFT, B_RIGHT, C_LEFT, SOUTH, A, B, C, D, streets
from traffic_helpers import responding

from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import InputError
from siren_ros.simulation.scenario.driver_parameters import TrafficDrivers
from siren_ros.simulation.scenario.presets import TruncatedNormal, load_preset
from siren_ros.simulation.traffic.demand.plan import (
    ClassDriving,
    DriverPopulation,
    JamHead,
    LaneChain,
    LaneInterval,
    PlannedVehicle,
    PlannedWalker,
    Spot,
    TrafficPlan,
    chain_along,
    connection_onward,
    load_drivers,
    sideways,
    with_responses,
)
from siren_ros.simulation.traffic.sumo.driving_corrections import LATERAL_ACCEL_MPS2
from siren_ros.simulation.world.actors import VEHICLE_CLASSES, ActorClass

CLASSES = "\n".join(
    f"  {member.name.lower()}: {{accel_mps2: {1.0 + 0.1 * member}, decel_mps2: {2.0 + 0.1 * member}, "
    f"min_gap_m: {3.0 + 0.1 * member}, max_speed_mps: {40.0 + member}}}"
    for member in VEHICLE_CLASSES
)
TEXT = f"""title: made
car_following: Krauss
speed_factor: {{mean: 0.9, std: 0.0, min: 0.5, max: 1.5}}
tau_s: {{mean: 1.1, std: 0.0, min: 0.4, max: 4.0}}
max_lateral_speed_mps: 1.3
speed_gain_eagerness: 0.7
cooperation: 0.6
classes:
{CLASSES}
"""


def load(tmp_path: Path, was: str = "Krauss", becomes: str = "Krauss") -> DriverPopulation:
    path = tmp_path / "drivers.yaml"
    path.write_text(TEXT.replace(was, becomes))
    return load_drivers(str(path))


def test_every_number_has_its_place(tmp_path: Path) -> None:
    drivers = load(tmp_path)
    assert (drivers.car_following, drivers.speed_factor) == ("Krauss", TruncatedNormal(0.9, 0.0, 0.5, 1.5))
    assert drivers.tau_s == TruncatedNormal(1.1, 0.0, 0.4, 4.0)
    assert (drivers.max_lateral_speed_mps, drivers.speed_gain_eagerness, drivers.cooperation) == (1.3, 0.7, 0.6)
    assert set(drivers.classes) == set(VEHICLE_CLASSES)
    for member in VEHICLE_CLASSES:
        expected = (1.0 + 0.1 * member, 2.0 + 0.1 * member, 3.0 + 0.1 * member, 40.0 + member)
        assert drivers.classes[member] == ClassDriving(*(pytest.approx(value) for value in expected))
    driver = drivers.draw(ActorClass.BUS, np.random.default_rng(0), 1.2)
    assert (driver.speed_factor, driver.tau_s) == (pytest.approx(0.9 * 1.2), 1.1)
    assert driver.driving == drivers.classes[ActorClass.BUS]
    assert (driver.max_lateral_speed_mps, driver.speed_gain_eagerness, driver.cooperation) == (1.3, 0.7, 0.6)
    assert driver.car_following == "Krauss"


def test_a_class_without_a_row_drives_as_its_body(tmp_path: Path) -> None:
    row = next(line for line in CLASSES.splitlines() if line.startswith("  suv:"))
    drivers = load(tmp_path, f"{row}\n", "")
    assert drivers.classes[ActorClass.SUV] == drivers.classes[ActorClass.SEDAN]
    plain = next(line for line in CLASSES.splitlines() if line.startswith("  bus:"))
    with pytest.raises(InputError, match="bus"):
        load(tmp_path, f"{plain}\n", "")


def test_speed_and_headway_are_drawn_one_after_the_other(tmp_path: Path) -> None:
    wide = replace(load(tmp_path), speed_factor=TruncatedNormal(1.0, 0.1, 0.0, 2.0))
    wide = replace(wide, tau_s=TruncatedNormal(1.0, 0.2, 0.0, 2.0))
    driver, rng = wide.draw(ActorClass.SEDAN, np.random.default_rng(5)), np.random.default_rng(5)
    assert (driver.speed_factor, driver.tau_s) == pytest.approx((rng.normal(1.0, 0.1), rng.normal(1.0, 0.2)))


def test_civilians_differ_in_the_distance_at_which_they_stand_and_emergency_drivers_do_not(tmp_path: Path) -> None:
    drivers = load(tmp_path, "classes:", "gap_share: {mean: 1.0, std: 0.4, min: 0.5, max: 2.0}\nclasses:")
    assert drivers.gap_share == TruncatedNormal(1.0, 0.4, 0.5, 2.0)

    def shares(kind: ActorClass) -> list[float]:
        rng, usual_m = np.random.default_rng(1), drivers.classes[kind].min_gap_m
        return [drivers.draw(kind, rng).driving.min_gap_m / usual_m for _ in range(500)]

    drawn = shares(ActorClass.SEDAN)
    assert min(drawn) >= 0.5
    assert max(drawn) <= 2.0
    assert 0.3 < np.std(drawn) < 0.45
    assert shares(ActorClass.AMBULANCE) == [1.0] * 500
    assert drivers.draw(ActorClass.SEDAN, np.random.default_rng(1)).driving.decel_mps2 == pytest.approx(
        drivers.classes[ActorClass.SEDAN].decel_mps2
    )


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        ("Krauss", "Wiedemann"),
        ("mean: 0.9, std: 0.0, min: 0.5", "mean: 0.9, std: 0.0, min: 0.05"),
        ("min: 0.5, max: 1.5", "min: 0.5, max: 2.1"),
        ("min: 0.4, max: 4.0", "min: 0.2, max: 4.0"),
        ("min: 0.4, max: 4.0", "min: 0.4, max: 5.5"),
        ("  bus:", "  tram:"),
        ("cooperation: 0.6", "cooperation: 1.1"),
        ("cooperation: 0.6", "cooperation: 0.6\nunknown: 1"),
        ("min_gap_m: 3.0", "min_gap_m: 3.0, unknown: 1"),
    ],
)
def test_mistakes_are_refused(tmp_path: Path, was: str, becomes: str) -> None:
    assert was in TEXT
    with pytest.raises(InputError):
        load(tmp_path, was, becomes)


def plan(background: int, groups: int = 0) -> TrafficPlan:
    driver = load_drivers().draw(ActorClass.SEDAN, np.random.default_rng(0))
    car = PlannedVehicle("car", ActorClass.SEDAN, 4.6, 1.8, 1.5, (9, 9, 9), driver, ("e",), Spot(0, 10.0, 5.0))
    emv = replace(car, name="emv", is_emv=True)
    return TrafficPlan((emv,), (car,) * groups, (car,) * background, (car,) * 10, (), 20, 0, 40.0)


def attentive(vehicles: tuple[PlannedVehicle, ...]) -> list[bool]:
    return [vehicle.attentive for vehicle in vehicles]


def test_the_share_is_met_and_the_emv_is_not_drawn() -> None:
    usual = with_responses(plan(30), responding(), 0)
    assert replace(usual, attention=plan(30).attention) == plan(30), "by default everybody is attentive"
    drawn = with_responses(plan(2000, 5), responding(0.3, 0.7), 0)
    assert 0.26 < sum(attentive(drawn.background)) / 2000 < 0.34
    assert 0.66 < sum(vehicle.oncoming_share == 0.6 for vehicle in drawn.background) / 2000 < 0.74
    assert {vehicle.oncoming_share for vehicle in drawn.background} == {0.6, 1.0}
    assert drawn.emvs == plan(2000, 5).emvs
    assert attentive(with_responses(plan(50, 5), responding(0.0), 0).groups) == [False] * 5


def test_drivers_in_a_jam_form_the_rescue_lane_at_once_late_or_not() -> None:
    """All drivers of a jam do the same; those who are late do so at distances of their own."""
    preset, jam = load_preset("realistic"), replace(plan(2, 3), duty=True)
    reach_m = np.array(
        [
            [car.rescue_m for car in (*of.groups, *of.background)]
            for of in (with_responses(jam, preset, k) for k in range(600))
        ]
    )
    unasked, forgotten = np.isinf(reach_m).all(axis=1), (reach_m == 0.0).all(axis=1)
    assert 0.34 < unasked.mean() < 0.46
    assert 0.10 < forgotten.mean() < 0.20
    late_m = reach_m[~unasked & ~forgotten]
    assert late_m.std(axis=1).min() > 0.0
    assert 30.0 <= late_m.min() < 60.0
    assert 95.0 < late_m.mean() < 105.0
    assert 150.0 < late_m.max() <= 200.0
    usual = [with_responses(plan(9), preset, 3), with_responses(replace(plan(9), duty=True), responding(), 3)]
    assert all(np.isinf(car.rescue_m) for one in usual for car in one.background)


def test_lane_changes_take_each_driver_a_time_of_its_own_and_no_other_draw_changes() -> None:
    usual = replace(load_preset("realistic"), lane_change_log_s=None)
    drawn = with_responses(plan(400, 5), load_preset("realistic"), 4)
    without = with_responses(plan(400, 5), usual, 4)
    assert {car.lane_change_s for car in (*without.background, *without.groups)} == {None}
    assert tuple(replace(car, lane_change_s=None) for car in drawn.background) == without.background
    times_s = [car.lane_change_s for car in drawn.background if car.lane_change_s is not None]
    assert len(set(times_s)) == 400
    assert 2.5 <= min(times_s) < 2.6
    assert 10.0 < max(times_s) <= 13.3
    again = with_responses(plan(9, 2), load_preset("realistic"), 4)
    assert [car.lane_change_s for car in again.groups] == [car.lane_change_s for car in drawn.groups[:2]]
    assert drawn.emvs == without.emvs


FINE_S = 0.001


def across_s(duration_s: float, usual_mps: float) -> float:
    """Time for a lane of 3.25 m, with braking as soon as the rest of the way asks for it."""
    most_mps, accel_mps2 = sideways(duration_s, usual_mps)
    way_m = speed_mps = time_s = 0.0
    while way_m < 3.25 - 1e-4 and time_s < 60.0:
        slower = 3.25 - way_m <= speed_mps**2 / (2.0 * accel_mps2)
        change_mps = accel_mps2 * FINE_S
        speed_mps = max(speed_mps - change_mps, 1e-4) if slower else min(speed_mps + change_mps, most_mps)
        way_m, time_s = way_m + FINE_S * speed_mps, time_s + FINE_S
    return time_s


@pytest.mark.parametrize("usual_mps", [0.8, 1.0, 1.3])
@pytest.mark.parametrize("duration_s", [2.0, 2.5, 3.6, 4.25, 6.0, 13.3])
def test_a_lane_change_takes_the_time_that_was_drawn(duration_s: float, usual_mps: float) -> None:
    assert across_s(duration_s, usual_mps) == pytest.approx(duration_s, rel=0.03)


def test_slower_drivers_accelerate_sideways_as_usual_and_faster_ones_no_harder_than_in_bends() -> None:
    drawn, car = load_preset("realistic").lane_change_log_s, plan(1).background[0]
    assert drawn is not None
    assert 2.0 < sideways(math.exp(drawn.minimum), 1.0)[1] <= LATERAL_ACCEL_MPS2
    assert sideways(9.0, 1.0) == (pytest.approx(0.378, abs=0.002), 1.0)
    assert car.sideways == (car.driver.max_lateral_speed_mps, 1.0)
    assert replace(car, lane_change_s=9.0).sideways == sideways(9.0, car.driver.max_lateral_speed_mps)


def test_each_driver_has_a_draw_of_its_own() -> None:
    few, many = with_responses(plan(10, 3), responding(0.5), 4), with_responses(plan(30, 5), responding(0.5), 4)
    assert attentive(many.background)[:10] == attentive(few.background)
    assert attentive(many.groups)[:3] == attentive(few.groups)
    assert attentive(with_responses(plan(30), responding(0.5), 5).background) != attentive(many.background)


NETWORK = streets()
OVER_K_RIGHT, OVER_K_LEFT, OVER_J_RIGHT, OVER_J_LEFT, INTO_SOUTH = range(9, 14)


def along(lane: int, *edges: int) -> LaneChain:
    return chain_along(NETWORK, NETWORK.lanes[lane], edges)


def test_lanes_and_paths_with_their_starts() -> None:
    chain = along(A_LEFT, A, B, C)
    assert chain.lanes == (A_LEFT, OVER_K_LEFT, B_LEFT, OVER_J_LEFT, C_LEFT)
    assert chain.start_m == pytest.approx((0.0, 200.0, 210.0, 310.0, 330.0))
    assert chain.end_m == pytest.approx(530.0)


def test_where_a_lane_does_not_lead_on_the_nearest_one_does() -> None:
    """Only the right lane leads to the south."""
    chain = along(A_LEFT, A, B, D)
    assert chain.lanes == (A_LEFT, OVER_K_LEFT, B_LEFT, INTO_SOUTH, SOUTH)
    assert connection_onward(NETWORK, NETWORK.lanes[B_LEFT], D) == NETWORK.connections[4]
    assert connection_onward(NETWORK, NETWORK.lanes[B_RIGHT], C) == NETWORK.connections[2]
    assert connection_onward(NETWORK, NETWORK.lanes[A_RIGHT], C) is None
    chain = along(A_LEFT, A, C)
    assert (chain.lanes, chain.end_m) == ((A_LEFT,), pytest.approx(200.0)), "nobody can drive on"
    assert along(A_RIGHT, A).lanes == (A_RIGHT,)


def test_places_are_on_roads_and_not_in_junctions() -> None:
    chain = along(A_LEFT, A, B, C)
    assert chain.place(NETWORK, 0.0) == (A_LEFT, 0.0)
    assert chain.place(NETWORK, 199.0) == (A_LEFT, pytest.approx(199.0))
    assert chain.place(NETWORK, 205.0) is None
    assert chain.place(NETWORK, 210.0) == (B_LEFT, pytest.approx(0.0))
    assert chain.place(NETWORK, 309.0) == (B_LEFT, pytest.approx(99.0))
    assert chain.place(NETWORK, 320.0) is None
    assert chain.place(NETWORK, 529.9) == (C_LEFT, pytest.approx(199.9))
    assert chain.place(NETWORK, 530.0) is None
    assert chain.place(NETWORK, -0.1) is None


def test_stretches_between_two_distances() -> None:
    chain = along(A_LEFT, A, B, C)
    assert chain.intervals(NETWORK, 190.0, 230.0) == (
        LaneInterval(A_LEFT, pytest.approx(190.0), pytest.approx(200.0)),
        LaneInterval(OVER_K_LEFT, 0.0, pytest.approx(10.0)),
        LaneInterval(B_LEFT, 0.0, pytest.approx(20.0)),
    )
    assert chain.intervals(NETWORK, 220.0, 240.0) == (LaneInterval(B_LEFT, pytest.approx(10.0), pytest.approx(30.0)),)
    assert chain.intervals(NETWORK, -30.0, 20.0) == (LaneInterval(A_LEFT, 0.0, pytest.approx(20.0)),)
    assert chain.intervals(NETWORK, 530.0, 600.0) == ()
    assert chain.intervals(NETWORK, 50.0, 50.0) == ()


def test_pedestrians_heed_sirens_at_distances_that_the_preset_draws() -> None:
    walker = PlannedWalker("w", 0.6, 0.6, 1.75, (0, 0, 0), 1.3, "e", 0.0, ())
    walked = replace(plan(0), walkers=(walker,) * 50)
    fixed = with_responses(walked, load_preset("paper"), seed=3).walkers
    assert {walker.notice_m for walker in fixed} == {40.0}
    drawn = [walker.notice_m for walker in with_responses(walked, load_preset("realistic"), seed=3).walkers]
    assert drawn == [walker.notice_m for walker in with_responses(walked, load_preset("realistic"), seed=3).walkers]
    assert len(set(drawn)) == 50
    assert 10.0 <= min(drawn) < 30.0
    assert 50.0 < max(drawn) <= 80.0


def test_a_share_of_the_motorcyclists_filters_and_no_cyclist_does() -> None:
    car = plan(1).background[0]
    kinds = [ActorClass.MOTORCYCLE, ActorClass.BICYCLE] * 500
    ridden = replace(plan(3), riders=tuple(replace(car, actor_class=kind) for kind in kinds))

    def filtering(share: float, seed: int = 0) -> list[bool]:
        drawn = with_responses(ridden, replace(load_preset("paper"), filtering=share), seed).riders
        assert not any(rider.filters for rider in drawn[1::2])
        return [rider.filters for rider in drawn[::2]]

    assert filtering(0.0) == [False] * 500
    assert filtering(1.0) == [True] * 500
    assert 0.34 < sum(filtering(0.4)) / 500 < 0.46
    assert filtering(0.4) == filtering(0.4) != filtering(0.4, 1)


def test_factors_scale_the_driving_of_civilians_and_the_headway_of_all() -> None:
    usual, traffic = load_drivers(), TrafficDrivers(headway_factor=1.5, gap_factor=2.0, accel_factor=0.5)
    scaled = usual.by(traffic)
    assert (scaled.tau_s.mean, scaled.tau_s.maximum) == (1.5 * usual.tau_s.mean, 1.5 * usual.tau_s.maximum)
    for kind, before in usual.classes.items():
        changed = replace(before, accel_mps2=0.5 * before.accel_mps2, min_gap_m=2.0 * before.min_gap_m)
        assert scaled.classes[kind] == (before if kind.is_emergency else changed)
    assert scaled.traffic == traffic
    assert usual.by(TrafficDrivers()) == usual
    lorry = usual.by(TrafficDrivers(accel_factor=1.6)).classes[ActorClass.TRUCK]
    profile = dict(lorry.acceleration_profile)
    assert (min(profile), profile[0.0], profile[12.5]) == (0.0, 1.6 * 1.3, 1.6 * 1.3)
    assert profile[20.0] == pytest.approx(1.3 * 22.222 / 20.0, rel=1e-4), "constant power"
    assert max(profile) >= lorry.max_speed_mps
    assert not scaled.classes[ActorClass.TRUCK].acceleration_profile, "slower than the engine"


def speeds(head: JamHead, *times_s: float) -> list[float]:
    return [head.speed_mps(round(time_s / STEP_S)) for time_s in times_s]


def test_the_head_of_a_jam_stops_and_goes_in_turn_or_stands_for_good():
    head = JamHead(("a", "b"), moves=False, roll_s=6.0, roll_mps=1.5, stand_s=15.0)
    assert speeds(head, 0.0, 5.95, 6.0, 21.0, 500.0) == [1.5, 1.5, 0.0, 0.0, 0.0]
    head = JamHead(("a",), moves=True, roll_s=6.0, roll_mps=1.5, stand_s=15.0)
    assert speeds(head, 0.0, 6.0, 20.95, 21.0, 26.95, 27.0) == pytest.approx([1.5, 0.0, 0.0, 1.5, 1.5, 0.0])
