"""Which labels go with a picture."""

from dataclasses import dataclass

from siren_ros.sensors.suite.suite import CameraSpec, SensorSuite


@dataclass(frozen=True)
class WantedLabels:
    """Labels to draw with the colours. Semantic classes are always drawn."""

    depth: bool = False
    instance: bool = False
    boxes: bool = False

    @classmethod
    def of(cls, suite: SensorSuite, camera: CameraSpec) -> "WantedLabels":
        """Labels that a suite records of a camera."""
        return cls(camera.depth, camera.instance, suite.labels)
