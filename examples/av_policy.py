"""A simple policy that drives the AV under test: keep the lane, make way for a siren.

    ./env ros2 run siren_ros cosim --ros-args -p av:=civilian
    ./env python examples/av_policy.py

It answers every step with a control command for the same step; the platform waits for it. ``/tf`` gives the pose on the
map (``map`` to ``av/odom`` to ``av/base_link``), ``/av/odom`` the speed. The policy follows the route by pure pursuit
and keeps a distance to the vehicle ahead. With a siren within 40 m behind it slows down and moves to the right edge of
its lane, and back when the emergency vehicle has passed.
"""

import math
import signal
from contextlib import suppress

import numpy as np
import rclpy
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from siren_msgs.msg import AvControl, EpisodeEnd, GroundTruth
from tf2_msgs.msg import TFMessage

CRUISE_MPS = 9.0
YIELD_MPS = 3.0
SIREN_M = 40.0
RIGHT_EDGE_M = -0.7
"""Offset from the lane's centre, left positive; it leaves a car's own width inside the lane."""
SHIFT_MPS = 0.6
WHEELBASE_M = 2.7
STEP_S = 0.05
INDICATOR_RIGHT = 4


class AvPolicy(Node):
    """Answers ``/tf``, ``/av/odom`` and ``/av/ground_truth`` of a step with ``/av/control_cmd``."""

    def __init__(self) -> None:
        super().__init__("av_policy")
        self.over = self.met = False
        self.control = None
        self.way = np.empty((0, 2))
        self.offset_m = 0.0
        self.waiting: dict[int, dict[type, object]] = {}
        self.truth = GroundTruth()
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(Path, "/av/route", self.on_route, latched)
        self.create_subscription(EpisodeEnd, "/siren/episode_end", self.on_end, latched)
        self.create_subscription(TFMessage, "/tf", self.on_message, 8)
        self.create_subscription(Odometry, "/av/odom", self.on_message, 8)
        self.create_subscription(GroundTruth, "/av/ground_truth", self.on_message, 8)
        self.create_subscription(TFMessage, "/tf_static", self.on_mounts, latched)  # last: see get_ready

    def get_ready(self) -> None:
        """The platform takes a controller for ready as soon as it publishes: the publisher comes last.

        The node that publishes the messages of a step has met the subscriptions in their order. Since the last one has
        its latched message, the node knows them all, and the first step is not lost.
        """
        if self.control is None and self.met and len(self.way):
            self.control = self.create_publisher(AvControl, "/av/control_cmd", 8)

    def on_route(self, path: Path) -> None:
        """The lane centres to drive along, as a point every half metre."""
        points = np.array([(pose.pose.position.x, pose.pose.position.y) for pose in path.poses])
        arc = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
        even = np.arange(0.0, arc[-1], 0.5)
        self.way = np.stack([np.interp(even, arc, points[:, axis]) for axis in (0, 1)], axis=1)

    def on_mounts(self, _message: TFMessage) -> None:
        """The mounts of the sensors, once and for all."""
        self.met = True

    def on_end(self, _message: EpisodeEnd) -> None:
        """The episode is over."""
        self.over = True

    def on_message(self, message: TFMessage | Odometry | GroundTruth) -> None:
        """Collect the messages of a step, whatever order they arrive in, and answer when they are complete."""
        stamp = (message.transforms[0] if isinstance(message, TFMessage) else message).header.stamp
        step = stamp.sec * 20 + stamp.nanosec // 50_000_000
        parts = self.waiting.setdefault(step, {})
        parts[type(message)] = message
        if len(parts) == (3 if step % 2 == 0 else 2):  # the ground truth comes at every second step
            self.truth = parts.get(GroundTruth, self.truth)
            self.answer(step, parts[Odometry], pose_on_map(parts[TFMessage]))
            del self.waiting[step]

    def answer(self, step: int, odometry: Odometry, pose: tuple[float, float, float]) -> None:
        """Decide for one step, from a pose on the map: x, y and yaw."""
        x, y = np.array(self.truth.x_m), np.array(self.truth.y_m)
        siren = bool(np.any(np.array(self.truth.is_emv) & (x < 5.0) & (np.hypot(x, y) < SIREN_M)))
        target_m = RIGHT_EDGE_M if siren else 0.0
        self.offset_m += float(np.clip(target_m - self.offset_m, -SHIFT_MPS * STEP_S, SHIFT_MPS * STEP_S))
        speed = odometry.twist.twist.linear.x
        ahead = x[(x > 0.0) & (np.abs(y) < 1.6)]
        gap_m = float(ahead.min()) - 6.0 if len(ahead) else math.inf
        wanted = min(YIELD_MPS if siren else CRUISE_MPS, max(0.0, gap_m / 1.5))
        push = 0.35 * (wanted - speed)
        command = AvControl(
            stamp=odometry.header.stamp,
            step=step,
            throttle=float(np.clip(push, 0.0, 0.8)),
            brake=float(np.clip(-0.3 * push, 0.0, 0.6)),
            steer_rad=self.steer(pose, speed),
            lights=INDICATOR_RIGHT if siren else 0,
        )
        self.control.publish(command)

    def steer(self, pose: tuple[float, float, float], speed_mps: float) -> float:
        """Pure pursuit of the way, shifted sideways by the present offset."""
        *here, yaw = pose
        nearest = int(np.argmin(np.hypot(*(self.way - here).T)))
        self.way = self.way[max(nearest - 4, 0) :]
        reach_m = max(6.0, 1.2 * speed_mps)
        target = min(min(nearest, 4) + int(reach_m / 0.5), len(self.way) - 2)
        along = self.way[target + 1] - self.way[target]
        left = np.array([-along[1], along[0]]) / np.hypot(*along)
        dx, dy = self.way[target] + self.offset_m * left - here
        side_m = math.cos(yaw) * dy - math.sin(yaw) * dx
        return math.atan(2.0 * WHEELBASE_M * side_m / (dx * dx + dy * dy))


def pose_on_map(message: TFMessage) -> tuple[float, float, float]:
    """x, y and yaw of ``av/base_link``, through ``av/odom``; ``tf2_ros`` gives the same where it is installed."""
    x = y = yaw = 0.0
    by_child = {one.child_frame_id: one.transform for one in message.transforms}
    for frame in ("av/odom", "av/base_link"):
        move, turn = by_child[frame].translation, by_child[frame].rotation
        x += math.cos(yaw) * move.x - math.sin(yaw) * move.y
        y += math.sin(yaw) * move.x + math.cos(yaw) * move.y
        yaw += 2.0 * math.atan2(turn.z, turn.w)
    return x, y, yaw


def main() -> None:
    """Drive until the episode is over."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)  # its handlers may raise RCLError
    node = AvPolicy()
    with suppress(KeyboardInterrupt):  # Ctrl-C or SIGTERM
        while not node.over:
            node.get_ready()
            rclpy.spin_once(node, timeout_sec=0.05)


if __name__ == "__main__":
    main()
