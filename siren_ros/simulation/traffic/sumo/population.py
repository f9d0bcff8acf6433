"""Puts planned vehicles into SUMO, each with its own vehicle type, and keeps the number of civilians.

Pedestrians and riders are kept near some points: those far away leave, and others of a reserve enter.
"""

import math
import re
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import lru_cache
from itertools import combinations
from typing import Final, Generic, TypeAlias, TypeVar
from xml.sax.saxutils import quoteattr

import libsumo
import numpy as np

from siren_ros.base.numerics.arrays import random_stream
from siren_ros.base.numerics.geometry import Polyline, overlapping_pairs
from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.roads.road_network import MAPS_KEPT, NO_LANE, RoadNetwork
from siren_ros.simulation.scenario.paper import LEVEL_POLICIES, EmergencyLevel
from siren_ros.simulation.scenario.presets import OncomingResponse
from siren_ros.simulation.traffic.demand.own_demand import NAME_START, body_of
from siren_ros.simulation.traffic.demand.plan import (
    ClassDriving,
    DriverModel,
    LaneInterval,
    PlannedVehicle,
    Spot,
    TrafficPlan,
    least_gap_m,
)
from siren_ros.simulation.traffic.demand.road_users import draw_paint
from siren_ros.simulation.traffic.sumo.readings import SUBSCRIBED, map_from_sumo
from siren_ros.simulation.world.actors import MIRRORS_M, TWO_WHEELED, ActorClass, by_class

Point: TypeAlias = tuple[float, float]
Planned = TypeVar("Planned")


PEOPLE_WITHIN_M: Final = 180.0
"""Distance of an EMV or the AV under test within which the demanded pedestrians, cyclists and motorcyclists are. At
larger distances sensors hardly tell them apart."""
PEOPLE_MARGIN_M: Final = 15.0
"""Length by which people enter nearer than that, so that they stay for a while."""


def nearest_m(point: Point, others: Iterable[Point]) -> float:
    """Distance of a point to the nearest of some others; infinite where there are none."""
    return min((math.hypot(point[0] - x, point[1] - y) for x, y in others), default=math.inf)


_OPPOSITE: Final = -math.cos(math.radians(30.0))
_TURN_PAST_M: Final = 9.6
"""Distance of two noses within which cars cannot turn past each other: with 5.5 m (turning circle) each is moved aside
by its width of 2.1 m after 4.8 m."""
Pose: TypeAlias = tuple[float, float, float]


def meet_head_on(one: Pose, other: Pose, length_m: float, width_m: float) -> bool:
    """Whether two bodies point at each other, too near to turn past. Length and width are the means of both.

    Poses are x, y and yaw of the middle.
    """
    apart_m = math.hypot(other[0] - one[0], other[1] - one[1])
    bearing = math.atan2(other[1] - one[1], other[0] - one[0])
    off = bearing - one[2], bearing + math.pi - other[2]
    at_it = all(math.cos(angle) > 0.0 and abs(apart_m * math.sin(angle)) < width_m for angle in off)
    return at_it and math.cos(other[2] - one[2]) < _OPPOSITE and apart_m < length_m + _TURN_PAST_M


class Reserve(Generic[Planned]):
    """Planned people who have not entered yet, in their order, each with a place of entry."""

    def __init__(self, planned: Sequence[Planned], places: Sequence[Point]) -> None:
        self._planned = planned
        self._places = np.array(places).reshape(-1, 2)
        self._waiting = np.ones(len(planned), np.bool_)

    def let_in(
        self, points: Collection[Point], least_m: float, most_m: float, enter: Callable[[Planned], bool]
    ) -> None:
        """Tries to let in those whose distance to the nearest point is in a range.

        ``enter`` says whether it succeeded.
        """
        if not points:
            return
        apart = self._places[:, None] - np.array([*points])
        nearest = np.hypot(apart[..., 0], apart[..., 1]).min(axis=1)
        for row in np.flatnonzero(self._waiting & (nearest >= least_m) & (nearest <= most_m)).tolist():
            self._waiting[row] = not enter(self._planned[row])


