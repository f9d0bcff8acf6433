"""A trajectory predictor in the loop: at every frame it says where each vehicle will be, and the bag records it.

    ./env ros2 run siren_ros cosim --ros-args -p predictor:=my_predictor -p bag:=bags/judged
    ./env python examples/live_predictor.py
    ./env siren evaluate prediction bags/judged --predictions my_predictor=/predictions

It lets every vehicle keep its velocity. A real predictor keeps the states of the last seconds, and publishes several
paths for each vehicle. The episode waits for it, however slow it is.
"""

import signal
from contextlib import suppress

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from siren_msgs.msg import ActorStates, EpisodeEnd, PredictedPaths, StepDone

TIMES_S = 0.2 * np.arange(1, 26)


class LivePredictor(Node):
    """Takes part in the lockstep under its own name."""

    def __init__(self) -> None:
        super().__init__("my_predictor")
        self.over = self.ready = False
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.report = self.create_publisher(StepDone, "/siren/step_done", 8)
        self.predictions = self.create_publisher(PredictedPaths, "/predictions", 8)
        self.create_subscription(ActorStates, "/siren/actor_states", self.on_states, 8)
        self.create_subscription(EpisodeEnd, "/siren/episode_end", self.on_end, latched)

    def on_states(self, states: ActorStates) -> None:
        """Predict at every second step, the frames at 10 Hz."""
        if states.step % 2 == 0:
            x_m = np.array(states.x_m)[:, None] + np.outer(states.vx_mps, TIMES_S)
            y_m = np.array(states.y_m)[:, None] + np.outer(states.vy_mps, TIMES_S)
            self.predictions.publish(
                PredictedPaths(
                    stamp=states.stamp,
                    step=states.step,
                    actor_id=states.actor_id,
                    probability=[1.0] * len(states.actor_id),
                    x_m=x_m.ravel().tolist(),
                    y_m=y_m.ravel().tolist(),
                )
            )
        self.say(StepDone.STEP, states.step)

    def on_end(self, message: EpisodeEnd) -> None:
        self.say(StepDone.FINAL, max(message.steps - 1, 0))
        self.over = True

    def say(self, phase: int, step: int) -> None:
        self.report.publish(StepDone(step=step, participant=self.get_name(), phase=phase))

    def say_ready(self) -> None:
        """Once everything that we wait for has a publisher, and the lockstep and the recorder hear us."""
        heard = self.report.get_subscription_count() and self.predictions.get_subscription_count()
        if not self.ready and heard and self.count_publishers("/siren/actor_states"):
            self.ready = True
            self.say(StepDone.READY, 0)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    rclpy.init(signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)  # its handlers may raise RCLError
    node = LivePredictor()
    with suppress(KeyboardInterrupt):  # Ctrl-C or SIGTERM
        while not node.over:
            node.say_ready()
            rclpy.spin_once(node, timeout_sec=0.05)
        node.report.wait_for_all_acked()
