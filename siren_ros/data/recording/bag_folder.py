"""The folder of a bag: its place, its ``metadata.yaml``, and the locked working folder in which it grows at first.

Layout of ``metadata.yaml``: https://github.com/ros2/rosbag2 (``rosbag2_storage``, ``yaml.hpp``), release Jazzy.
"""

import errno
import fcntl
import os
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from io import FileIO
from pathlib import Path
from typing import Any, Final

import yaml
from mcap.records import Channel

from siren_ros.base.params import parameters
from siren_ros.data.interfaces.topics import EPISODE
from siren_ros.errors import BagError
from siren_ros.simulation.scenario.episode import EpisodeDescription
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import NO_ACTOR

METADATA_FILE: Final = "metadata.yaml"
VERSION: Final = 9
MAX_METADATA_BYTES: Final = 1_000_000
_FOREVER: Final = {"sec": 9223372036, "nsec": 854775807}
"""rosbag2's notation for an unlimited duration."""
PARTIAL_SUFFIX: Final = ".partial"
RESERVE_FILE: Final = ".reserve"
RESERVE_BYTES: Final = 1_000_000
"""Disk space reserved so that a bag can be completed on a full disk."""
_COPY_BYTES: Final = 1 << 20


@dataclass(frozen=True)
class BagTopic:
    """One topic of a bag as the metadata lists it."""

    name: str
    type_name: str
    type_hash: str
    """Hash of the type by REP 2016, ``RIHS01_…``."""
    latched: bool
    message_count: int

    @classmethod
    def of_channel(cls, channel: Channel, type_name: str, message_count: int) -> "BagTopic":
        """A topic with the data of its MCAP channel."""
        type_hash = channel.metadata.get("topic_type_hash", "")
        return cls(channel.topic, type_name, type_hash, is_latched(channel), message_count)


def bag_path(template_id: str, level: EmergencyLevel, seed: int, map_file: str, *, has_av: bool) -> Path:
    """Default folder of a bag: ``bags/S2_L2_seed0``, with the map's name if a map is given."""
    parts = [template_id, level.name, f"seed{seed}"]
    if map_file:
        parts.append(Path(map_file).name.split(".")[0])
    if has_av:
        parts.append("av")
    return Path("bags") / "_".join(parts)


def default_bag_path_of(episode: EpisodeDescription) -> Path:
    """``bag_path`` for the request that an episode was made from."""
    map_file = str(episode.asked.get("map", ""))
    return bag_path(episode.template, episode.level, episode.seed, map_file, has_av=episode.av_id != NO_ACTOR)


def default_kitti_path(bag: Path) -> Path:
    """Folder of an episode's KITTI export: next to its bag, with the suffix ``_kitti``."""
    return bag.with_name(f"{bag.name}_kitti")


def is_latched(channel: Channel) -> bool:
    """Whether the publishers of a channel were transient local."""
    return "transient_local" in channel.metadata.get("offered_qos_profiles", "")


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


@cache
def qos_text(latched: bool) -> str:
    """The QoS profiles of a topic as YAML text, the form that an MCAP channel has."""
    return _yaml(qos_profiles(latched)).strip()


def metadata_text(
    file_name: str, topics: Sequence[BagTopic], first_ns: int, last_ns: int, custom: Mapping[str, str]
) -> str:
    """The whole ``metadata.yaml``; topics in the order of the bag's channels, and simulated times.

    ``custom`` holds further entries, which ``ros2 bag info`` shows as custom data.
    """
    count = sum(topic.message_count for topic in topics)
    start, duration = {"nanoseconds_since_epoch": first_ns}, {"nanoseconds": last_ns - first_ns}
    entries = [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type_name,
                "serialization_format": "cdr",
                "offered_qos_profiles": qos_profiles(topic.latched),
                "type_description_hash": topic.type_hash,
            },
            "message_count": topic.message_count,
        }
        for topic in topics
    ]
    information = {
        "version": VERSION,
        "storage_identifier": "mcap",
        "duration": duration,
        "starting_time": start,
        "message_count": count,
        "topics_with_message_count": entries,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, "starting_time": start, "duration": duration, "message_count": count}],
        "custom_data": dict(sorted(custom.items())) or None,
        "ros_distro": "jazzy",
    }
    return _yaml({"rosbag2_bagfile_information": information})


