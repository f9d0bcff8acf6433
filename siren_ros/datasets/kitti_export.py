"""KITTI frames out of a recorded episode."""

from pathlib import Path
from typing import Final

from siren_ros.datasets.kitti import KittiCamera, KittiFrame, KittiWriter, camera_from_lidar
from siren_ros.errors import BagError
from siren_ros.interfaces.boxes import from_ground_truth
from siren_ros.interfaces.images import from_camera_info, from_compressed_image
from siren_ros.interfaces.point_cloud import from_point_cloud
from siren_ros.interfaces.topics import CAMERA_INFO, GROUND_TRUTH, IMAGE_COMPRESSED, LIDAR, TF_STATIC, Topic
from siren_ros.interfaces.transforms import from_tf
from siren_ros.numerics.units import step_of_time_ns
from siren_ros.recording.bag_reader import BagMessage, OpenBag, damage_refused, open_bag
from siren_ros.sensors.suite.suite import EXPORTED_CAMERA

FRONT_CAMERA: Final = EXPORTED_CAMERA
_NEEDED: Final = "an episode recorded with a LiDAR and its ground truth"


def export_kitti(bag_path: Path, folder: Path) -> int:
    """Writes every step that has both a sweep and ground truth as a KITTI frame.

    Args:
        bag_path: Folder of the bag.
        folder: New or empty folder.

    Returns:
        Number of frames.

    Raises:
        BagError: Not an episode, or one without a LiDAR.
        InputError: The folder cannot be used.
    """
    with open_bag(bag_path) as bag:
        lidar = _sensor_topic(bag, LIDAR)
        if lidar is None or GROUND_TRUTH.name not in bag.type_names:
            raise BagError(str(bag_path), _NEEDED)
        image = IMAGE_COMPRESSED.of_sensor(FRONT_CAMERA, 1).name
        camera = _camera(bag, lidar)
        writer = KittiWriter(folder, camera)
        held: dict[str, BagMessage] = {}
        for message in bag.messages({lidar, GROUND_TRUTH.name, image}):
            if held and next(iter(held.values())).time_ns != message.time_ns:
                _write_frame(writer, held, lidar, image)
                held = {}
            held[message.topic] = message
        _write_frame(writer, held, lidar, image)
        return writer.frames


def _sensor_topic(bag: OpenBag, topic: Topic) -> str | None:
    """The bag's first topic of a kind whose name carries a sensor's."""
    head, tail = topic.name.split("{sensor}")
    names = sorted(name for name, kind in bag.type_names.items() if kind == topic.type_name)
    return next((name for name in names if name.startswith(head) and name.endswith(tail)), None)


def _camera(bag: OpenBag, lidar: str) -> KittiCamera | None:
    info_topic = CAMERA_INFO.of_sensor(FRONT_CAMERA, 1).name
    first = {}
    for name in (lidar, info_topic, TF_STATIC.name):
        message = next(bag.messages({name}), None)
        if message is None:
            return None
        first[name] = message.read()
    frames = (str(first[lidar].header.frame_id), str(first[info_topic].header.frame_id))
    with damage_refused(bag.path):
        transforms = from_tf(first[TF_STATIC.name])
        return KittiCamera(from_camera_info(first[info_topic]), camera_from_lidar(transforms, *frames))


def _write_frame(writer: KittiWriter, held: dict[str, BagMessage], lidar: str, image: str) -> None:
    if lidar not in held or GROUND_TRUTH.name not in held:
        return
    bag_path = held[lidar].bag.path
    with damage_refused(bag_path):
        step = step_of_time_ns(held[lidar].time_ns)
        points = from_point_cloud(held[lidar].read())
        truth = from_ground_truth(held[GROUND_TRUTH.name].read())
        jpeg = from_compressed_image(held[image].read()) if image in held else None
    writer.write(KittiFrame(step, points, truth, jpeg))
