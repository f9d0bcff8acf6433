"""An AV stack that listens: LiDAR and ground truth of the emergency vehicle, a line per simulated second.

./env python examples/av_listener.py                          # only listens: it slows and changes nothing
./env python examples/av_listener.py --participant my_stack   # waited for: cosim ... -p external:='[my_stack]'
"""

import argparse
import signal
from contextlib import suppress

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointCloud2
from siren_msgs.msg import EpisodeEnd, GroundTruth, StepDone


class AvListener(Node):
    def __init__(self, participant: str) -> None:
        super().__init__(participant or "av_listener")
        self.over, self.ready, self.waiting = False, False, {}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.report = self.create_publisher(StepDone, "/siren/step_done", 8) if participant else None
        self.create_subscription(PointCloud2, "/emv/lidar/points", self.on_message, 8)
        self.create_subscription(GroundTruth, "/emv/ground_truth", self.on_message, 8)
        self.create_subscription(EpisodeEnd, "/siren/episode_end", self.on_end, latched)

    def on_message(self, message: PointCloud2 | GroundTruth) -> None:
        step = (message.header.stamp.sec * 20) + message.header.stamp.nanosec // 50_000_000
        self.waiting.setdefault(step, {})[type(message)] = message
        if len(self.waiting[step]) == (2 if step % 2 == 0 else 1):  # the ground truth comes at every second step
            parts = self.waiting.pop(step)
            if step % 20 == 0:  # here a real stack would perceive and plan
                points, vehicles = parts[PointCloud2].width, len(parts[GroundTruth].actor_id)
                print(f"{step // 20} s: {points} points, {vehicles} vehicles", flush=True)
            self.say(StepDone.STEP, step)

    def on_end(self, message: EpisodeEnd) -> None:
        self.say(StepDone.FINAL, max(message.steps - 1, 0))
        self.over = True

    def say(self, phase: int, step: int) -> None:
        if self.report:
            self.report.publish(StepDone(step=step, participant=self.get_name(), phase=phase))

    def say_ready(self) -> None:  # until everything that we wait for has a publisher, and the lockstep hears us
        heard = all(self.count_publishers(name) for name in ("/emv/lidar/points", "/emv/ground_truth"))
        if not self.ready and heard and self.report and self.report.get_subscription_count():
            self.ready = True
            self.say(StepDone.READY, 0)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--participant", default="", help="name under which the lockstep waits for this program")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)  # its handlers may raise RCLError
    node = AvListener(parser.parse_args().participant)
    with suppress(KeyboardInterrupt):  # Ctrl-C or SIGTERM
        while not node.over:
            node.say_ready()
            rclpy.spin_once(node, timeout_sec=0.05)
        _ = node.report and node.report.wait_for_all_acked()
