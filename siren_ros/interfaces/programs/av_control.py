"""Messages between the platform and the AV's controller: the control, and the route to drive."""

from typing import Any

from siren_ros.interfaces.message_content import checks_content
from siren_ros.interfaces.messages import check_stamp, header, make_message, stamp
from siren_ros.interfaces.transforms import quaternion_of_yaw, to_pose
from siren_ros.numerics.geometry import Polyline
from siren_ros.numerics.units import time_ns_of_step
from siren_ros.world.carrier import MAP_FRAME
from siren_ros.world.commands import AvControl


def to_av_control(control: AvControl) -> Any:
    """``siren_msgs/AvControl``."""
    return make_message(
        "siren_msgs/msg/AvControl",
        stamp=stamp(time_ns_of_step(control.step)),
        step=control.step,
        throttle=float(control.throttle),
        brake=float(control.brake),
        steer_rad=float(control.steer_rad),
        lights=control.lights,
    )


@checks_content
def from_av_control(message: Any) -> AvControl:
    """Inverse of ``to_av_control``.

    Raises:
        EpisodeError: The stamp is not the time of the step; another program may have made the message.
    """
    control = AvControl(
        step=int(message.step),
        throttle=float(message.throttle),
        brake=float(message.brake),
        steer_rad=float(message.steer_rad),
        lights=int(message.lights),
    )
    check_stamp(message.stamp, control.step)
    return control


def to_path(way: Polyline) -> Any:
    """``nav_msgs/Path`` of a route that is known before the first step; each pose points along it."""
    at_start = header(0, MAP_FRAME)
    headings = way.heading_rad(way.arc_m)
    return make_message(
        "nav_msgs/msg/Path",
        header=at_start,
        poses=[
            make_message(
                "geometry_msgs/msg/PoseStamped",
                header=at_start,
                pose=to_pose((x_m, y_m, 0.0), quaternion_of_yaw(float(heading))),
            )
            for (x_m, y_m), heading in zip(way.points.tolist(), headings, strict=True)
        ],
    )


def from_path(message: Any) -> Polyline:
    """Inverse of ``to_path``."""
    return Polyline.through([(pose.pose.position.x, pose.pose.position.y) for pose in message.poses])