_SHAPES: Final = by_class(
    {
        ActorClass.HATCHBACK: "passenger/hatchback",
        ActorClass.SEDAN: "passenger/sedan",
        ActorClass.ESTATE: "passenger/wagon",
        ActorClass.SUV: "passenger/van",
        ActorClass.VAN: "delivery",
        ActorClass.PICKUP: "passenger/van",
        ActorClass.BUS: "bus",
        ActorClass.TRUCK: "truck",
        ActorClass.AMBULANCE: "emergency",
        ActorClass.FIRE_TRUCK: "firebrigade",
        ActorClass.POLICE: "police",
        ActorClass.MOTORCYCLE: "motorcycle",
        ActorClass.BICYCLE: "bicycle",
    }
)
# These are no parameters: they are properties of vehicles and drivers that SUMO lacks, the same for all.
YELLOW_REACTION_S: Final = 1.0
"""``jmDriveAfterYellowTime`` of civilians: time in which a driver perceives yellow and reacts, the value with which
yellow times are computed (ITE, Traffic Engineering Handbook). Without it SUMO brakes at once, and as hard as it can."""
_WAITING_GAP_M: Final = 1.2
"""``jmStoplineGapMinor``: distance kept from the place at which a driver gives way, also inside a junction. With SUMO's
default of 0 the front of a waiting vehicle reaches into the way of others, whose bodies are wider than their paths."""
_CROSSING_GAP_M: Final = 0.5
"""``jmCrossingGap``: how near to a driver's way somebody on a crossing lets SUMO's driver wait. SUMO's 10 m take no
account of time; ``conflicts.people`` does, and holds drivers before."""
_ESCAPED: Final = re.compile(r'[&<>"\n\r\t]')
_MODEL_PARAMETERS: Final[Mapping[str, Mapping[str, float]]] = {
    "EIDM": {"sigmaleader": 0.0, "sigmagap": 0.0, "sigmaerror": 0.0, "taccmax": 0.6, "jerkmax": 4.0},
    "Krauss": {"sigma": 0.0},
}
"""Further parameters by car-following model. Errors of drivers, which would shake accelerations at each step, are off.
Drivers of the EIDM come to their full acceleration in 0.6 s (SUMO: 1.2 s, 3 m/s3), as those do who wait for green."""
_RIDERS_ACCEL_MPS2: Final = 2.5
"""Acceleration of motorcyclists: in a town they start no faster than the cars around them, whatever the motorcycle can
do."""
_RIDER_STEP_S: Final = 2.0 * STEP_S
"""Time between two decisions of riders. Two-wheelers are half of the traffic near people, and would cost as much as
cars."""
_FULL_BRAKE_MPS2: Final = 6.0
"""Deceleration of a vehicle in an emergency, with the driver's reaction included."""
_APART_M: Final = 80.0
"""Distance beyond which two vehicles in a town can always stop before they meet."""
_RUNS_RED_S: Final = 1000.0
"""``jmDriveAfterRedTime``: time since the beginning of a red up to which a privileged EMV drives over it."""


def type_id(vehicle: PlannedVehicle) -> str:
    """Name of a vehicle's own type."""
    return f"type.{vehicle.name}"


def vehicle_types_xml(vehicles: Iterable[PlannedVehicle], level: EmergencyLevel, others: str = "") -> bytes:
    """The additional file with all types; ``others`` are elements of types that are not vehicles'.

    Civilians in cars, lorries and buses are of SUMO's class ``passenger``, so that one set of lanes is open to
    all of them. Motorcycles and bicycles have their own classes. At L0 an EMV has no privilege: it keeps to the speed
    limit as well.
    """
    lines = ["<additional>"]
    for vehicle in vehicles:
        attributes = _attributes(vehicle)
        if vehicle.is_emv:
            attributes |= _of_emv(vehicle, level)
        words = "".join([f" {name}={_quoted(text)}" for name, text in attributes.items()])
        lines.append(f"<vType{words}/>")
    return "\n".join([*lines, f"{others}</additional>"]).encode()


