"""Reads the messages that the library only writes, so that tests can compare what goes in with what comes out."""

from typing import Any

import numpy as np
import numpy.typing as npt

from siren_ros.data.interfaces.boxes import Marker, MarkerShape, SpaceBoxes
from siren_ros.data.interfaces.measurements import from_quaternion, from_vector, yaw_of_quaternion
from siren_ros.data.interfaces.messages import step_of, time_ns_of
from siren_ros.simulation.world.carrier import AudioChunk, GnssFix, ImuSample, Odometry

ENCODINGS = {"rgb8": ("u1", 3), "mono8": ("u1", 1), "mono16": ("<u2", 1), "32FC1": ("<f4", 1)}
PLANAR = np.ix_([0, 1, 5], [0, 1, 5])
"""Indices of x, y and yaw in a covariance of x, y, z and rotations about x, y, z."""


def from_boxes(message: Any) -> SpaceBoxes:
    """Reads the message that ``to_boxes`` makes."""
    detections = message.detections
    centres = [detection.bbox.center for detection in detections]
    sizes = [detection.bbox.size for detection in detections]
    best = [detection.results[0].hypothesis for detection in detections]
    ids = tuple(str(detection.id) for detection in detections)
    return SpaceBoxes(
        step=step_of(message),
        frame_id=str(message.header.frame_id),
        class_names=tuple(str(hypothesis.class_id) for hypothesis in best),
        score=np.array([float(hypothesis.score) for hypothesis in best]),
        centre_m=np.array([from_vector(centre.position) for centre in centres]).reshape(-1, 3),
        size_m=np.array([from_vector(size) for size in sizes]).reshape(-1, 3),
        yaw_rad=np.array([yaw_of_quaternion(from_quaternion(centre.orientation)) for centre in centres]),
        ids=ids if any(ids) else None,
    )


def from_markers(message: Any) -> tuple[Marker, ...]:
    """Reads the message that ``to_markers`` makes."""
    return tuple(
        Marker(
            namespace=str(marker.ns),
            marker_id=int(marker.id),
            shape=MarkerShape(int(marker.type)),
            centre_m=from_vector(marker.pose.position),
            yaw_rad=yaw_of_quaternion(from_quaternion(marker.pose.orientation)),
            size_m=from_vector(marker.scale),
            colour=(float(marker.color.r), float(marker.color.g), float(marker.color.b), float(marker.color.a)),
            text=str(marker.text),
        )
        for marker in message.markers
    )


def from_odometry(message: Any) -> tuple[int, Odometry]:
    """Reads the message that ``to_odometry`` makes: simulated time in nanoseconds, and the odometry."""
    x, y, _ = from_vector(message.pose.pose.position)
    odometry = Odometry(
        x_m=x,
        y_m=y,
        yaw_rad=yaw_of_quaternion(from_quaternion(message.pose.pose.orientation)),
        forward_mps=float(message.twist.twist.linear.x),
        left_mps=float(message.twist.twist.linear.y),
        yaw_rate_radps=float(message.twist.twist.angular.z),
        pose_covariance=np.array(message.pose.covariance, np.float64).reshape(6, 6)[PLANAR],
        twist_covariance=np.array(message.twist.covariance, np.float64).reshape(6, 6)[PLANAR],
    )
    return time_ns_of(message.header.stamp), odometry


def from_image(message: Any) -> npt.NDArray[np.generic]:
    """Reads the message that ``to_image`` makes: the array, which shares the message's memory."""
    kind, channels = ENCODINGS[message.encoding]
    dtype = np.dtype(kind)
    height, width = int(message.height), int(message.width)
    assert int(message.step) == width * channels * dtype.itemsize
    shape = (height, width, channels) if channels > 1 else (height, width)
    return np.frombuffer(message.data, dtype=np.uint8).view(dtype).reshape(shape)


def from_audio(message: Any) -> AudioChunk:
    """Reads the message that ``to_audio`` makes."""
    return AudioChunk(
        step=step_of(message),
        frame_id=str(message.header.frame_id),
        sample_rate_hz=int(message.sample_rate_hz),
        samples=np.array(message.samples, dtype=np.int16),
    )


def from_imu(message: Any) -> ImuSample:
    """Reads the message that ``to_imu`` makes."""
    force, rate = message.linear_acceleration, message.angular_velocity
    return ImuSample(
        step=step_of(message),
        frame_id=str(message.header.frame_id),
        specific_force_mps2=np.array([force.x, force.y, force.z]),
        angular_rate_radps=np.array([rate.x, rate.y, rate.z]),
        force_variance=float(message.linear_acceleration_covariance[0]),
        rate_variance=float(message.angular_velocity_covariance[0]),
    )


def from_nav_sat_fix(message: Any) -> GnssFix:
    """Reads the message that ``to_nav_sat_fix`` makes."""
    return GnssFix(
        step=step_of(message),
        frame_id=str(message.header.frame_id),
        latitude_deg=float(message.latitude),
        longitude_deg=float(message.longitude),
        altitude_m=float(message.altitude),
        variance_m2=np.asarray(message.position_covariance, dtype=np.float64).reshape(3, 3).diagonal().copy(),
    )
