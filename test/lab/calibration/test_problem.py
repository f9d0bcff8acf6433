"""Parameters of the calibration, and what they are fitted to."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError, InputError
from siren_ros.lab.calibration.fit import residuals_over
from siren_ros.lab.calibration.problem import (
    FAILED_M,
    FORMER_NAMES,
    PARAMETERS,
    WHOLE,
    Situation,
    Target,
    Trajectory,
    check_effect,
    driven,
    horizons_of,
    parameters_named,
    with_drivers,
    with_world,
)
from siren_ros.simulation.behaviour.driving.step_view import BehaviourWorld
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.scenario.driver_parameters import DriverParameter, DriverParameters
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES, EmergencyLevel
from siren_ros.simulation.scenario.presets import load_preset
from siren_ros.simulation.traffic.demand.plan import ClassDriving, DriverModel, PlannedVehicle, TrafficPlan
from siren_ros.simulation.world.actors import ActorClass

DRIVER = DriverModel("IDM", 1.1, 1.2, 1.0, 0.6, 1.0, ClassDriving(2.2, 3.5, 2.0, 42.0))
CHANGED = {
    "emv.speed_mps": {"emv_route_follow_mps", "emv_lane_change_mps"},
    "emv_driver.corridor.speed_mps": {"emv_driver.corridor.speed_mps", "emv_copy_sumo_mps"},
    "emv_driver.gap_escape.speed_mps": {"emv_driver.gap_escape.speed_mps", "emv_gap_escape_mps"},
    "sumo.speed_factor": {"speed_factor"},
    "sumo.tau_s": {"tau_s"},
    "sumo.accel_mps2": {"driving.accel_mps2"},
    "sumo.decel_mps2": {"driving.decel_mps2"},
    "sumo.min_gap_m": {"driving.min_gap_m"},
}
"""What a parameter changes; the others change the field of their own name."""


def world() -> BehaviourWorld:
    network = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")
    return BehaviourWorld(network, LEVEL_POLICIES[EmergencyLevel.L1], {}, load_preset("paper"), 0)


def changes(old: Any, new: Any) -> dict[str, tuple[Any, Any]]:
    """Dotted names of the fields that differ, with both values."""
    pairs: dict[str, tuple[Any, Any]] = {}
    for field in fields(old):
        before, after = getattr(old, field.name), getattr(new, field.name)
        if is_dataclass(before):
            pairs |= {f"{field.name}.{name}": pair for name, pair in changes(before, after).items()}
        elif before != after:
            pairs[field.name] = before, after
    return pairs


def plan_of(driver: DriverModel) -> TrafficPlan:
    """An EMV and a civilian with one driver."""
    nowhere: Any = None
    vehicle = PlannedVehicle("emv", ActorClass.AMBULANCE, 6.0, 2.2, 2.6, (1, 1, 1), driver, (), nowhere, is_emv=True)
    return TrafficPlan((vehicle,), (replace(vehicle, name="c", is_emv=False),), (), (), (), 1, 0, 40.0)


@pytest.mark.parametrize("parameter", PARAMETERS.values(), ids=lambda parameter: parameter.name)
def test_a_parameter_changes_its_fields_and_no_others(parameter: DriverParameter) -> None:
    share = 0.07 if "gap_m" in parameter.name or "clearance_m" in parameter.name else 0.77  # margins fall
    value = parameter.at(share)
    assert parameter.share_of(value) == pytest.approx(share)
    if parameter.name.startswith("sumo."):
        plan = with_drivers(plan_of(DRIVER), {parameter.name: value, "emv_driver.approach.headway_s": 1.0})
        changed = changes(DRIVER, plan.emvs[0].driver)
        assert plan.groups == plan_of(DRIVER).groups
        assert with_world(world(), {parameter.name: value}).config == DriverParameters()
    else:
        before, after = world(), with_world(world(), {parameter.name: value})
        changed = changes(before.config, after.config) | changes(before.speeds, after.speeds)
        present = [old for old, _ in changed.values() if old is not None]
        assert all(parameter.minimum <= old <= parameter.maximum for old in present), (
            "the present value is in the range"
        )
    assert set(changed) == CHANGED.get(parameter.name, {parameter.name})
    assert {new for _, new in changed.values()} == {value}


def test_former_names_still_work() -> None:
    assert [parameter.name for parameter in parameters_named(list(FORMER_NAMES))] == list(FORMER_NAMES.values())
    for names in ([], ["sumo.tau_s", "sumo.tau_s"], ["sumo.mood"], ["controller.target_speed_mps", "emv.speed_mps"]):
        with pytest.raises(InputError, match="parameters"):
            parameters_named(names)


@pytest.mark.parametrize(
    ("name", "levels", "works"),
    [
        ("sumo.tau_s", ["L1", "L3"], False),
        ("emv_driver.approach.headway_s", ["L0"], False),
        ("emv_driver.approach.headway_s", ["L0", "L1"], True),
        ("sumo.tau_s", ["L0", "L1"], True),
    ],
)
def test_a_parameter_without_effect_at_any_level_is_refused(name: str, levels: list[str], works: bool) -> None:
    with nullcontext() if works else pytest.raises(InputError, match=name):
        check_effect(parameters_named([name]), levels)


def line(speed_mps: float, end_s: float = 4.0, step_s: float = 0.5, begin_s: float = 0.0) -> Trajectory:
    time_s = np.arange(begin_s, end_s + 0.5 * step_s, step_s)
    return Trajectory(time_s, np.stack((speed_mps * time_s, 0.0 * time_s), axis=1))


@pytest.mark.parametrize(
    ("ends_s", "other", "squares"),
    [
        (2.0, line(13.0, step_s=0.05), [0.0, 9.0, 36.0]),
        (3.0, line(10.0, end_s=2.0), [0.0, 0.0, 0.0, 100.0]),  # it left earlier: its last place counts
        (2.0, line(11.0, begin_s=1.0), [1.0, 4.0]),  # times before the episode do not count
    ],
)
def test_the_distance_is_the_root_mean_square_at_the_given_times(ends_s, other, squares) -> None:
    assert line(10.0, end_s=ends_s, step_s=1.0).distance_m(other) == pytest.approx(np.sqrt(np.mean(squares)))


def test_the_residuals_are_differences_of_places_and_their_norm_is_the_distance() -> None:
    given, other = line(10.0, end_s=2.0, step_s=1.0, begin_s=0.0), line(13.0, begin_s=1.0)
    apart = given.residuals_m(other)
    assert apart == pytest.approx(np.array([0.0, 3.0, 6.0, 0.0, 0.0, 0.0]) / np.sqrt(2))
    assert np.linalg.norm(apart) == given.distance_m(other)
    with pytest.raises(InputError, match="times of the episode"):
        given.distance_m(line(10.0, begin_s=5.0, end_s=9.0))


@pytest.mark.parametrize(("length_s", "places"), [(1.0, 3), (1.2, 3), (0.1, 2), (9.0, 5), (float("inf"), 5)])
def test_the_first_seconds_count_from_its_first_place_and_two_places_remain(length_s: float, places: int) -> None:
    given = line(10.0, begin_s=2.0)
    cut = given.until(length_s)
    assert cut.time_s.tolist() == given.time_s[:places].tolist()
    assert cut.xy_m.tolist() == given.xy_m[:places].tolist()
    assert given.length_s == pytest.approx(2.0)


def test_a_record_gives_its_emv(record_of: Callable[..., EpisodeRecord]) -> None:
    way = Trajectory.of_record(record_of(duration_s=2.0))
    assert len(way.time_s) == 40
    assert way.end_s == pytest.approx(1.95)
    assert (np.diff(way.xy_m[:, 0]) > 0.0).all()


@pytest.mark.parametrize("rows", [["0,1,1"], ["0,1,1", "0,1,1"], ["0,a,1", "1,1,1"], ["0,nan,1", "1,1,1"]])
def test_files_that_are_no_trajectory_are_refused(tmp_path: Path, rows: list[str]) -> None:
    file = tmp_path / "way.csv"
    file.write_text("y_m,time_s,x_m,speed\n1,0,5,9\n2,0.5,6,9\n", encoding="utf-8")
    way = Trajectory.read(file)
    assert (way.time_s.tolist(), way.xy_m.tolist()) == ([0.0, 0.5], [[5.0, 1.0], [6.0, 2.0]])
    for content in ("\n".join(["time_s,x_m,y_m", *rows, ""]), "", "time_s,x_m\n0,1\n1,2\n"):
        file.write_text(content, encoding="utf-8")
        with pytest.raises(InputError, match="trajectory"):
            Trajectory.read(file)
    with pytest.raises(InputError, match="CSV file"):
        Trajectory.read(tmp_path / "nothing.csv")


SITUATION = Situation(EpisodeRequest("S6", "L1", 0, sensors="none"))
SPEED = "emv.speed_mps"
UNTIL_S = 2.0


def test_tries_are_the_nearer_the_more_alike_their_parameters_are() -> None:
    """The benchmark of the recovery searches to the end, with several parameters."""
    target = Target("made", SITUATION, driven(SITUATION, {SPEED: 10.5}, UNTIL_S))
    with residuals_over([target], 1) as residuals:
        at_the_truth, near, far = residuals([{SPEED: speed_mps} for speed_mps in (10.5, 12.0, 14.0)], WHOLE)
    assert not at_the_truth.any(), "the same parameters give the same trajectory"
    assert 0.0 < np.linalg.norm(near) < np.linalg.norm(far)


def test_a_situation_that_cannot_be_set_up_is_far_away() -> None:
    target = Target("made", SITUATION, driven(SITUATION, {}, 0.2))
    nowhere = Target("no such", Situation(EpisodeRequest("S99", "L1", 0)), target.trajectory)
    with residuals_over([target, nowhere], 1) as residuals:
        (apart,) = residuals([{}], WHOLE)
    assert np.linalg.norm(apart) == pytest.approx(np.sqrt(0.5) * FAILED_M)


def test_records_that_do_not_say_what_they_were_made_from_are_refused(record_of: Callable[..., EpisodeRecord]) -> None:
    record = record_of(duration_s=1.0)
    with pytest.raises(BagError, match="request"):
        Situation.of_record(record)
    parameters = {**record.description.parameters, "request": EpisodeRequest("S2", av="civilian").to_json()}
    object.__setattr__(record.description, "parameters", parameters)
    with pytest.raises(InputError, match="AV under test"):
        Situation.of_record(record)


def targets_of(*lengths_s: float) -> list[Target]:
    """Each begins at 3 s: what counts is how long they are, not when they end."""
    return [
        Target("made", Situation(EpisodeRequest()), Trajectory(np.array([3.0, 3.0 + length]), np.zeros((2, 2))))
        for length in lengths_s
    ]


@pytest.mark.parametrize(
    ("length_s", "horizons"), [(4.0, (WHOLE,)), (7.1, (WHOLE,)), (7.3, (6.0, WHOLE)), (18.0, (6.0, 9.0, 13.5, WHOLE))]
)
def test_a_horizon_grows_by_half_until_little_is_left_out(length_s: float, horizons: tuple[float, ...]) -> None:
    assert horizons_of(targets_of(length_s)) == horizons
    assert horizons_of(targets_of(2.0, length_s, 3.0)) == horizons, "the longest counts"