def _quoted(text: str) -> str:
    """Quotes a text as ``quoteattr``, which is slower where nothing has to be escaped."""
    return quoteattr(text) if _ESCAPED.search(text) else f'"{text}"'


def _attributes(vehicle: PlannedVehicle) -> dict[str, str]:
    driver, driving = vehicle.driver, vehicle.driver.driving
    ridden, cycles = vehicle.actor_class in TWO_WHEELED, vehicle.actor_class is ActorClass.BICYCLE
    numbers = {
        "length": vehicle.length_m,
        # SUMO lets vehicles pass each other by widths alone, also where one stands at an angle to its lane.
        "width": vehicle.width_m + (0.0 if vehicle.is_emv or cycles else MIRRORS_M),
        "height": vehicle.height_m,
        "minGap": driving.min_gap_m,
        "accel": min(driving.accel_mps2, _RIDERS_ACCEL_MPS2) if ridden else driving.accel_mps2,
        "decel": driving.decel_mps2,
        "maxSpeed": driving.max_speed_mps * (driver.speed_factor if cycles else 1.0),
        "tau": driver.tau_s,
        "speedFactor": driver.speed_factor,
        "speedDev": 0.0,
        "maxSpeedLat": driver.max_lateral_speed_mps,
        # A vehicle moves sideways only as it drives: by at most this share of its speed, and not at all when it stands.
        "lcMaxSpeedLatStanding": 0.0,
        "lcMaxSpeedLatFactor": 0.3,
        "lcSpeedGain": 0.0 if cycles else driver.speed_gain_eagerness,
        "lcCooperative": driver.cooperation,
        "jmDriveAfterYellowTime": YELLOW_REACTION_S,
        "jmStoplineGapMinor": _WAITING_GAP_M,
        "jmCrossingGap": _CROSSING_GAP_M,
    }
    texts = {
        "id": type_id(vehicle),
        "vClass": _SHAPES[vehicle.actor_class] if ridden else "emergency" if vehicle.is_emv else "passenger",
        "guiShape": _SHAPES[vehicle.actor_class],
        "carFollowModel": driver.car_following,
        "laneChangeModel": "SL2015",
        "latAlignment": "right" if cycles else "center",
        "color": ",".join(str(part) for part in vehicle.colour_rgb),
    }
    if ridden:
        numbers["actionStepLength"] = _RIDER_STEP_S
    elif profile := driving.acceleration_profile:
        speeds, most = zip(*profile, strict=True)
        texts |= {"speedTable": _numbers(speeds), "maxAccelProfile": _numbers(most)}
    if vehicle.lane_change_s is not None:
        numbers["lcAccelLat"] = vehicle.sideways[1]
    numbers |= _MODEL_PARAMETERS.get(driver.car_following, {})
    return texts | {name: f"{value:.6g}" for name, value in numbers.items()}


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


_RED_LIGHT_SPEED_MPS: Final = 5.56
"""SUMO's ``jmDriveRedSpeed`` of a privileged EMV (SUMO's default): SUMO's own advice on speed over red."""


def _of_emv(vehicle: PlannedVehicle, level: EmergencyLevel) -> dict[str, str]:
    """Attributes of an EMV's type that differ from other vehicles'.

    It has no bluelight device: the yield manager decides who reacts to the siren, and how. The device would also push
    drivers to their lane's side for good, and give all that react new types at once, which resets their car-following.
    """
    if not LEVEL_POLICIES[level].privileged:
        return {"speedFactor": f"{min(vehicle.driver.speed_factor, 1.0):.6g}"}
    return {
        "jmDriveAfterRedTime": f"{_RUNS_RED_S:g}",
        "jmDriveAfterYellowTime": f"{_RUNS_RED_S:g}",
        "jmDriveRedSpeed": f"{_RED_LIGHT_SPEED_MPS:g}",
    }


