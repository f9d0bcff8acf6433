"""Which labels go with a picture."""

from dataclasses import dataclass

from siren_ros.sensors.suite.suite import CameraSpec, SensorSuite


@dataclass(frozen=True)
class WantedLabels:
    """What is drawn besides colour; semantic classes always are."""

    depth: bool = False
    instance: bool = False
    boxes: bool = False

    @classmethod
    def of(cls, suite: SensorSuite, camera: CameraSpec) -> "WantedLabels":
        """What a suite records of a camera."""
        return cls(camera.depth, camera.instance, suite.labels)
