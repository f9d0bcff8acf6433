"""The reading half of every pair of conversions, by message type."""

from collections.abc import Callable
from typing import Any

from sensor_message_readers import from_audio

from siren_ros.data.interfaces.boxes import from_camera_truth, from_ground_truth
from siren_ros.data.interfaces.conversions import (
    from_actor_description,
    from_actor_states,
    from_av_control,
    from_emv_advice,
    from_episode_description,
    from_episode_end,
    from_episode_outcome,
    from_event,
    from_events,
    from_predicted_paths,
    from_signal_state,
    from_step_done,
    from_traffic_state,
    from_vehicle_commands,
)

READERS: dict[str, Callable[[Any], Any]] = {
    "siren_msgs/msg/Event": from_event,
    "siren_msgs/msg/Events": from_events,
    "siren_msgs/msg/ActorDescription": from_actor_description,
    "siren_msgs/msg/SignalState": from_signal_state,
    "siren_msgs/msg/EmvAdvice": from_emv_advice,
    "siren_msgs/msg/TrafficState": from_traffic_state,
    "siren_msgs/msg/VehicleCommands": from_vehicle_commands,
    "siren_msgs/msg/AvControl": from_av_control,
    "siren_msgs/msg/PredictedPaths": from_predicted_paths,
    "siren_msgs/msg/ActorStates": from_actor_states,
    "siren_msgs/msg/GroundTruth": from_ground_truth,
    "siren_msgs/msg/CameraTruth": from_camera_truth,
    "siren_msgs/msg/AudioChunk": from_audio,
    "siren_msgs/msg/StepDone": from_step_done,
    "siren_msgs/msg/EpisodeDescription": from_episode_description,
    "siren_msgs/msg/EpisodeEnd": from_episode_end,
    "siren_msgs/msg/EpisodeOutcome": from_episode_outcome,
}
