"""Bags of formulas: three vehicles on the road of two lanes, with a LiDAR and two cameras or without sensors."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import simplejpeg
from evaluation.made_records import moving, record_with
from hand_made_record import traffic_of
from rosbags.typesys.store import Typestore
from synthetic_episode import NET_XML

from siren_ros.base.numerics.units import time_ns_of_step
from siren_ros.data.interfaces import topics
from siren_ros.data.interfaces.boxes import boxes_of, to_boxes, to_camera_truth, to_ground_truth
from siren_ros.data.interfaces.conversions import (
    to_actor_states,
    to_episode_description,
    to_episode_outcome,
    to_events,
    to_traffic_state,
)
from siren_ros.data.interfaces.measurements import (
    Transform,
    quaternion_of_matrix,
    quaternion_of_yaw,
    to_camera_info,
    to_compressed_image,
    to_point_cloud,
    to_tf,
)
from siren_ros.data.interfaces.messages import encode_cdr, make_message
from siren_ros.data.interfaces.topics import IMAGE_COMPRESSED as IMAGE
from siren_ros.data.interfaces.topics import Topic
from siren_ros.data.recording.bag_writer import EpisodeBagWriter
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.data.sensor_messages.sensor_topics import AV, Carrier
from siren_ros.data.sensor_messages.sensor_topics import EMV as EMV_CARRIER
from siren_ros.sensing.lidar.lidar import LIDAR_POINT_DTYPE
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeOutcome
from siren_ros.simulation.world.actors import ActorClass, Event, EventKind
from siren_ros.simulation.world.carrier import (
    BASE_FRAME,
    MAP_FRAME,
    ODOM_FRAME,
    CameraIntrinsics,
    CameraTruth,
    GroundTruth,
)

Export = Callable[..., Path]
"""Exports bags: format, bag or bags, options; gives the dataset, which is made once for all tests."""
EMV, CAR, BUS, THIRD = 1, 5, 9, 11
RIGHT_Y_M, LEFT_Y_M = -5.25, -1.75
FIRST_SENSED = 4
"""Step of the first sweep; the first keyframe of 2 Hz is step 10."""
LIDAR_M = (1.0, 0.0, 2.0)
"""The LiDAR on the vehicle; it looks ahead."""
FRONT, REAR = "camera_front", "camera_rear"
FRONT_M, REAR_M = (2.0, 0.0, 1.5), (-2.0, 0.5, 1.5)
MODEL = CameraIntrinsics(64, 48, 32.0, 32.0, 32.0, 24.0)
_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""x ahead, y left, z up from right, down, ahead."""


@dataclass(frozen=True)
class BagSpec:
    """What may be varied."""

    steps: int = 42
    sensed: bool = True
    image_labels: bool = True
    av: bool = False
    """With a LiDAR and a front camera on an AV, as on the EMV but at another place."""
    seed: int = 0
    map_name: str = "straight"
    cut_off: bool = False
    """Without its outcome."""
    boxes_frame: str = "lidar"
    """Frame of the labels as ``Detection3DArray``, whose numbers are the same in any."""
    kinds: tuple[ActorClass, ...] = (ActorClass.SEDAN, ActorClass.BUS)
    """What the car and the bus are, and a third one that no sensor sees."""


def made_tracks_of(steps: int, kinds: tuple[ActorClass, ...] = BagSpec.kinds) -> EpisodeRecord:
    """The EMV at 10 m/s; a car that comes at step 10 and gains speed; a bus in the lane beside that leaves."""
    tracks = {
        EMV: moving(20.0, RIGHT_Y_M, 10.0, steps=steps, is_emv=True, actor_class=ActorClass.AMBULANCE, length_m=6.0),
        CAR: moving(
            60.0, RIGHT_Y_M, 6.0, accel_mps2=0.2, steps=steps - 10, first_step=10, length_m=4.0, actor_class=kinds[0]
        ),
        BUS: moving(40.0, LEFT_Y_M, 9.0, steps=steps - 5, actor_class=kinds[1], length_m=12.0),
    }
    for kind in kinds[2:]:
        tracks[THIRD] = moving(50.0, LEFT_Y_M, 8.0, steps=steps, actor_class=kind)
    return record_with(tracks, parse_road_network(NET_XML.encode()))


def yaw_of(step: int) -> float:
    """Of the transforms, which turn so that no axis is another."""
    return 0.3 + 0.01 * step


def place_of(step: int) -> tuple[float, float, float]:
    """Of the transforms."""
    return 20.0 + 0.5 * step, RIGHT_Y_M + 0.02 * step, 0.25


