"""``ros2 bag info``."""

import argparse
from datetime import UTC, datetime
from pathlib import Path

from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2 import Reader

from small_ros2.bag_reading import open_bag

NS_PER_S = 1_000_000_000
SUFFIXES = {".mcap": "mcap", ".db3": "sqlite3"}


def storage_files(path: Path) -> list[Path]:
    """The storage files of a bag, sorted."""
    return sorted(file for file in path.iterdir() if file.suffix in SUFFIXES) if path.is_dir() else [path]


def size_text(size: int) -> str:
    """A size in the unit that suits it."""
    value = float(size)
    for unit in ("B", "KiB", "MiB"):
        if value < 1024.0:
            return f"{value:.1f} {unit}"
        value /= 1024.0
    return f"{value:.1f} GiB"


def stamp_text(time_ns: int) -> str:
    """A time of the bag as a date and in seconds."""
    date = datetime.fromtimestamp(time_ns // NS_PER_S, tz=UTC)
    return f"{date:%b %d %Y %H:%M:%S}.{time_ns % NS_PER_S:09d} ({time_ns / NS_PER_S:.9f})"


def report(path: Path, reader: Reader) -> list[str]:
    """The lines that describe an open bag."""
    files = storage_files(path)
    empty = reader.message_count == 0
    lines = [
        f"Files:             {', '.join(file.name for file in files)}",
        f"Bag size:          {size_text(sum(file.stat().st_size for file in files))}",
        f"Storage id:        {', '.join(sorted({SUFFIXES[file.suffix] for file in files}))}",
        f"ROS Distro:        {reader.ros_distro or 'unknown'}",
        f"Duration:          {0.0 if empty else reader.duration / NS_PER_S:.9f}s",
        f"Start:             {'-' if empty else stamp_text(reader.start_time)}",
        f"End:               {'-' if empty else stamp_text(reader.start_time + reader.duration)}",
        f"Messages:          {reader.message_count}",
    ]
    label = "Topic information: "
    for connection in sorted(reader.connections, key=lambda connection: (connection.topic, connection.id)):
        form = connection.ext.serialization_format if isinstance(connection.ext, ConnectionExtRosbag2) else "unknown"
        lines.append(
            f"{label}Topic: {connection.topic} | Type: {connection.msgtype} | Count: {connection.msgcount}"
            f" | Serialization Format: {form}"
        )
        label = " " * len(label)
    return lines


def info(arguments: argparse.Namespace) -> int:
    """Prints what a bag holds."""
    with open_bag(arguments.bag) as reader:
        print("\n".join(report(Path(arguments.bag), reader)))
    return 0
