"""Message types of the installation, and what all conversions build on."""

from pathlib import Path

import numpy as np
import pytest
from repository import REPOSITORY

from siren_ros.errors import InputError
from siren_ros.interfaces import messages


@pytest.mark.parametrize("time_ns", [0, 50_000_000, 1_000_000_000, 2_999_999_999])
def test_a_stamp_comes_back(time_ns: int) -> None:
    message = messages.stamp(time_ns)
    assert messages.time_ns_of(message) == time_ns
    assert 0 <= message.nanosec < 10**9


def test_the_installed_definitions_are_those_of_the_repository() -> None:
    sources = {
        "siren_msgs": REPOSITORY / "msg_defs" / "msg",
        "vision_msgs": REPOSITORY / "tools" / "environment" / "interfaces" / "vision_msgs" / "msg",
    }
    written = messages.load_typestore(sources)
    names = [f"{package}/msg/{path.stem}" for package, folder in sources.items() for path in folder.glob("*.msg")]
    assert names
    assert [written.generate_msgdef(name) for name in names] == [
        messages.typestore().generate_msgdef(name) for name in names
    ]


def test_a_package_is_looked_for_in_every_prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "b" / "share" / "own_msgs" / "msg"
    folder.mkdir(parents=True)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'a'}:{tmp_path / 'b'}")
    assert messages.message_folder("own_msgs") == folder
    with pytest.raises(InputError, match="other_msgs"):
        messages.message_folder("other_msgs")


def test_arrays_are_read_only_copies() -> None:
    values = np.arange(3, dtype=np.uint32)
    message = messages.make_message("std_msgs/msg/UInt32MultiArray", layout=None, data=values)
    arrays = messages.as_arrays(message, {"data": np.float64})
    values[0] = 7
    assert arrays["data"].tolist() == [0.0, 1.0, 2.0]
    assert not arrays["data"].flags.writeable


def test_a_sequence_lies_in_one_piece() -> None:
    columns = np.arange(6).reshape(3, 2)[:, 0]
    assert messages.sequence(columns).flags.c_contiguous
    assert messages.sequence(columns).tolist() == [0, 2, 4]
