"""What all sensors measure of one street, and every shipped suite and look, as stored next to this file."""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, astuple, fields
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hand_made_record import crossing
from known_outputs import assert_known
from made_legs import network_of_legs
from made_street import CAMERAS, CARRIER, OTHERS, SIGNALS, SUITE, descriptions, measured, street_scene, users

from siren_ros.base.params.folders import names_in_params
from siren_ros.sensing.camera.camera import Camera, CameraFrame, RaycastRenderer
from siren_ros.sensing.camera.renderer import DrawingContext, RendererUnavailableError
from siren_ros.sensing.lidar.lidar import LidarSweep
from siren_ros.sensing.look import load_look, sun_position
from siren_ros.sensing.meshes.mesh import Catalogue, SemanticClass
from siren_ros.sensing.navigation import VehicleMotion, WheelOdometry
from siren_ros.sensing.rig import Observations, station_mount
from siren_ros.sensing.specification import map_from_base
from siren_ros.sensing.suite import LabelKinds, SensorSuite, Station, load_suite
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.world.actors import ActorClass
from siren_ros.simulation.world.carrier import CameraTruth

KNOWN = Path(__file__).parent / "known"


@cache
def seen(look: str) -> tuple[Observations, ...]:
    """What the suite measures at the first three steps."""
    return tuple(measured(SUITE, load_look(look)))


def means(points: np.ndarray, names: str) -> list[float]:
    return [len(points), *(float(points[name].mean(dtype=np.float64)) for name in names.split())]


