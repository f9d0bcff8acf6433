"""Opens bags, with one clear line for those that cannot be opened."""

from collections.abc import Iterator
from contextlib import contextmanager

from rosbags.rosbag2 import Reader, ReaderError

from small_ros2.errors import CommandError


@contextmanager
def open_bag(path: str) -> Iterator[Reader]:
    """An open reader of a rosbag2 folder or storage file.

    Raises:
        CommandError: There is no readable bag.
    """
    try:
        reader = Reader(path)
        reader.open()
    except (ReaderError, OSError) as error:
        raise CommandError(f"'{path}' is not a readable bag: {error}") from error
    try:
        yield reader
    finally:
        reader.close()
