"""``ros2 run tf2_ros tf2_echo SOURCE TARGET [RATE] [PRECISION]``: prints a transform again and again."""

import sys
import time
from collections.abc import Sequence
from typing import Any, Final

from rclpy.utilities import remove_ros_args

from small_ros2.arguments import Parser, positive
from small_ros2.ros_graph import observer, spin_until
from small_ros2.transforms import NS_PER_S, FrameTree, Transform, TransformError

TOLD_AGAIN_S: Final = 1.0


def add_arguments(parser: Parser) -> None:
    """Declares the arguments in the real one's order."""
    parser.add_argument("source_frame", help="the frame that coordinates are taken into")
    parser.add_argument("target_frame", help="the frame that they are taken from: its pose in the other one is printed")
    parser.add_argument("echo_rate", type=positive, nargs="?", default=1.0, help="times a second (1)")
    parser.add_argument("echo_precision", type=int, nargs="?", default=3, help="decimals (3)")


def text_of(transform: Transform, precision: int) -> str:
    """A transform in the real one's words; unlike there, the nanoseconds have their leading zeros."""

    def row(values: Any) -> str:
        return ", ".join(f"{value:.{precision}f}" for value in values)

    rpy = transform.rotation.as_euler("ZYX")[::-1]
    sec, nanosec = divmod(transform.stamp_ns, NS_PER_S)
    lines = [
        f"At time {sec}.{nanosec:09d}",
        f"- Translation: [{row(transform.translation)}]",
        f"- Rotation: in Quaternion (xyzw) [{row(transform.rotation.as_quat())}]",
        f"- Rotation: in RPY (radian) [{row(rpy)}]",
        f"- Rotation: in RPY (degree) [{row(transform.rotation.as_euler('ZYX', degrees=True)[::-1])}]",
        "- Matrix:",
    ]
    for turned, moved in zip(transform.rotation.as_matrix(), transform.translation, strict=True):
        lines.append("".join(f" {value:{precision + 3}.{precision}f}" for value in (*turned, moved)))
    lines.append("".join(f" {value:{precision + 3}.{precision}f}" for value in (0.0, 0.0, 0.0, 1.0)))
    return "\n".join(lines)


def main(words: Sequence[str]) -> int:
    """Prints the transform until Ctrl-C; until there is one, says once a second what is missing."""
    parser = Parser(
        prog="tf2_echo",
        description="Echo the transform from the coordinate frame of the source_frame to the coordinate frame of the "
        "target_frame. Note: this is the transform to get data from target_frame into the source_frame.",
    )
    add_arguments(parser)
    arguments = parser.parse_args(remove_ros_args(["tf2_echo", *words])[1:])
    period_s = 1.0 / arguments.echo_rate
    tree = FrameTree()
    next_s = told_s = 0.0

    def echo_when_due() -> bool:
        nonlocal next_s, told_s
        now_s = time.monotonic()
        if now_s < next_s:
            return False
        try:
            transform = tree.latest(arguments.source_frame, arguments.target_frame)
            sys.stdout.write(f"{text_of(transform, arguments.echo_precision)}\n")
            sys.stdout.flush()
            next_s = now_s + period_s
        except TransformError as error:
            if now_s - told_s >= TOLD_AGAIN_S:
                frames = f"{arguments.source_frame} ->  {arguments.target_frame}"
                node.get_logger().info(f"Waiting for transform {frames}: {error}")
                told_s = now_s
        return False

    with observer("tf2_echo", words) as node:
        tree.listen(node)
        try:
            spin_until(node, echo_when_due)
        except KeyboardInterrupt:
            return 0
    return 0