@lru_cache(maxsize=MAPS_KEPT)
def length_scales(network: RoadNetwork) -> Mapping[str, float]:
    """Ratio of SUMO's length of each lane to the length of its centre line; on maps from OpenDRIVE the two differ.

    SUMO runs with the network's net where they are not known yet.
    """
    return {lane.lane_id: libsumo.lane.getLength(lane.lane_id) / lane.length_m for lane in network.lanes}


_NO_PAINT: Final = (255, 255, 0)
"""SUMO's colour of vehicles for which none is stated."""


def own_vehicle(name: str, seed: int, attentive: float, oncoming: OncomingResponse) -> PlannedVehicle:
    """A vehicle of the user's traffic, as SUMO has it; its driver's responses, and a missing paint, are drawn."""
    of, draws = libsumo.vehicle, random_stream(seed, f"own/{name}")
    sees, reacts = draws.random(2) < (attentive, oncoming.share)
    colours, shape = (of.getColor(name), libsumo.vehicletype.getColor(of.getTypeID(name))), of.getShapeClass(name)
    paints = [colour[:3] for colour in colours if colour[:3] != _NO_PAINT] or [draw_paint(draws)]
    shaped = (kind for kind, own in _SHAPES.items() if own == shape and own.startswith("passenger/"))
    driving = ClassDriving(of.getAccel(name), of.getDecel(name), of.getMinGap(name), of.getMaxSpeed(name))
    return PlannedVehicle(
        name,
        next(shaped, body_of(of.getVehicleClass(name))),
        *(of.getLength(name), of.getWidth(name), of.getHeight(name)),
        paints[0],
        DriverModel("", of.getSpeedFactor(name), of.getTau(name), of.getMaxSpeedLat(name), 0.0, 0.0, driving),
        tuple(of.getRoute(name)),
        Spot(NO_LANE, 0.0, of.getSpeed(name)),
        attentive=bool(sees),
        oncoming_share=oncoming.speed_share if reacts else 1.0,
    )


def route_id(name: str) -> str:
    """Name of a vehicle's planned route in SUMO."""
    return f"route.{name}"


REPLACEMENT_GAP_M: Final = 15.0
"""Free space ahead of and behind a vehicle that replaces another one."""
REPLACEMENT_DISTANCE_M: Final = 90.0
"""A replacement enters at least this far from every EMV, beyond the interaction region and the camera's care."""


