"""``metadata.yaml`` of a rosbag2 bag, version 9, and the QoS profiles in it.

Layout: https://github.com/ros2/rosbag2 (``rosbag2_storage``, ``yaml.hpp``), release Jazzy.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from siren_ros.errors import BagError
from siren_ros.params import plain_yaml

METADATA_FILE: Final = "metadata.yaml"
VERSION: Final = 9
MAX_METADATA_BYTES: Final = 1_000_000
_FOREVER: Final = {"sec": 9223372036, "nsec": 854775807}
"""How rosbag2 writes an unlimited duration."""


@dataclass(frozen=True)
class BagTopic:
    """One topic of a bag as the metadata lists it."""

    name: str
    type_name: str
    type_hash: str
    """REP 2016 hash, ``RIHS01_…``."""
    latched: bool
    message_count: int


def qos_profiles(latched: bool) -> list[dict[str, Any]]:
    """The QoS profile of a topic's publisher, in a list; latched topics are transient local."""
    return [
        {
            "history": "keep_last",
            "depth": 1 if latched else 10,
            "reliability": "reliable",
            "durability": "transient_local" if latched else "volatile",
            "deadline": dict(_FOREVER),
            "lifespan": dict(_FOREVER),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_FOREVER),
            "avoid_ros_namespace_conventions": False,
        }
    ]


def qos_text(latched: bool) -> str:
    """The QoS profiles of a topic as YAML text, the form that an MCAP channel has."""
    return _yaml(qos_profiles(latched)).strip()


def metadata_text(
    file_name: str, topics: Sequence[BagTopic], first_ns: int, last_ns: int, custom: Mapping[str, str]
) -> str:
    """The whole ``metadata.yaml``.

    Args:
        file_name: MCAP file in the same folder.
        topics: In the order of the bag's channels.
        first_ns: Simulated time of the first message.
        last_ns: Simulated time of the last message.
        custom: Further entries; ``ros2 bag info`` shows them as custom data.
    """
    count = sum(topic.message_count for topic in topics)
    span: dict[str, Any] = {
        "duration": {"nanoseconds": last_ns - first_ns},
        "starting_time": {"nanoseconds_since_epoch": first_ns},
        "message_count": count,
    }
    information = {
        "version": VERSION,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": [_topic_entry(topic) for topic in topics],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, "starting_time": span["starting_time"], "duration": span["duration"]}],
        "custom_data": dict(sorted(custom.items())) or None,
        "ros_distro": "jazzy",
    }
    information["files"][0]["message_count"] = count
    return _yaml({"rosbag2_bagfile_information": information})


def read_message_counts(bag: Path) -> dict[str, int]:
    """Messages per topic of a closed bag, from its ``metadata.yaml``.

    Raises:
        BagError: There is no readable metadata.
    """
    try:
        topics = read_metadata(bag)["topics_with_message_count"]
        return {topic["topic_metadata"]["name"]: int(topic["message_count"]) for topic in topics}
    except (KeyError, TypeError, ValueError) as error:
        raise BagError(str(bag), f"a bag with a readable {METADATA_FILE}") from error


def read_metadata(bag: Path) -> dict[str, Any]:
    """The content of a bag's ``metadata.yaml``.

    Raises:
        BagError: The file is missing, too large, not YAML, has aliases, or lacks the bag's information.
    """
    file = bag / METADATA_FILE
    try:
        if file.stat().st_size > MAX_METADATA_BYTES:
            raise BagError(str(bag), f"a bag with a {METADATA_FILE} of at most {MAX_METADATA_BYTES} bytes")
        text = file.read_text(encoding="utf-8")
        information = plain_yaml.load(text)["rosbag2_bagfile_information"]
    except yaml.YAMLError as error:
        raise BagError(str(bag), f"a bag with a readable {METADATA_FILE} ({plain_yaml.reason_of(error)})") from error
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise BagError(str(bag), f"a bag with a readable {METADATA_FILE}") from error
    if not isinstance(information, dict):
        raise BagError(str(bag), f"a bag with a readable {METADATA_FILE}")
    return information


def _topic_entry(topic: BagTopic) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type_name,
            "serialization_format": "cdr",
            "offered_qos_profiles": qos_profiles(topic.latched),
            "type_description_hash": topic.type_hash,
        },
        "message_count": topic.message_count,
    }


class _PlainDumper(yaml.SafeDumper):
    """Writes equal values again instead of YAML anchors, so that any reader can read them."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 # PyYAML's signature
        return True


def _yaml(value: object) -> str:
    return yaml.dump(value, Dumper=_PlainDumper, sort_keys=False, default_flow_style=False, allow_unicode=True)
