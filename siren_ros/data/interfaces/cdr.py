"""Writes CDR directly from numbers and texts, for messages with many small parts.

A message object for each part, and a call for each of its fields, cost more than everything else that is done with such
a message. The bytes are those that ``encode_cdr`` makes of the objects.
"""

import struct
from functools import cache
from typing import Final

from siren_ros.base.numerics.units import NS_PER_S, time_ns_of_step

_ENCAPSULATION: Final = b"\x00\x01\x00\x00"
"""CDR header for little-endian data."""
_TEXT: Final = "s"
_WORD_BYTES: Final = 4
_LARGEST_BYTES: Final = 8


@cache
def text(value: str) -> bytes:
    """A text as a message field, with its length. Results are cached, for texts that repeat."""
    return text_once(value)


def text_once(value: str) -> bytes:
    """A text as a message field, like ``text`` but without the cache, for texts that change in every message."""
    content = value.encode() + b"\0"
    return struct.pack("<I", len(content)) + content


STAMPED: Final = "i I s "
"""Field kinds of a ``std_msgs/Header``."""


def stamped(step: int, frame_id: str) -> tuple[int, int, bytes]:
    """The fields of ``std_msgs/Header`` at a step."""
    return (*divmod(time_ns_of_step(step), NS_PER_S), text(frame_id))


class Layout:
    """A group of consecutive fields of a message.

    >>> Layout("B s d").pack(0, 1, text("a"), 0.5).hex(" ", 4)
    '01000000 02000000 61000000 00000000 00000000 0000e03f'
    """

    def __init__(self, fields: str) -> None:
        """Parse the kinds of the fields, separated by spaces: letters of ``struct``, with an optional count.

        ``s`` is a text.
        """
        repeated = [(kind[:-1] or "1", kind[-1]) for kind in fields.split()]
        self._kinds = tuple(letter for count, letter in repeated for _ in range(int(count)))
        self._texts = tuple(place for place, letter in enumerate(self._kinds) if letter == _TEXT)
        self._structs: dict[tuple[int, ...], struct.Struct] = {}

    def pack(self, offset: int, *values: float | bytes) -> bytes:
        """Encode the fields with the padding between them, for this offset in the message's body."""
        lengths = [len(values[place]) for place in self._texts]  # type: ignore[arg-type] # bytes stand there
        key = (offset % _LARGEST_BYTES, *lengths)
        packer = self._structs.get(key)
        if packer is None:
            packer = self._structs[key] = self._packer(*key)
        return packer.pack(*values)

    def _packer(self, offset: int, *lengths: int) -> struct.Struct:
        left, parts, place = list(lengths), ["<"], offset
        for letter in self._kinds:
            is_text = letter == _TEXT
            size = left.pop(0) if is_text else struct.calcsize(f"<{letter}")
            padding = -place % (_WORD_BYTES if is_text else size)
            parts.append(f"{padding}x{size}s" if is_text else f"{padding}x{letter}")
            place += padding + size
        return struct.Struct("".join(parts))


COUNT: Final = Layout("I")
"""Length of the sequence that follows."""


class CdrWriter:
    """Builds one message from its first field to its last."""

    def __init__(self) -> None:
        self._parts = [_ENCAPSULATION]
        self._size = 0

    def put(self, layout: Layout, *values: float | bytes) -> None:
        """Append fields."""
        part = layout.pack(self._size, *values)
        self._parts.append(part)
        self._size += len(part)

    def cdr(self) -> bytes:
        """The complete message, padded to a multiple of four bytes."""
        return b"".join((*self._parts, bytes(-self._size % _WORD_BYTES)))
