"""The measurements of a suite at one step, finished or still under way."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from siren_ros.sensors.camera.camera import CameraFrame
from siren_ros.sensors.hearing.microphone import AudioChunk
from siren_ros.sensors.lidar.lidar import LidarSweep
from siren_ros.sensors.navigation.gnss import GnssFix
from siren_ros.sensors.navigation.imu import ImuSample
from siren_ros.world.carrier import CameraTruth, GroundTruth


@dataclass(frozen=True, eq=False)
class Observations:
    """Measurements of the sensors that were due at a step."""

    step: int
    sweeps: tuple[LidarSweep, ...]
    frames: tuple[CameraFrame, ...]
    truth: GroundTruth | None
    """Every ``LABEL_PERIOD_STEPS``."""
    labels: Mapping[str, CameraTruth] = field(default_factory=dict)
    """Labels of the pictures by camera, where they are wanted."""
    fixes: tuple[GnssFix, ...] = ()
    inertial: tuple[ImuSample, ...] = ()
    sounds: tuple[AudioChunk, ...] = ()


@dataclass(frozen=True, eq=False)
class Sensing:
    """A step whose measurements have begun."""

    under_way: bool
    """Whether other threads are still making pictures or sweeps."""
    finish: Callable[[], Observations]
    """Waits for them and returns all measurements. Call it once, and before the next step's measurements begin."""
