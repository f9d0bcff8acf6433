"""Messages without a ROS installation: the ``rosbags`` types, for tools that work on bags."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore


def load_typestore(message_folders: dict[str, Path]) -> Typestore:
    """ROS 2 Jazzy's types plus the ``.msg`` files of further packages.

    Args:
        message_folders: Folder of ``.msg`` files by package name.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    for package, folder in sorted(message_folders.items()):
        for path in sorted(folder.glob("*.msg")):
            store.register(get_types_from_msg(path.read_text(encoding="utf-8"), f"{package}/msg/{path.stem}"))
    store.get_msgdef = cache(store.get_msgdef)  # type: ignore[method-assign]  # asked for at every nested message
    return store


class RosbagsFactory:
    """``MessageFactory`` over a rosbags type store."""

    def __init__(self, store: Typestore) -> None:
        self.store = store
        self._type = cache(lambda name: store.types[name])

    def make(self, type_name: str, **fields: Any) -> Any:
        """A message with all its fields set."""
        return self._type(type_name)(**fields)

    def sequence(self, values: npt.NDArray[np.generic]) -> Any:
        """A primitive sequence field: the array itself."""
        return np.ascontiguousarray(values)
