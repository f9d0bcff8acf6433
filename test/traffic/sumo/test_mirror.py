"""What a vehicle of SUMO is set to while it is mirrored or bound, and that it gets its own settings back."""

from collections import defaultdict
from types import SimpleNamespace
from typing import Any

import pytest
from hand_made_record import NORTHBOUND, RIGHT_X_M, crossing
from traffic_helpers import states_of

from siren_ros.numerics.polyline import Polyline
from siren_ros.traffic.sumo import mirror as mirror_module
from siren_ros.traffic.sumo.config import TrafficConfig
from siren_ros.traffic.sumo.mirror import (
    DEFAULT_LANE_CHANGE_MODE,
    DEFAULT_SPEED_MODE,
    KEEP_LANE_CHANGE_MODE,
    Mirror,
)
from siren_ros.world.actors import Mode, Owner

NETWORK = crossing()
S_IN = next(edge.index for edge in NETWORK.edges if edge.edge_id == "s_in")
OWN_SPEED_FACTOR = 0.87
NAME, ACTOR = "car", 5


class FakeVehicles:
    """libsumo's domain of vehicles, as far as a mirror uses it: it stores what it is told."""

    def __init__(self) -> None:
        self.settings: dict[str, Any] = {
            "SpeedFactor": OWN_SPEED_FACTOR,
            "LaneChangeMode": DEFAULT_LANE_CHANGE_MODE,
            "SpeedMode": DEFAULT_SPEED_MODE,
            "LateralAlignment": "center",
            "Speed": -1.0,
        }
        self.previous_speed_mps = 0.0
        self.moved_to: list[tuple[Any, ...]] = []

    def setPreviousSpeed(self, name: str, speed_mps: float) -> None:  # noqa: N802 - libsumo's name
        assert name == NAME
        self.previous_speed_mps = speed_mps

    def moveToXY(self, name: str, *place: Any) -> None:  # noqa: N802 - libsumo's name
        assert name == NAME
        self.moved_to.append(place)

    def getRouteID(self, name: str) -> str:  # noqa: N802 - libsumo's name
        return mirror_module.route_id(name)

    def __getattr__(self, name: str) -> Any:
        kind, setting = name[:3], name[3:]
        if kind == "get":
            return lambda _vehicle: self.settings[setting]
        assert kind == "set"
        return lambda _vehicle, value: self.settings.__setitem__(setting, value)


@pytest.fixture(name="sumo")
def _sumo(monkeypatch: pytest.MonkeyPatch) -> FakeVehicles:
    vehicles = FakeVehicles()
    monkeypatch.setattr(mirror_module, "libsumo", SimpleNamespace(vehicle=vehicles))
    return vehicles


class Driver:
    """Steps a mirror with one vehicle that drives north at 10 m/s."""

    def __init__(self) -> None:
        population: Any = SimpleNamespace(length_scale=defaultdict(lambda: 1.0))
        self.mirror = Mirror(NETWORK, TrafficConfig(), population)
        self.step = 0
        vehicle: Any = SimpleNamespace(name=NAME, length_m=4.0, route=("s_in", "n_out"))
        self.vehicles = {ACTOR: vehicle}

    def __call__(self, owner: Owner, mode: Mode, residual_m: float = 0.0) -> None:
        x, y = Polyline.through(NORTHBOUND).at(20.0 + 0.5 * self.step)
        row = {"actor_id": ACTOR, "x_m": float(x), "y_m": float(y), "yaw_rad": 1.5707963267948966, "vy_mps": 10.0}
        states = states_of(self.step, [{**row, "owner": owner, "mode": mode, "residual_m": residual_m}])
        self.mirror.apply(states, self.vehicles, {NAME: (S_IN,)})
        self.step += 1


def settings(**changed: Any) -> dict[str, Any]:
    own = {
        "SpeedFactor": OWN_SPEED_FACTOR,
        "LaneChangeMode": DEFAULT_LANE_CHANGE_MODE,
        "SpeedMode": DEFAULT_SPEED_MODE,
        "LateralAlignment": "center",
        "Speed": -1.0,
    }
    return {**own, **changed}


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
        assert sumo.settings == settings()
        for phase in phases:
            drive(Owner.SUMO, phase)
            assert sumo.settings != settings()
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings == settings()
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings == settings()


def test_a_deferred_yield_hurries_and_a_cleared_lane_is_kept(sumo: FakeVehicles) -> None:
    drive, factor = Driver(), TrafficConfig().deferred_speed_factor
    assert factor > OWN_SPEED_FACTOR
    drive(Owner.SUMO, Mode.YIELD_DEFERRED)
    assert sumo.settings == settings(SpeedFactor=factor)
    drive(Owner.SUMO, Mode.YIELD_KEEP_LANE)
    assert sumo.settings == settings(LaneChangeMode=KEEP_LANE_CHANGE_MODE)


def test_a_fast_driver_is_not_slowed_down_by_a_deferred_yield(sumo: FakeVehicles) -> None:
    sumo.settings["SpeedFactor"] = 1.9
    drive = Driver()
    drive(Owner.SUMO, Mode.YIELD_DEFERRED)
    assert sumo.settings["SpeedFactor"] == 1.9
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings["SpeedFactor"] == 1.9


def test_a_vehicle_that_ros_drove_is_handed_back_with_its_own_settings(sumo: FakeVehicles) -> None:
    drive = Driver()
    drive(Owner.SUMO, Mode.NOMINAL)
    drive(Owner.ROS, Mode.YIELD_PULL_OVER)
    assert len(sumo.moved_to) == 1
    sumo.settings.update(Speed=3.0, SpeedMode=0, LateralAlignment="right", LaneChangeMode=0)
    drive(Owner.SUMO, Mode.REJOIN)
    assert sumo.settings == settings()
    assert sumo.previous_speed_mps == pytest.approx(10.0)
    assert len(sumo.moved_to) == 1


def test_a_binding_outlasts_a_stretch_in_which_ros_drives(sumo: FakeVehicles) -> None:
    drive = Driver()
    drive(Owner.SUMO, Mode.YIELD_DEFERRED)
    for _ in range(3):
        drive(Owner.ROS, Mode.YIELD_LANE_CHANGE)
    drive(Owner.SUMO, Mode.YIELD_KEEP_LANE)
    assert sumo.settings == settings(LaneChangeMode=KEEP_LANE_CHANGE_MODE)
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings == settings()


def test_a_vehicle_that_left_takes_its_binding_with_it(sumo: FakeVehicles) -> None:
    drive = Driver()
    drive(Owner.SUMO, Mode.YIELD_DEFERRED)
    drive.mirror.forget(NAME)
    sumo.settings.update(settings(SpeedFactor=1.1))
    drive(Owner.SUMO, Mode.NOMINAL)
    assert sumo.settings == settings(SpeedFactor=1.1)


def test_a_mirrored_vehicle_is_put_one_step_ahead_with_its_front_in_its_lane(sumo: FakeVehicles) -> None:
    Driver()(Owner.ROS, Mode.YIELD_PULL_OVER)
    ((edge, lane, x, y, angle_deg, _),) = sumo.moved_to
    assert (edge, lane) == ("s_in", 1)
    assert (x, y) == pytest.approx((RIGHT_X_M, -120.0 + 20.0 + 0.5 + 2.0))
    assert angle_deg == pytest.approx(0.0, abs=1e-9)