def read_message_counts(bag: Path) -> dict[str, int]:
    """Number of messages per topic of a closed bag, from its ``metadata.yaml``.

    Raises BagError: there is no readable metadata.
    """
    try:
        topics = read_metadata(bag)["topics_with_message_count"]
        return {topic["topic_metadata"]["name"]: int(topic["message_count"]) for topic in topics}
    except (KeyError, TypeError, ValueError) as error:
        raise BagError(str(bag), f"a bag with a readable {METADATA_FILE}") from error


def read_metadata(bag: Path) -> dict[str, Any]:
    """The content of a bag's ``metadata.yaml``.

    Raises BagError: the file is missing, too large, not YAML, has aliases, or lacks the bag's information.
    """
    file = bag / METADATA_FILE
    try:
        if file.stat().st_size > MAX_METADATA_BYTES:
            raise BagError(str(bag), f"a bag with a {METADATA_FILE} of at most {MAX_METADATA_BYTES} bytes")
        text = file.read_text(encoding="utf-8")
        information = parameters.load_yaml(text)["rosbag2_bagfile_information"]
    except yaml.YAMLError as error:
        raise BagError(str(bag), f"a bag with a readable {METADATA_FILE} ({parameters.yaml_fault(error)})") from error
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise BagError(str(bag), f"a bag with a readable {METADATA_FILE}") from error
    if not isinstance(information, dict):
        raise BagError(str(bag), f"a bag with a readable {METADATA_FILE}")
    return information


class _PlainDumper(yaml.SafeDumper):
    """Repeats equal values instead of YAML anchors, so that every reader can read the file."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 # PyYAML's signature
        return True


def _yaml(value: object) -> str:
    return yaml.dump(value, Dumper=_PlainDumper, sort_keys=False, default_flow_style=False, allow_unicode=True)


def working_path(bag: Path) -> Path:
    """The folder in which a bag is written before it has its final name."""
    return bag.parent / f".{bag.name}{PARTIAL_SUFFIX}"


def free_partial_path(bag: Path) -> Path:
    """The first name among ``NAME.partial``, ``NAME.partial-2``, … that does not exist."""
    candidate = bag.with_name(bag.name + PARTIAL_SUFFIX)
    number = 2
    while os.path.lexists(candidate):
        candidate = bag.with_name(f"{bag.name}{PARTIAL_SUFFIX}-{number}")
        number += 1
    return candidate


def is_episode_bag(folder: Path) -> bool:
    """Whether a folder is a bag of an episode and contains nothing else."""
    if folder.is_symlink():
        return False
    try:
        information = read_metadata(folder)
        files = {METADATA_FILE, *information["relative_file_paths"]}
        recorded = EPISODE.name in read_message_counts(folder)
        there = {path.name: path.is_file() for path in folder.iterdir()}
        return recorded and files == set(there) and all(there.values())
    except (BagError, OSError, KeyError, TypeError):
        return False


def check_new_bag(bag: Path, *, overwrite: bool = False) -> None:
    """Check that a bag can be moved to this path at the end of the episode.

    With ``overwrite`` the bag of an earlier episode may be there, which then gives way.

    Raises BagError: something is there already, be it a link that leads nowhere; or the system does not take the name,
    or the longer names that the bag has while it grows.
    """
    replaces = overwrite and is_episode_bag(bag)
    try:
        bag.name.encode()
        for path in (bag, working_path(bag) / f"{bag.name}_0.mcap"):
            with suppress(FileNotFoundError):
                path.lstat()
                if path == bag and not replaces:
                    raise BagError(str(bag), f"the path of a new folder; {_what_is_at(bag, overwrite)}")
    except UnicodeEncodeError as error:
        raise BagError(str(bag), "a path in UTF-8") from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BagError(str(bag), f"a place that can be written ({reason})") from error


def _what_is_at(bag: Path, overwrite: bool) -> str:
    if not bag.exists():
        return "a link that leads nowhere is there"
    if is_episode_bag(bag):
        helps = "overwrite (overwrite:=true, --overwrite) replaces this episode"
        return f"{helps}, and `siren replay {bag} --check` makes it again and compares"
    return "this one exists already" + (", and is not the bag of an episode alone" if overwrite else "")


def lock(file: FileIO) -> bool:
    """Take the writer's lock on a storage file; False if another process has it.

    The kernel releases the lock when the process ends, in any way.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


