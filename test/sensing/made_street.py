"""A crossing full of road users that all sensors measure: more than one of everything, and nothing along an axis."""

from functools import cache

import numpy as np
from made_legs import network_of_legs

from siren_ros.sensing.microphone import MicrophoneSpec
from siren_ros.sensing.navigation import GnssSpec, ImuSpec
from siren_ros.sensing.rig import Observations, SensorRig
from siren_ros.sensing.scene.static_scene import static_scene
from siren_ros.sensing.scene.surfaces import SceneConfig
from siren_ros.sensing.specification import CameraSpec, LidarSpec, Mount
from siren_ros.sensing.suite import SensorSuite
from siren_ros.sensing.vehicles.vehicle_shapes import vehicle_shape
from siren_ros.simulation.world.actors import (
    ACTOR_STATE_DTYPES,
    ActorClass,
    ActorDescription,
    ActorStates,
    Lights,
    SignalState,
)

VARIED = SceneConfig(parked_share=0.3, clutter_per_100_m=3.0, size_spread=0.05, colour_share=0.5)
CARRIER = 2
_BLUE = Lights.BEACON | Lights.SIREN
_BRAKING_LEFT = Lights.BRAKE | Lights.INDICATOR_LEFT
_USERS = (
    (ActorClass.POLICE, 11.0, 1.9, 3.04, 9.0, 0.05, _BLUE | Lights.BRAKE, 0.2, 1.0),
    (ActorClass.AMBULANCE, 27.0, 5.2, 3.10, 13.0, 0.20, _BLUE, 0.1, 1.0),
    (ActorClass.BUS, -16.0, 5.4, -3.08, 6.0, 0.0, Lights.INDICATOR_RIGHT, 0.0, 1.0),
    (ActorClass.MOTORCYCLE, 18.0, 2.9, 2.95, 11.0, -0.3, 0, -0.1, 1.0),
    (ActorClass.TRUCK, 12.0, -5.2, 0.05, 8.0, 0.0, Lights.BRAKE, 0.0, 1.08),
    (ActorClass.BICYCLE, 17.0, 7.3, 3.2, 4.0, 0.0, 0, 0.3, 1.0),
    (ActorClass.PEDESTRIAN, 20.0, 10.3, 3.0, 1.3, 0.0, 0, 0.0, 1.0),
    (ActorClass.PEDESTRIAN, 15.8, -2.0, 1.4, 1.5, 0.0, 0, 0.0, 0.9),
    (ActorClass.SEDAN, 3.0, -23.0, 1.7, 0.0, 0.0, _BRAKING_LEFT, 0.4, 1.0),
    (ActorClass.HATCHBACK, -170.0, 4.0, 0.1, 14.0, 0.0, 0, 0.0, 1.0),
    (ActorClass.SUV, 39.0, 1.8, 3.14, 12.0, 0.0, _BRAKING_LEFT, 0.0, 1.0),
    (ActorClass.FIRE_TRUCK, -5.2, 23.0, -1.5, 5.0, -0.1, _BLUE, 0.0, 1.0),
    (ActorClass.TRUCK, -82.0, -2.0, 0.02, 11.0, 0.0, 0, 0.0, 1.0),
)
"""Class, x and y in metres, heading, speed, yaw rate, lights, steering angle, and stretch; their ids count from 1."""
SIGNALS = (SignalState("C", "ruyGrgoOrsrG"), SignalState("elsewhere", "GGG"))
LIDARS = (
    LidarSpec("lidar", Mount(0.0, 0.0, 2.9), channels=32, points_per_second=32 * 512 * 20, lower_fov_rad=-0.5),
    LidarSpec(
        "bumper", Mount(2.9, 0.4, 1.1, 0.3, -0.02, 0.05), channels=16, points_per_second=16 * 360 * 10, rate_hz=10.0,
        range_m=60.0, noise_stddev_m=0.03, dropoff_general_rate=0.2, dropoff_zero_intensity=0.6, resolution_m=0.01,
        motion_distortion=True,
    ),
)  # fmt: skip
CAMERAS = (
    CameraSpec("ahead", Mount(2.9, 0.0, 1.6), width=192, height=108, depth=True),
    CameraSpec(
        "right", Mount(0.5, -1.2, 2.4, -0.9, 0.15), width=96, height=72, noise_stddev=6.0, blur_px=1.0, exposure=2.0
    ),
    CameraSpec("behind", Mount(-3.0, 0.2, 2.0, 2.9), width=96, height=72, horizontal_fov_rad=1.2, anti_aliasing=False),
)
OTHERS = (
    GnssSpec("gnss", Mount(1.0, 0.5, 3.0), horizontal_noise_stddev_m=0.4, bias_walk_m_per_sqrt_s=0.5),
    ImuSpec("imu", Mount(1.0, -0.5, 0.8, 0.4, 0.1, -0.2), accel_bias_walk_mps2_per_sqrt_s=0.02),
    MicrophoneSpec("ear", Mount(-1.0, 0.0, 2.5), sample_rate_hz=8_000),
)
SUITE = SensorSuite("all", LIDARS, CAMERAS, OTHERS, labels=True)


def users(step: int) -> ActorStates:
    """The road users at a step; each goes straight on while its yaw rate is felt already."""
    kinds, x_m, y_m, yaw_rad, speed_mps, rate, lights, steer, _ = (
        np.array(column) for column in zip(*_USERS, strict=True)
    )
    vx_mps, vy_mps = speed_mps * np.cos(yaw_rad), speed_mps * np.sin(yaw_rad)
    speed_up = 1.0 + 0.02 * step
    columns = {
        "actor_id": np.arange(1, len(kinds) + 1),
        "x_m": x_m + 0.05 * step * vx_mps,
        "y_m": y_m + 0.05 * step * vy_mps,
        "yaw_rad": yaw_rad + 0.05 * step * rate,
        "vx_mps": vx_mps * speed_up,
        "vy_mps": vy_mps * speed_up,
        "yaw_rate_radps": rate * speed_up,
        "accel_mps2": 0.4 * speed_mps,
        "steer_rad": steer,
        "lights": lights,
    }
    blank = np.zeros(len(kinds))
    return ActorStates(
        step, **{name: columns.get(name, blank).astype(kind) for name, kind in ACTOR_STATE_DTYPES.items()}
    )


def descriptions() -> dict[int, ActorDescription]:
    """What the road users are; each has a colour of its own."""
    described = {}
    for number, (kind, *_, stretch) in enumerate(_USERS, start=1):
        shape = vehicle_shape(kind)
        size_m = (stretch * shape.length_m, shape.width_m, (2.0 - stretch) * shape.height_m)
        colour = (19 * number, 255 - 19 * number, 60)
        described[number] = ActorDescription(number, f"v{number}", kind, *size_m, colour, kind.is_emergency)
    return described


@cache
def street_scene():
    return static_scene(network_of_legs(), 3, VARIED)


def measured(
    suite: SensorSuite, look=None, steps: int = 3, first_step: int = 0, **options: object
) -> list[Observations]:
    """What a suite measures at steps of the street."""
    rig = SensorRig(suite, network_of_legs(), 3, VARIED, look, street_scene(), noise_seed=8, **options)
    return [
        rig.observe(users(step), descriptions(), SIGNALS, CARRIER) for step in range(first_step, first_step + steps)
    ]
