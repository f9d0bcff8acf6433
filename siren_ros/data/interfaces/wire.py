"""Messages as CDR bytes: written directly, encoded and decoded without rclpy's message objects.

Publishers give Fast DDS the finished CDR, and subscribers take it raw. The wire format is the standard one, so any
ROS 2 program reads it. There are two reasons. The padding between fields is zero; rclpy's serialiser leaves old memory
there, so that bags would differ. And numpy arrays are not copied element by element: a sweep of 55,000 points takes
0.1 ms instead of 2 ms.

Messages with many small parts are written from numbers and texts (``CdrWriter``). A message object for each part, and
a call for each of its fields, cost more than everything else that is done with such a message. The bytes are those
that ``encode_cdr`` makes of the objects.
"""

import struct
from collections import deque
from collections.abc import Callable
from functools import cache
from typing import Any, Final, NamedTuple, TypeVar, cast

from siren_ros.base.numerics.units import NS_PER_S, STEP_NS, time_ns_of_step
from siren_ros.data.interfaces.messages import check_stamp, decode_cdr, encode_cdr, time_ns_of, typestore
from siren_ros.data.interfaces.topics import Topic
from siren_ros.errors import EpisodeError, SirenError

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


class Sent(NamedTuple):
    """Replaces a message that this process itself has sent; a receiver in this process needs no conversion."""

    step: int
    content: Any
    """The content of the message, in the library's types."""


KEPT: Final = 8
"""Number of sent messages per topic that are remembered. All nodes of a process report a step on the same topic, so
several messages may be sent before one is received."""
_known: Final[dict[str, deque[tuple[bytes, Sent]]]] = {}
"""Sent messages by topic, with their bytes."""
_decoded: Final[dict[str, tuple[bytes, Any]]] = {}
"""The message decoded last on each topic, with its bytes."""
_read: Final[dict[Callable[[Any], Any], deque[tuple[Any, Any]]]] = {}
"""The last two results of each conversion with their messages; two, because both topics of commands have one type."""
Content = TypeVar("Content")


def get_ready(topic: Topic) -> None:
    """Compile the encoder and decoder of a topic's messages, so that the first step does not have to."""
    typestore().get_msgdef(topic.type_name)


def encode(topic: Topic, message: Any) -> bytes:
    """Encode a message as CDR, padded to a multiple of four bytes, so that its bytes are the same everywhere."""
    return encode_cdr(typestore(), topic, message)


def encode_content(topic: Topic, step: int, content: Content, write: Callable[[Content], Any]) -> bytes:
    """Encode the message that ``write`` makes; receivers in this process get the content itself.

    Nobody may change the content afterwards, nor its arrays.
    """
    cdr = encode(topic, write(content))
    if topic.name not in _known:
        _known[topic.name] = deque(maxlen=KEPT)
    _known[topic.name].append((cdr, Sent(step, content)))
    return cdr


def decode(topic: Topic, cdr: bytes) -> Any:
    """Decode a CDR; arrays of the message share its bytes, so do not write to them.

    If several nodes of one process subscribe to a topic, the message is decoded once. One that this process has sent
    is not decoded at all: it is ``Sent``, for ``content`` alone.

    Raises:
        EpisodeError: The bytes are no message of the topic's type; another program may have published them.
    """
    for known, sent in _known.get(topic.name, ()):
        if known == cdr:
            return sent
    last = _decoded.get(topic.name)
    if last is not None and last[0] == cdr:
        return last[1]
    message = decode_cdr(typestore(), topic, cdr)
    _decoded[topic.name] = cdr, message
    return message


def content(read: Callable[[Any], Content], message: Any) -> Content:
    """Convert a message to the library's types; a repeated call with the same message returns the first result.

    Args:
        read: A conversion of ``siren_ros.data.interfaces``; its arrays are read-only.
        message: The message as ``decode`` gives it.

    Raises:
        InputError: As ``read``.
    """
    if isinstance(message, Sent):
        return cast("Content", message.content)
    known = _read.setdefault(read, deque(maxlen=2))
    for earlier, value in known:
        if earlier is message:
            return cast("Content", value)
    known.append((message, read(message)))
    return cast("Content", known[-1][1])


def step_of_message(topic: Topic, message: Any) -> int:
    """Step of a message, from its field ``step`` or its stamp; for a message of frames, the stamp of the first one.

    Raises:
        EpisodeError: The stamp is not the time of a step; another program may have made the message.
    """
    step = getattr(message, "step", None)
    if step is not None:
        return int(step)
    transforms = getattr(message, "transforms", None)
    if transforms is not None and not len(transforms):
        raise EpisodeError(f"{topic.name}: a message without frames has no stamp")
    stamped = message if transforms is None else transforms[0]
    time = getattr(stamped, "clock", None) or getattr(stamped, "stamp", None) or stamped.header.stamp
    try:
        step = time_ns_of(time) // STEP_NS
        check_stamp(time, step)
    except SirenError as error:
        raise EpisodeError(f"{topic.name}: {error}") from error
    return step