class SumoPopulation:
    """The vehicles in SUMO by name, in order of entry."""

    def __init__(self, network: RoadNetwork, plan: TrafficPlan) -> None:
        self._network = network
        self._plan = plan
        self._reserve = deque(plan.reserve)
        self._riders = Reserve(plan.riders, [self._point_of(rider.spot) for rider in plan.riders])
        self._riding: Counter[ActorClass] = Counter()
        self.vehicles: dict[str, PlannedVehicle] = {}
        """Vehicles that have entered and not left."""
        self.civilians = 0
        """How many of these are neither EMVs nor riders."""

    @property
    def length_scale(self) -> Mapping[str, float]:
        """The ratios of ``length_scales``."""
        return length_scales(self._network)

    def scale_of(self, lane: int) -> float:
        """The ratio of one lane, 1 off the road. SUMO's speeds are along its own lengths."""
        return 1.0 if lane == NO_LANE else self.length_scale[self._network.lanes[lane].lane_id]

    def enter_background(self) -> None:
        """Enter the vehicles of the warm-up."""
        self._enter_all(self._plan.background)

    def enter_stage(self) -> None:
        """Clear the stage, enter groups and EMVs on it, and fill up the background elsewhere."""
        entering = *self._plan.emvs, *self._plan.groups
        circles = [(*self._at_entry(vehicle)[:2], vehicle.length_m) for vehicle in entering]
        for name in list(self.vehicles):
            if self._on_stage(name, self._plan.stage) or self._touches(name, circles):
                self._remove(name)
        for name in self._overlapping(self.vehicles, earlier=entering):
            self._remove(name)
        for name in self._head_on():
            self._remove(name)
        self._enter_all(entering)
        self.refill(self.emv_starts, self._plan.civilians)
        self._enter_riders(self.emv_starts, 0.0)

    @property
    def emv_starts(self) -> list[Point]:
        """Places where the EMVs enter."""
        return [self._point_of(emv.spot) for emv in self._plan.emvs]

    def refill(self, emv_points: Collection[Point], civilians: int) -> None:
        """Enter replacements from the reserve, away from the EMVs' points, up to a number of civilians."""
        missing = civilians - self.civilians
        places = self._places() if missing > 0 else {}
        for _ in range(len(self._reserve) if missing > 0 else 0):
            vehicle = self._reserve.popleft()
            if self._may_enter(vehicle, emv_points, places):
                self._enter_all((vehicle,))
                places[vehicle.name] = self._point_of(vehicle.spot)
                missing -= 1
                if missing <= 0:
                    return
            else:
                self._reserve.append(vehicle)

    def exchange_riders(self, points: Collection[Point]) -> list[str]:
        """Remove riders who are far from all points, and enter others out of sight of them, up to the numbers to keep.

        Returns:
            The names of those who left.
        """
        riding = [name for name, vehicle in self.vehicles.items() if vehicle.actor_class in self._plan.riders_kept]
        left = [name for name in riding if self._is_far(name, points)]
        for name in left:
            self._remove(name)
        self._enter_riders(points, REPLACEMENT_DISTANCE_M)
        return left

    def _is_far(self, name: str, points: Collection[Point]) -> bool:
        (x, y), (offset_x, offset_y) = libsumo.vehicle.getPosition(name), self._network.sumo_offset_m
        waits = x == libsumo.INVALID_DOUBLE_VALUE
        return not waits and nearest_m((x - offset_x, y - offset_y), points) > PEOPLE_WITHIN_M

    def _enter_riders(self, points: Collection[Point], least_m: float) -> None:
        wanted = self._plan.riders_kept
        if all(self._riding[kind] >= count for kind, count in wanted.items()):
            return
        places = self._places()

        def enter(rider: PlannedVehicle) -> bool:
            enough = self._riding[rider.actor_class] >= wanted[rider.actor_class]
            if enough or not self._may_enter(rider, (), places):
                return False
            self._enter_all((rider,))
            places[rider.name] = self._point_of(rider.spot)
            return True

        most_m = PEOPLE_WITHIN_M - PEOPLE_MARGIN_M
        self._riders.let_in(points, least_m, most_m, enter)

    def drop_departed(self) -> tuple[str, ...]:
        """Removes vehicles that left SUMO in the last step, and returns their names in order of entry."""
        arrived = libsumo.simulation.getArrivedIDList()
        if not arrived:
            return ()
        gone = tuple(name for name in self.vehicles if name in arrived)
        for name in gone:
            self._forget(name)
        return gone

    def _forget(self, name: str) -> None:
        self._count(self.vehicles.pop(name), -1)

    def _count(self, vehicle: PlannedVehicle, more: int) -> None:
        if vehicle.actor_class in self._plan.riders_kept:
            self._riding[vehicle.actor_class] += more
        elif not vehicle.is_emv:
            self.civilians += more

    def _enter_all(self, vehicles: Iterable[PlannedVehicle]) -> None:
        for vehicle in vehicles:
            lane = self._network.lanes[vehicle.spot.lane]
            libsumo.route.add(route_id(vehicle.name), vehicle.route)
            # SUMO refuses a vehicle that enters too fast, so an EMV without privilege enters no faster than its driver
            # may go.
            allowed_mps = lane.speed_limit_mps * float(libsumo.vehicletype.getSpeedFactor(type_id(vehicle)))
            libsumo.vehicle.add(
                vehicle.name,
                route_id(vehicle.name),
                typeID=type_id(vehicle),
                depart="now",
                departLane=str(lane.position),
                departPos=repr(vehicle.spot.front_m * self.length_scale[lane.lane_id]),
                departSpeed=repr(min(vehicle.spot.speed_mps, allowed_mps)),
            )
            self._keep(vehicle)

    def take_in_own(self) -> None:
        """Makes those actors of the episode that SUMO inserted of the user's traffic in the last step."""
        departed = libsumo.simulation.getDepartedIDList() if self._plan.own else ()
        for name in sorted(name for name in departed if name.startswith(NAME_START)):
            vehicle = own_vehicle(name, *self._plan.attention)
            libsumo.route.add(route_id(name), vehicle.route)
            libsumo.vehicle.setRouteID(name, route_id(name))
            self._keep(vehicle)

    def _keep(self, vehicle: PlannedVehicle) -> None:
        if not vehicle.attentive:  # SUMO's drivers always wait for vehicles that are already on the junction
            emvs = " ".join(sorted({type_id(emv) for emv in self._plan.emvs}))
            libsumo.vehicle.setParameter(vehicle.name, "junctionModel.ignoreTypes", emvs)
        libsumo.vehicle.subscribe(vehicle.name, SUBSCRIBED)
        self.vehicles[vehicle.name] = vehicle
        self._count(vehicle, 1)

    def _remove(self, name: str) -> None:
        libsumo.vehicle.unsubscribe(name)
        libsumo.vehicle.remove(name)
        self._forget(name)

    def _near(self, vehicle: PlannedVehicle, places: Mapping[str, Point]) -> list[str]:
        """The vehicles at ``places`` that a vehicle which enters may be unable to stop for."""
        x, y = self._point_of(vehicle.spot)
        return [name for name in places if max(abs(places[name][0] - x), abs(places[name][1] - y)) <= _APART_M]

    def _overlapping(
        self, names: Iterable[str], earlier: Sequence[PlannedVehicle] = (), later: Sequence[PlannedVehicle] = ()
    ) -> list[str]:
        """Vehicles that have to be removed so that no two bodies overlap: of each such pair the one that entered later.

        The names are of vehicles in SUMO; those that are planned to enter count as ``earlier``, which stay, or as
        ``later`` ones. SUMO's vehicles have the width of their lane: side by side, while one changes lanes, they may
        overlap. The way on which a vehicle comes to a stand with full braking belongs to its body: nobody could stop
        before the other.
        """
        # Vehicles that wait to enter have no lane and are left out.
        names = [name for name in names if libsumo.vehicle.getLaneID(name)]
        bodies = [*earlier, *(self.vehicles[name] for name in names), *later]
        if not bodies:
            return []
        poses = {body.name: (*self._at_entry(body), body.spot.speed_mps) for body in (*earlier, *later)}
        poses |= {name: (*self._pose_of(name), libsumo.vehicle.getSpeed(name)) for name in names}
        length_m, width_m = np.array([(body.length_m, body.width_m) for body in bodies]).T
        x_m, y_m, yaw_rad, speed_mps = np.array([poses[body.name] for body in bodies]).T
        stop_m = np.array([speed**2 for speed in speed_mps.tolist()]) / (2.0 * _FULL_BRAKE_MPS2)
        x_m, y_m = x_m + 0.5 * stop_m * np.cos(yaw_rad), y_m + 0.5 * stop_m * np.sin(yaw_rad)
        _, leaving, _ = overlapping_pairs(x_m, y_m, yaw_rad, length_m + stop_m, width_m)
        return [bodies[row].name for row in dict.fromkeys(leaving.tolist()) if row >= len(earlier)]

    def _head_on(self) -> list[str]:
        """Vehicles on junctions that meet another one head-on: of each such pair the one that entered later.

        In the warm-up SUMO lets left turns from opposite sides drive through each other; in the episode they would
        stand before each other for ever.
        """
        poses = {name: self._pose_of(name) for name in self.vehicles if libsumo.vehicle.getLaneID(name).startswith(":")}
        leaving: dict[str, None] = {}
        for first, second in combinations(poses, 2):
            one, other = self.vehicles[first], self.vehicles[second]
            size = 0.5 * (one.length_m + other.length_m), 0.5 * (one.width_m + other.width_m)
            if first not in leaving and meet_head_on(poses[first], poses[second], *size):
                leaving[second] = None
        return list(leaving)

    def _pose_of(self, name: str) -> tuple[float, float, float]:
        """Centre and yaw of a vehicle that is in SUMO, in the ``map`` frame."""
        front, angle_deg = libsumo.vehicle.getPosition(name), libsumo.vehicle.getAngle(name)
        length_m, offset_m = self.vehicles[name].length_m, self._network.sumo_offset_m
        return map_from_sumo(front[0], front[1], angle_deg, length_m, offset_m)

    def _on_stage(self, name: str, stage: Iterable[LaneInterval]) -> bool:
        lane = self._network.lane_by_id.get(libsumo.vehicle.getLaneID(name))
        if lane is None:
            return False
        front = libsumo.vehicle.getLanePosition(name) / self.length_scale[lane.lane_id]
        rear = front - self.vehicles[name].length_m
        return any(area.lane == lane.index and rear <= area.to_m and front >= area.from_m for area in stage)

    def _touches(self, name: str, entering: Iterable[tuple[float, float, float]]) -> bool:
        """Whether a vehicle may overlap one that enters, on whatever lanes the two stand: by their outer circles."""
        length_m = self.vehicles[name].length_m
        x, y, _ = self._pose_of(name)
        return any(np.hypot(x - ex, y - ey) < 0.5 * (length_m + other_m) for ex, ey, other_m in entering)

    def _at_entry(self, vehicle: PlannedVehicle) -> tuple[float, float, float]:
        """Centre and yaw at the place of entry, in the ``map`` frame."""
        centre_line = self._network.lanes[vehicle.spot.lane].centre
        x, y = self._point_of(vehicle.spot)
        yaw = float(centre_line.heading_rad(vehicle.spot.front_m))
        half = 0.5 * vehicle.length_m
        return x - half * np.cos(yaw), y - half * np.sin(yaw), yaw

    def _point_of(self, spot: Spot) -> Point:
        x, y = self._network.lanes[spot.lane].centre.at(spot.front_m)
        return float(x), float(y)

    def _places(self) -> dict[str, Point]:
        """Places of all vehicles that are in SUMO or will enter."""
        offset_x, offset_y = self._network.sumo_offset_m
        places = {}
        for name, vehicle in self.vehicles.items():
            x, y = libsumo.vehicle.getPosition(name)
            waits = x == libsumo.INVALID_DOUBLE_VALUE
            places[name] = self._point_of(vehicle.spot) if waits else (x - offset_x, y - offset_y)
        return places

    def _may_enter(self, vehicle: PlannedVehicle, emv_points: Collection[Point], places: Mapping[str, Point]) -> bool:
        """Whether a vehicle's place is free, and nobody comes across whom it could not stop for."""
        free = self._spot_is_free(vehicle, emv_points, places)
        return free and vehicle.name not in self._overlapping(self._near(vehicle, places), later=(vehicle,))

    def _spot_is_free(
        self, vehicle: PlannedVehicle, emv_points: Collection[Point], places: Mapping[str, Point]
    ) -> bool:
        x, y = self._point_of(vehicle.spot)
        if nearest_m((x, y), emv_points) < REPLACEMENT_DISTANCE_M:
            return False
        lane = self._network.lanes[vehicle.spot.lane]
        gap = max(REPLACEMENT_GAP_M, least_gap_m(lane.speed_limit_mps))
        around: Polyline = lane.centre.cut(vehicle.spot.front_m - vehicle.length_m - gap, vehicle.spot.front_m + gap)
        for name, point in places.items():
            reach_m = around.length_m + self.vehicles[name].length_m
            if max(abs(point[0] - x), abs(point[1] - y)) > reach_m + gap + lane.width_m:
                continue
            along, left = around.project(point)
            if -gap < along < reach_m and abs(left) < lane.width_m:
                return False
        return True
