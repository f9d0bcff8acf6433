"""The tree of frames that ``/tf`` and ``/tf_static`` describe, as far as ``tf2_echo`` and ``view_frames`` need it."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation, Slerp

from small_ros2.ros_graph import message_class

NS_PER_S: Final = 1_000_000_000
KEPT_NS: Final = 10 * NS_PER_S
"""What tf2's buffer keeps of a transform that moves."""
DEPTH: Final = 100


class TransformError(Exception):
    """There is no such transform; the message is the one that tf2 has for it."""


@dataclass(frozen=True)
class Transform:
    """Takes coordinates of a frame into another one."""

    stamp_ns: int
    translation: npt.NDArray[np.float64]
    """Shape (3,), m."""
    rotation: Any
    """Of scipy's class."""

    def then(self, outer: "Transform") -> "Transform":
        """This transform, and the outer one after it; the stamp is this one's."""
        return Transform(
            self.stamp_ns, outer.translation + outer.rotation.apply(self.translation), outer.rotation * self.rotation
        )

    def inverse(self) -> "Transform":
        """The way back."""
        back = self.rotation.inv()
        return Transform(self.stamp_ns, -back.apply(self.translation), back)


@dataclass
class Link:
    """A frame's transforms into its parent, by time."""

    parent: str
    static: bool
    transforms: list[Transform] = field(default_factory=list)

    def add(self, transform: Transform) -> None:
        """Keeps it, unless it is too old or known; a static one replaces the last."""
        if self.static:
            self.transforms = [transform]
            return
        place = bisect_left(self.stamps_ns, transform.stamp_ns)
        known = place < len(self.transforms) and self.transforms[place].stamp_ns == transform.stamp_ns
        if known or (self.transforms and transform.stamp_ns < self.latest_ns - KEPT_NS):
            return
        self.transforms.insert(place, transform)
        while self.transforms[0].stamp_ns < self.latest_ns - KEPT_NS:
            del self.transforms[0]

    @property
    def stamps_ns(self) -> Sequence[int]:
        """Times of the transforms, from the oldest to the latest."""
        return [transform.stamp_ns for transform in self.transforms]

    @property
    def latest_ns(self) -> int:
        """Time of the latest transform; 0 of a static one, which holds at all times."""
        return 0 if self.static else self.transforms[-1].stamp_ns

    @property
    def oldest_ns(self) -> int:
        """Time of the oldest transform that is kept; 0 of a static one."""
        return 0 if self.static else self.transforms[0].stamp_ns

    def at(self, time_ns: int) -> Transform:
        """The transform at a time not later than the latest, between two of them along the straight line.

        Raises:
            TransformError: The time is before the oldest.
        """
        place = bisect_left(self.stamps_ns, time_ns)
        if self.static or self.transforms[place].stamp_ns == time_ns:
            return self.transforms[0 if self.static else place]
        if place == 0:
            raise TransformError(
                "Lookup would require extrapolation into the past.  "
                f"Requested time {time_ns / NS_PER_S:.6f} but the earliest data is at time "
                f"{self.oldest_ns / NS_PER_S:.6f}"
            )
        before, after = self.transforms[place - 1 : place + 1]
        share = (time_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
        turns = Slerp([0.0, 1.0], Rotation.concatenate([before.rotation, after.rotation]))
        moved = before.translation + share * (after.translation - before.translation)
        return Transform(time_ns, moved, turns(share))


class FrameTree:
    """Every frame's link to its parent; takes the messages of ``/tf`` and ``/tf_static``."""

    def __init__(self) -> None:
        self.links: dict[str, Link] = {}

    def listen(self, node: Node, moving_topic: str = "/tf", static_topic: str = "/tf_static") -> None:
        """Subscribes as tf2's listener does."""
        message = message_class("tf2_msgs/msg/TFMessage")
        latched = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(message, moving_topic, self.add, QoSProfile(depth=DEPTH))
        node.create_subscription(message, static_topic, lambda stamped: self.add(stamped, static=True), latched)

    def add(self, message: Any, *, static: bool = False) -> None:
        """Takes the transforms of a ``tf2_msgs/msg/TFMessage``; a frame with a new parent begins anew."""
        for stamped in message.transforms:
            parent, child = stamped.header.frame_id, stamped.child_frame_id
            link = self.links.get(child)
            if link is None or (link.parent, link.static) != (parent, static):
                link = self.links[child] = Link(parent, static)
            moved, turned = stamped.transform.translation, stamped.transform.rotation
            stamp_ns = stamped.header.stamp.sec * NS_PER_S + stamped.header.stamp.nanosec
            quaternion = np.array([turned.x, turned.y, turned.z, turned.w])
            if np.isfinite(quaternion).all() and np.any(quaternion):
                translation = np.array([moved.x, moved.y, moved.z])
                link.add(Transform(stamp_ns, translation, Rotation.from_quat(quaternion)))
        self.links = {child: link for child, link in self.links.items() if link.transforms}

    def frames(self) -> set[str]:
        """All frames, roots included."""
        return {*self.links, *(link.parent for link in self.links.values())}

    def latest(self, target: str, source: str) -> Transform:
        """The latest transform that takes coordinates of the source frame into the target frame.

        Its time is the earliest of the latest ones of all links between the two; 0 where all of them are static.

        Raises:
            TransformError: A frame is unknown, the two are not connected, or have no common time.
        """
        for frame, role in ((target, "target_frame"), (source, "source_frame")):
            if frame.startswith("/"):
                why = "in tf2 frame_ids cannot start with a '/'"
            elif frame not in self.frames():
                why = "frame does not exist"
            else:
                continue
            raise TransformError(f'Invalid frame ID "{frame}" passed to canTransform argument {role} - {why}')
        up, down = self._ancestors(source), self._ancestors(target)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            raise TransformError(
                f"Could not find a connection between '{target}' and '{source}' because they are not part of the same "
                "tree. Tf has two or more unconnected trees."
            )
        up, down = up[: up.index(common)], down[: down.index(common)]
        moving = [self.links[frame] for frame in (*up, *down) if not self.links[frame].static]
        stamp_ns = min((link.latest_ns for link in moving), default=0)
        back = self._chained(down, stamp_ns).inverse()
        return self._chained(up, stamp_ns).then(back)

    def _ancestors(self, frame: str) -> list[str]:
        """The frame, its parent and so on; a loop ends where it closes."""
        frames = [frame]
        while (link := self.links.get(frames[-1])) is not None and link.parent not in frames:
            frames.append(link.parent)
        return frames

    def _chained(self, frames: Sequence[str], stamp_ns: int) -> Transform:
        whole = Transform(stamp_ns, np.zeros(3), Rotation.identity())
        for frame in frames:
            whole = whole.then(self.links[frame].at(stamp_ns))
        return whole