def av_place_of(step: int) -> tuple[float, float, float]:
    """Of the AV's transforms, whose yaw is a right angle less than that of the EMV's."""
    x_m, y_m, z_m = place_of(step)
    return x_m + 30.0, y_m - 2.0, z_m


def sweep_of(step: int) -> npt.NDArray[np.void]:
    """Five returns of the car, one of the road, and the numbers of their beams."""
    points = np.zeros(6, LIDAR_POINT_DTYPE)
    points["x"] = [11.5, 11.5, 11.75, 12.0, 12.0, 5.0 + step]
    points["y"] = [2.5, 2.75, 3.0, 3.25, 3.5, -2.0]
    points["z"] = [-1.0, -1.25, -1.5, -1.0, -1.25, -2.0]
    points["intensity"] = [0.2, 0.4, 0.6, 0.8, 1.0, 0.0]
    points["ring"] = np.arange(6) + 10
    points["instance"] = [CAR] * 5 + [0]
    return points


def truth_of(step: int, kinds: tuple[ActorClass, ...] = BagSpec.kinds) -> GroundTruth:
    """The car ahead to the left, which moves, and the bus behind to the right, which stands and has no return."""
    columns: dict[str, Any] = {
        "actor_id": np.array([CAR, BUS], dtype=np.uint32),
        "actor_class": np.array(kinds[:2], dtype=np.uint8),
        "is_emv": np.zeros(2, dtype=np.bool_),
        "x_m": np.array([12.0, -15.0 + 0.1 * step]),
        "y_m": np.array([3.0, -4.0]),
        "z_m": np.array([-1.25, -0.5]),
        "yaw_rad": np.array([0.5, -2.0]),
        "length_m": np.array([4.0, 12.0]),
        "width_m": np.array([1.8, 2.5]),
        "height_m": np.array([1.5, 3.0]),
        "vx_mps": np.array([3.0, 0.1]),
        "vy_mps": np.array([4.0, 0.0]),
        "accel_mps2": np.array([0.2, 0.0]),
        "lidar_points": np.array([5, 0], dtype=np.uint32),
    }
    return GroundTruth(step=step, carrier_id=EMV, **columns)


def image_truth_of(step: int, camera: str, kinds: tuple[ActorClass, ...] = BagSpec.kinds) -> CameraTruth:
    """The front camera shows the car, half of it beyond the edge; the other one the bus, nearly whole."""
    actor, kind, seen, cut = (CAR, kinds[0], 0.9, 0.5) if camera == FRONT else (BUS, kinds[1], 0.9, 0.0)
    edges = {name: np.array([value]) for name, value in zip(("u_min_px", "v_min_px"), (3.0, 4.0), strict=True)}
    return CameraTruth(
        step=step,
        actor_id=np.array([actor], dtype=np.uint32),
        actor_class=np.array([kind], dtype=np.uint8),
        is_emv=np.zeros(1, dtype=np.bool_),
        u_max_px=np.array([20.0]),
        v_max_px=np.array([30.0]),
        visible_px=np.array([300], dtype=np.uint32),
        visible_fraction=np.array([seen]),
        truncation=np.array([cut]),
        **edges,
    )


@cache
def jpeg_of(step: int, camera: str) -> bytes:
    """A picture of one colour, another one at each step."""
    colour = (5 * step % 256, 120, 200 if camera == FRONT else 40)
    return simplejpeg.encode_jpeg(np.full((MODEL.height, MODEL.width, 3), colour, dtype=np.uint8))


