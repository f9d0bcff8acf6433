"""The reading half of every pair of conversions, by message type."""

from collections.abc import Callable
from typing import Any

from sensor_message_readers import from_audio

from siren_ros.data.interfaces import boxes, conversions

READERS: dict[str, Callable[[Any], Any]] = {
    f"siren_msgs/msg/{''.join(map(str.capitalize, name.split('_')[1:]))}": reader
    for module in (boxes, conversions)
    for name, reader in vars(module).items()
    if name.startswith("from_") and reader.__module__ == module.__name__ and name != "from_path"  # of another package
}
READERS["siren_msgs/msg/AudioChunk"] = from_audio
