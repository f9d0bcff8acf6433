"""``kitti_exporter``: writes KITTI files during the episode."""

import sys
from functools import partial
from pathlib import Path
from typing import Any, Final

from siren_ros.data.datasets.files import FileWriter, LiveExport
from siren_ros.data.datasets.kitti import KittiCamera, KittiFrame, KittiFrames, camera_from_lidar
from siren_ros.data.episode_source import FRONT_CAMERA
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.boxes import from_ground_truth
from siren_ros.data.interfaces.conversions import EpisodeClosing
from siren_ros.data.interfaces.measurements import from_compressed_image, from_point_cloud
from siren_ros.data.lockstep import Input
from siren_ros.data.recording.bag_folder import default_bag_path_of, default_kitti_path
from siren_ros.data.sensor_messages.sensor_topics import optical_frame, static_transforms
from siren_ros.errors import InputError
from siren_ros.running.ros.node_configs import KittiExporterConfig
from siren_ros.running.ros.participants.participant import Participant
from siren_ros.running.ros.programs.program import run_program
from siren_ros.sensing.suite import load_suite
from siren_ros.simulation.scenario.episode import EpisodeDescription, EpisodeEnd, KittiLayout

_THREADS: Final = 2
"""They encode and write files beside the simulation; few files wait for them, so that memory stays bounded."""


class KittiExporter(Participant[KittiExporterConfig]):
    """Writes a frame at every step that brings both a sweep and ground truth.

    The folder stays hidden: ``cosim`` gives it its name when the whole episode is complete.
    """

    config_type = KittiExporterConfig
    inputs = (Input(topics.CLOCK), Input(topics.GROUND_TRUTH))
    _export: LiveExport | None = None

    def prepare(self, episode: EpisodeDescription, map_xml: bytes) -> None:  # noqa: ARG002 - the interface of all nodes
        """Subscribe to the first LiDAR and, where the suite has one, the front camera."""
        suite = load_suite(episode.sensor_suite, episode.files)
        if not suite.lidars:
            raise InputError("sensors", episode.sensor_suite, "a suite with a LiDAR, for the KITTI export")
        lidar = min(suite.lidars, key=lambda spec: spec.name)
        self._lidar = topics.LIDAR.of_sensor(lidar.name, lidar.period_steps)
        self._image = None
        camera = next((spec for spec in suite.cameras if spec.name == FRONT_CAMERA), None)
        if camera is not None:
            self._image = topics.IMAGE_COMPRESSED.of_sensor(camera.name, camera.period_steps)
        layout = KittiLayout(self.config.layout)
        if camera is None and layout is KittiLayout.KITTI:
            raise InputError("sensors", episode.sensor_suite, f"a suite with {FRONT_CAMERA}, for KITTI's own layout")
        calibrated = None
        if camera is not None:
            camera_pose = camera_from_lidar(static_transforms(suite), lidar.name, optical_frame(camera.name))
            calibrated = KittiCamera(camera.intrinsics, camera_pose)
        out = Path(self.config.out) if self.config.out else default_kitti_path(default_bag_path_of(episode))
        export = LiveExport(out, overwrite=self.config.overwrite)
        self._files, self._export = FileWriter(export.open(), _THREADS), export
        self._frames = KittiFrames(self._files, layout, calibrated)
        self.join_more([Input(topic) for topic in (self._lidar, self._image) if topic is not None])

    def on_step(self, step: int, inputs: dict[str, Any]) -> None:
        """Write the frame of this step, if it is one."""
        sweep, truth = inputs.get(self._lidar.name), inputs.get(topics.GROUND_TRUTH.name)
        if sweep is None or truth is None:
            return
        image = inputs.get(self._image.name) if self._image is not None else None
        jpeg = None if image is None else from_compressed_image(image)
        self._frames.write(KittiFrame(step, from_point_cloud(sweep), from_ground_truth(truth), jpeg))

    def close(self, closing: EpisodeClosing) -> None:
        """Keep the files of a complete episode; remove those of another one."""
        if self._export is not None:
            whole = False
            try:
                with self._files:  # the last files may fail here
                    pass
                whole = closing.end is EpisodeEnd.COMPLETE
            finally:
                self._export.close(whole=whole)


NODE = KittiExporter
main = partial(run_program, NODE, "kitti_exporter")

if __name__ == "__main__":
    sys.exit(main())