def mounts(carrier: Carrier = EMV_CARRIER) -> tuple[Transform, ...]:
    """LiDAR, front camera, and one that looks back."""
    base = carrier.frame(BASE_FRAME)
    back = np.array([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    return (
        Transform(base, carrier.frame("lidar"), LIDAR_M, (0.0, 0.0, 0.0, 1.0)),
        Transform(base, carrier.frame("front_frame"), FRONT_M, quaternion_of_matrix(_OPTICAL)),
        Transform(base, carrier.frame("rear_frame"), REAR_M, quaternion_of_matrix(back @ _OPTICAL)),
    )


def messages_of(spec: BagSpec, record: EpisodeRecord) -> Iterator[tuple[Topic, int, Any]]:
    """Topic, step and message, in the order of steps."""
    yield topics.EPISODE, 0, to_episode_description(record.description)
    yield topics.MAP, 0, make_message("std_msgs/msg/String", data=NET_XML)
    if spec.sensed:
        yield topics.TF_STATIC, 0, to_tf(0, (*mounts(), *(mounts(AV) if spec.av else ())))
    known: set[int] = set()
    for states in record.states:
        step, there = states.step, states.actor_id.tolist()
        spawned = tuple(record.actors[key] for key in there if key not in known)
        known.update(there)
        yield topics.TRAFFIC, step, to_traffic_state(traffic_of(step, spawned=spawned))
        yield topics.ACTORS, step, to_actor_states(states)
        events = (Event(step, EventKind.REMOVED, BUS, x_m=1.0, y_m=2.0),) if step == 20 else ()
        yield topics.EVENTS, step, to_events(step, 7, events)
        if spec.sensed:
            yield from _sensed(spec, step)
    if not spec.cut_off:
        end = EpisodeOutcome(EpisodeEnd.COMPLETE, "", spec.steps, True, {"passed": 1})
        yield topics.OUTCOME, spec.steps - 1, to_episode_outcome(end)


def _sensed(spec: BagSpec, step: int) -> Iterator[tuple[Topic, int, Any]]:
    pose = (
        Transform(MAP_FRAME, ODOM_FRAME, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
        Transform(ODOM_FRAME, BASE_FRAME, place_of(step), quaternion_of_yaw(yaw_of(step))),
    )
    if spec.av:
        pose += (
            Transform(MAP_FRAME, AV.frame(ODOM_FRAME), av_place_of(step), (0.0, 0.0, 0.0, 1.0)),
            Transform(
                AV.frame(ODOM_FRAME),
                AV.frame(BASE_FRAME),
                (0.0, 0.0, 0.0),
                quaternion_of_yaw(yaw_of(step) - 0.5 * np.pi),
            ),
        )
    yield topics.TF, step, to_tf(step, pose)
    if step % 2 or step < FIRST_SENSED:
        return
    yield topics.GROUND_TRUTH, step, to_ground_truth(truth_of(step, spec.kinds))
    yield topics.BOXES, step, to_boxes(boxes_of(truth_of(step, spec.kinds), spec.boxes_frame))
    yield topics.LIDAR.of_sensor("lidar", 2), step, to_point_cloud(step, "lidar", sweep_of(step))
    if spec.av:
        lidar, info, picture = (topic.of_carrier(AV.name) for topic in (topics.LIDAR, topics.CAMERA_INFO, IMAGE))
        yield lidar.of_sensor("lidar", 2), step, to_point_cloud(step, AV.frame("lidar"), sweep_of(step))
        frame = AV.frame("front_frame")
        yield info.of_sensor(FRONT, 2), step, to_camera_info(step, frame, MODEL)
        yield picture.of_sensor(FRONT, 2), step, to_compressed_image(step, frame, jpeg_of(step, REAR))
    for camera, frame in ((FRONT, "front_frame"), (REAR, "rear_frame")):
        yield topics.CAMERA_INFO.of_sensor(camera, 2), step, to_camera_info(step, frame, MODEL)
        yield IMAGE.of_sensor(camera, 2), step, to_compressed_image(step, frame, jpeg_of(step, camera))
        if spec.image_labels:
            labels = to_camera_truth(image_truth_of(step, camera, spec.kinds), frame)
            yield topics.IMAGE_TRUTH.of_sensor(camera, 2), step, labels


def described(spec: BagSpec) -> EpisodeRecord:
    """The record whose messages a bag holds."""
    record = made_tracks_of(spec.steps, spec.kinds)
    description = replace(
        record.description,
        seed=spec.seed,
        map_name=spec.map_name,
        map_sha256=f"{spec.map_name.encode().hex():0<64}"[:64],
        sensor_suite="made" if spec.sensed else "none",
        emv_ids=(EMV,),
    )
    return replace(record, description=description)


def write_made_bag(
    path: Path,
    store: Typestore,
    spec: BagSpec | None = None,
    lacking: Callable[[str, int], bool] = lambda _topic, _step: False,
) -> Path:
    """A bag as the recorder writes them, without the messages of some topics at some steps."""
    spec = spec or BagSpec()
    latched = [topics.EPISODE.name, topics.MAP.name, topics.TF_STATIC.name, topics.OUTCOME.name]
    writer = EpisodeBagWriter(path, store, latched)
    for topic, step, message in messages_of(spec, described(spec)):
        if lacking(topic.name, step):
            continue
        cdr = encode_cdr(store, topic, message)
        writer.write(topic.name, topic.type_name, cdr, time_ns_of_step(step))
    return writer.finish().path