def summary(sweep: LidarSweep) -> dict[str, object]:
    """Of rings, actors and sectors: the number of points and the means of their columns; and single points."""
    points = sweep.points
    sector = np.floor(np.arctan2(points["y"], points["x"]) / (np.pi / 6)).astype(int)
    actors = np.unique(points["instance"])
    return {
        "every fifth ring": {
            str(ring): means(points[points["ring"] == ring], "x y z intensity time")
            for ring in np.unique(points["ring"])[::5]
        },
        "actors": {str(actor): means(points[points["instance"] == actor], "x y z intensity") for actor in actors},
        "sectors": {str(one): means(points[sector == one], "x y z intensity time") for one in np.unique(sector)},
        "points": [[float(value) for value in point] for point in points[:: max(1, len(points) // 16)].tolist()],
        "near": np.stack((sweep.actor_id, sweep.points_on_actor)),
    }


@pytest.mark.parametrize("look", ["evening", "fog"])
def test_sweeps(look: str) -> None:
    sweeps = [sweep for step in seen(look)[1:] for sweep in step.sweeps]
    assert [(sweep.sensor, sweep.step) for sweep in sweeps] == [("lidar", 1), ("lidar", 2), ("bumper", 2)]
    assert_known(KNOWN / f"sweeps_{look}.json", {sweep.sensor: summary(sweep) for sweep in sweeps[1:]}, decimals=4)


def test_labels_in_space() -> None:
    last = seen("evening")[2]
    assert_known(KNOWN / "labels.json", [step.truth for step in (seen("evening")[1], last)], decimals=5)


def test_what_is_felt_and_heard() -> None:
    """Positions in 1e-5 degrees from the reference, sound as its strength and single samples; the siren's two modes."""
    rows: list[object] = []
    for step in (*seen("evening"), *measured(SensorSuite("no picture", others=OTHERS), None, 3, 200)):
        of_kind = {spec.name: value for spec, value in step.others}
        ear, fix = of_kind.pop("ear"), of_kind.pop("gnss", None)
        strength = float(np.sqrt(np.mean(np.square(ear.samples, dtype=np.float64))))
        place = fix and (
            1e5 * (fix.latitude_deg - 49.0),
            1e5 * (fix.longitude_deg - 8.4),
            fix.altitude_m,
            fix.variance_m2,
        )
        rows.append([of_kind, place, ear.sample_rate_hz, strength, ear.samples[::19].astype(float)])
    wheels = WheelOdometry(4)
    for step in (0, 1, 2, 5):
        motion = VehicleMotion(3.0 + 0.6 * step, -1.0 + 0.1 * step, 0.0, 2.0 + 0.02 * step, 12.0, -0.3, 0.4)
        rows.append(wheels.measure(step, motion))
    assert_known(KNOWN / "felt_and_heard.json", rows)


def percent(colours: np.ndarray) -> list[float]:
    return [float(value) for value in colours.reshape(-1, 3).mean(axis=0) / 2.55]


def patches(image: np.ndarray) -> list[list[float]]:
    """Mean colours of 4 rows of 6 patches, in percent."""
    rows = (np.array_split(row, 6, axis=1) for row in np.array_split(image, 4))
    return [[value for part in row for value in percent(part)] for row in rows]


def shown(frame: CameraFrame) -> dict[str, object]:
    """A picture by patches, by classes and by actors: their pixels, colours in percent and depths in decimetres."""
    image = frame.image
    by_class = {
        SemanticClass(code).name: [float((image.semantic == code).sum()), *percent(frame.rgb[image.semantic == code])]
        for code in np.unique(image.semantic)
    }
    actors = () if image.instance is None else np.unique(image.instance[image.instance > 0])
    of_actor = {str(actor): percent(frame.rgb[image.instance == actor]) for actor in actors}
    depths = [] if image.depth_m is None else [float(10.0 * depth) for depth in image.depth_m[5::14, ::31].ravel()]
    return {"patches": patches(frame.rgb), "classes": by_class, "actors": of_actor, "depths": depths}


def boxes(truth: CameraTruth) -> dict[str, object]:
    """Bounds in pixels, the number of pixels, and visible share and truncation in percent, by actor."""
    columns = [getattr(truth, field.name) for field in fields(truth)[4:]]
    rows = zip(*(np.asarray(column, float).tolist() for column in columns), strict=True)
    return {
        f"{actor} {ActorClass(kind).name}{' EMV' * bool(emv)}": [*row[:5], 100.0 * row[5], 100.0 * row[6]]
        for actor, kind, emv, row in zip(truth.actor_id, truth.actor_class, truth.is_emv, rows, strict=True)
    }


def drawn(steps: Iterable[Observations]) -> list[dict[str, object]]:
    return [
        {frame.sensor: shown(frame) | {"boxes": boxes(step.labels[frame.sensor])} for frame in step.frames}
        for step in steps
    ]


@pytest.mark.parametrize("look", ["evening", "fog", "night", "night_rain"])
def test_pictures(look: str) -> None:
    """A machine that draws otherwise may differ by a percent."""
    try:
        DrawingContext().gl.release()
    except RendererUnavailableError as error:
        pytest.skip(str(error))
    if look == "evening":
        assert_known(KNOWN / "pictures_evening.json", drawn(seen(look)[2:]), digits=3, decimals=0)
        return
    ahead = SensorSuite("ahead", cameras=CAMERAS[:1], labels=True)
    steps = measured(ahead, load_look(look), 1, 2) + measured(ahead, load_look(look), 1, 6)
    assert_known(KNOWN / f"pictures_{look}.json", drawn(steps), digits=3, decimals=0)


def test_pictures_by_casting_rays() -> None:
    shapes = {kind: vehicle_shape(kind) for kind in ActorClass}
    placed = Catalogue(shapes).place(users(2), descriptions(), CARRIER)
    renderer = RaycastRenderer(street_scene(), shapes, load_look("clear"))
    states = {signal.signal_id: signal.state for signal in SIGNALS}
    row = CARRIER - 1
    now = users(2)
    base = map_from_base(now.x_m[row], now.y_m[row], 0.0, now.yaw_rad[row])
    with ThreadPoolExecutor(1) as encoder:
        camera = Camera(CAMERAS[0], renderer, 0, encoder)
        pose = base @ camera.spec.mount.base_from_sensor
        frame = camera.expose(2, pose, placed, np.zeros(len(placed)), states, LabelKinds(depth=True, boxes=True))()
    assert_known(KNOWN / "pictures_cast.json", shown(frame), digits=4, decimals=1)


def test_stations() -> None:
    """Places of roadside units at a junction and at a road, in both networks."""
    sites = {"legs": ({"junction": "C"}, {"stretch": ["in90"]}), "crossing": ({"junction": "J"}, {"stretch": ["w_in"]})}
    networks = {"legs": network_of_legs(), "crossing": crossing()}
    known = {name: [station_mount(Station(None), networks[name], site) for site in sites[name]] for name in sites}
    assert_known(KNOWN / "stations.json", known, decimals=4)


def test_shipped_suites() -> None:
    """Every sensor's values in the order of its fields."""
    suites = {}
    for name in names_in_params("suites"):
        suite = load_suite(name)
        sensors = {
            spec.name: [type(spec).__name__, *astuple(spec.mount), *astuple(spec)[2:]]
            for spec in (*suite.lidars, *suite.cameras, *suite.others)
        }
        suites[name] = [suite.labels, suite.station, suite.common_period_steps, sensors]
    assert_known(KNOWN / "suites.json", suites)


def test_shipped_looks_and_the_sun() -> None:
    looks = {name: load_look(name) for name in names_in_params("looks")}
    light = {
        name: asdict(look)
        | {"lit": look.lamps_lit, "direct": look.direct_colour, "per_km": 1e3 * look.lidar_extinction_per_m}
        | {"towards_sun": look.towards_sun}
        for name, look in looks.items()
    }
    sun = [
        sun_position(hour, day, latitude)
        for hour, day, latitude in ((9.0, 40, 0.8), (15.5, 200, 0.8), (12.0, 300, -0.5))
    ]
    assert_known(KNOWN / "looks.json", {"looks": light, "sun": sun})