class WorkingFolder:
    """The folder ``.NAME.partial`` next to a bag's final place, with the storage file in it."""

    def __init__(self, bag: Path, file_name: str, *, overwrite: bool = False) -> None:
        """Create the folder. An existing folder of a killed writer is renamed to a partial name.

        Raises BagError: the bag exists, unless ``overwrite`` lets it replace an episode; another episode writes it now,
        or the place cannot be written.
        """
        self._overwrite = overwrite
        self.path = working_path(bag)
        self._bag = bag
        self._file_path = self.path / file_name
        check_new_bag(bag, overwrite=overwrite)
        try:
            bag.parent.mkdir(parents=True, exist_ok=True)
            self._set_aside_orphan()
            self.path.mkdir()
            # Reading is allowed too, because `restore` copies from this file.
            self.file = self._file_path.open("w+b", buffering=0)
            lock(self.file)
            self._reserve()
        except OSError as error:
            raise BagError(str(bag), f"a place that can be written ({error.strerror or error})") from error

    def _set_aside_orphan(self) -> None:
        if not self.path.exists():
            return
        if self._file_path.exists():
            with self._file_path.open("rb", buffering=0) as held:
                if not lock(held):
                    raise BagError(str(self._bag), "a bag that no other episode is writing now")
        self.path.rename(free_partial_path(self._bag))

    def _reserve(self) -> None:
        try:
            with (self.path / RESERVE_FILE).open("wb", buffering=0) as reserve:
                os.posix_fallocate(reserve.fileno(), 0, RESERVE_BYTES)
        except OSError:
            self.remove()
            raise

    def free_reserve(self) -> None:
        """Free the reserved space."""
        with suppress(OSError):
            (self.path / RESERVE_FILE).unlink()

    def is_there(self) -> bool:
        """Whether the path still leads to the open storage file."""
        try:
            at_path, opened = self._file_path.stat(), os.fstat(self.file.fileno())
        except OSError:
            return False
        return (at_path.st_dev, at_path.st_ino) == (opened.st_dev, opened.st_ino)

    def check(self) -> None:
        """Raise OSError if the folder has been removed."""
        if not self.is_there():
            raise FileNotFoundError(errno.ENOENT, "its folder has disappeared while it was written", str(self.path))

    def restore(self) -> None:
        """Write the storage file again from its open handle, if the folder has been removed."""
        if self.is_there():
            return
        self.path.mkdir(parents=True, exist_ok=True)
        self.file.seek(0)
        with self._file_path.open("wb") as copy:
            shutil.copyfileobj(self.file, copy, _COPY_BYTES)

    def close(self, metadata: str) -> None:
        """Close the storage file and write the metadata."""
        if not self.file.closed:
            os.fsync(self.file.fileno())
            self.file.close()
        self.free_reserve()
        (self.path / METADATA_FILE).write_text(metadata, encoding="utf-8")

    def move_to(self, target: Path) -> Path:
        """Move the folder; OSError if the target cannot be made, or exists and may not be replaced."""
        if self._overwrite and is_episode_bag(target):
            shutil.rmtree(target)
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target))
        self.path.rename(target)
        return target

    def remove(self) -> None:
        """Remove the folder, and its parent if that is empty."""
        self.file.close()
        self.free_reserve()
        with suppress(OSError):
            self._file_path.unlink()
            self.path.rmdir()
            self._bag.parent.rmdir()
