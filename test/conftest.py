"""Fixtures that several folders of tests share: messages without ROS, and a synthetic episode."""

from collections.abc import Callable
from pathlib import Path

import pytest
from rosbags.typesys.store import Typestore

from siren_ros.interfaces.rosbags_factory import RosbagsFactory, load_typestore

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def typestore() -> Typestore:
    """All message types of the node graph."""
    return load_typestore(
        {
            "siren_msgs": REPOSITORY / "msg_defs" / "msg",
            "vision_msgs": REPOSITORY / "tools" / "environment" / "interfaces" / "vision_msgs" / "msg",
        }
    )


@pytest.fixture(scope="session")
def factory(typestore: Typestore) -> RosbagsFactory:
    return RosbagsFactory(typestore)


@pytest.fixture(scope="session")
def round_trip(typestore: Typestore) -> Callable[[object], object]:
    """Serialises a message and reads it back."""

    def through_cdr(message: object) -> object:
        name: str = message.__msgtype__  # type: ignore[attr-defined] # rosbags' generated classes
        return typestore.deserialize_cdr(typestore.serialize_cdr(message, name), name)

    return through_cdr
