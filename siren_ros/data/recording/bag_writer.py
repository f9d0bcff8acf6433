"""Writes an episode's bag in a background thread: rosbag2 version 9, MCAP with zstd chunks.

A partial bag has a name of its own.
"""

import errno
import queue
import threading
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from mcap.records import Channel, Schema
from rosbags.typesys.store import Typestore

from siren_ros.base.numerics.arrays import Brief
from siren_ros.data.recording.bag_folder import BagTopic, WorkingFolder, free_partial_path, metadata_text, qos_text
from siren_ros.data.recording.mcap_files import (
    ChannelMessage,
    ChunkContent,
    McapStream,
    definitions_bytes,
    message_bytes,
)
from siren_ros.errors import EpisodeError

END_KEY: Final = "siren_end"
REASON_KEY: Final = "siren_reason"
REPEAT_CHUNKS: Final = 64
"""Every 64th chunk, and every chunk after new definitions, repeats all definitions. In a cut-off bag, a damaged chunk
then makes no other chunk unreadable."""
_CAUSES: Final = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk's quota is used up",
    errno.EFBIG: "the limit on the size of files is reached",
}


class BackgroundWorker:
    """Calls ``work(item)`` for each item, in order, in a thread of its own.

    ``put`` waits while the queue is full, so that memory stays bounded. The first exception that
    ``work`` raises is raised again by the next ``put`` or by ``close``; items after it are dropped.
    """

    def __init__(self, work: Callable[[Any], None], capacity: int, name: str) -> None:
        self._work = work
        self._queue: queue.Queue[tuple[Any] | None] = queue.Queue(capacity)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while (entry := self._queue.get()) is not None:
            if self._error is not None:
                continue
            try:
                self._work(entry[0])
            except BaseException as error:  # noqa: BLE001 # handed over to the caller's thread
                self._error = error

    def put(self, item: Any) -> None:
        """Hand over an item; raises an error of an earlier item."""
        self._raise()
        self._queue.put((item,))

    def close(self) -> None:
        """Wait until all items are done and end the thread; raises an error of an item."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()
        self._raise()

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error


@dataclass(frozen=True)
class BagOptions:
    """Settings of a bag's writer: chunk size, memory, and whether it may replace an earlier bag."""

    chunk_bytes: int = 64_000
    """Largest uncompressed size of a chunk with several messages; a larger message gets a chunk of its own. Damage of a
    chunk loses all of its messages."""
    chunk_ns: int = 1_000_000_000
    """A chunk is closed after this simulated time, however small it is."""
    queued_chunks: int = 8
    """Number of chunks that may wait for the writing thread; it bounds the memory."""
    overwrite: bool = False
    """Whether the finished bag may replace the bag of an earlier episode."""


@dataclass(frozen=True)
class BagSummary(Brief):
    """Statistics of a closed bag."""

    path: Path
    size_bytes: int
    message_counts: dict[str, int]


@dataclass
class _OpenChannel:
    record: Channel
    schema: Schema
    latched: bool
    count: int = 0


@dataclass
class _PendingChunk:
    """Content of the chunk that is being filled."""

    schemas: list[Schema] = field(default_factory=list)
    channels: list[Channel] = field(default_factory=list)
    messages: list[ChannelMessage] = field(default_factory=list)
    size_bytes: int = 0
    first_ns: int = 0
    defines: bool = False
    """Whether the chunk has definitions that no earlier chunk has."""
    latched: bool = False
    """Whether the chunk holds latched messages, which have chunks of their own."""


class EpisodeBagWriter:
    """Writes one bag. ``finish`` moves it to its final name, ``abandon`` to a partial name.

    Until then the bag is the folder ``.NAME.partial`` next to its final place, locked against other
    writers. A second thread compresses and writes; an error there is raised by the next call.
    """

    def __init__(
        self, path: Path, store: Typestore, latched: Collection[str] = (), options: BagOptions | None = None
    ) -> None:
        """Open the bag; ``latched`` names its transient local topics.

        Raises BagError: the folder exists, another episode writes it now, or the place cannot be written.
        """
        self._path = path
        self._store = store
        self._latched = frozenset(latched)
        self._options = options or BagOptions()
        self._file_name = f"{path.name}_0.mcap"
        self._folder = WorkingFolder(path, self._file_name, overwrite=self._options.overwrite)
        self._channels: dict[str, _OpenChannel] = {}
        self._schemas: dict[str, Schema] = {}
        self._pending = _PendingChunk()
        self._copies: list[ChannelMessage] = []
        self._latest_ns = -1
        self._chunks = 0
        self._stream = McapStream(self._folder.file)
        self._worker = BackgroundWorker(self._stream.write_chunk, self._options.queued_chunks, "bag writer")
        self._closed = False

    def write(self, topic: str, type_name: str, cdr: bytes | memoryview, time_ns: int) -> None:
        """Add a serialised message with its encapsulation header; the first message of a topic opens its channel.

        Log time and publish time are the simulated time. A memoryview is copied. Raises EpisodeError: an earlier
        message could not be written: the disk is full, or the folder is gone.
        """
        data = cdr if isinstance(cdr, bytes) else bytes(cdr)
        if time_ns > self._latest_ns:
            try:
                self._folder.check()
            except OSError as error:
                raise self._lost(error) from error
        channel = self._channels.get(topic) or self._new_channel(topic, type_name)
        new_channels = () if topic in self._channels else (channel.record,)
        new_schemas = () if type_name in self._schemas else (channel.schema,)
        size = message_bytes(data) + (definitions_bytes(new_schemas, new_channels) if new_channels else 0)
        beyond = self._pending.size_bytes + size > self._options.chunk_bytes
        if self._pending.messages and (beyond or self._pending.latched != channel.latched):
            self._hand_over()
        pending = self._pending
        if not pending.messages:
            pending.first_ns, pending.latched = time_ns, channel.latched
        if new_channels:
            self._channels[topic], self._schemas[type_name] = channel, channel.schema
            pending.schemas += new_schemas
            pending.channels += new_channels
            pending.defines = True
        message = ChannelMessage(channel.record.id, channel.count, time_ns, data)
        pending.messages.append(message)
        pending.size_bytes += size
        if channel.latched:
            self._copies.append(message)
        channel.count += 1
        self._latest_ns = max(self._latest_ns, time_ns)
        old = time_ns - pending.first_ns >= self._options.chunk_ns
        if old or pending.size_bytes >= self._options.chunk_bytes:
            self._hand_over()

    def _new_channel(self, topic: str, type_name: str) -> _OpenChannel:
        schema = self._schemas.get(type_name)
        if schema is None:
            text, _ = self._store.generate_msgdef(type_name, ros_version=2)
            schema = Schema(id=len(self._schemas) + 1, name=type_name, encoding="ros2msg", data=text.encode())
        latched, number = topic in self._latched, len(self._channels) + 1
        metadata = {"offered_qos_profiles": qos_text(latched), "topic_type_hash": self._store.hash_rihs01(type_name)}
        record = Channel(id=number, topic=topic, message_encoding="cdr", schema_id=schema.id, metadata=metadata)
        return _OpenChannel(record, schema, latched)

    def _hand_over(self) -> None:
        pending, self._pending = self._pending, _PendingChunk()
        if not pending.messages:
            return
        self._chunks += 1
        if pending.defines or self._chunks % REPEAT_CHUNKS == 0:
            self._pending.schemas += self._schemas.values()
            self._pending.channels += (channel.record for channel in self._channels.values())
            self._pending.size_bytes = definitions_bytes(self._pending.schemas, self._pending.channels)
        content = ChunkContent(tuple(pending.schemas), tuple(pending.channels), tuple(pending.messages))
        try:
            self._worker.put(content)
        except OSError as error:
            raise self._lost(error) from error

    def _end_with_copies(self) -> None:
        written = self._stream.counts
        self._stream.attach_copies([item for item in self._copies if item.sequence < written.get(item.channel_id, 0)])
        self._stream.finish()

    def _lost(self, error: OSError) -> EpisodeError:
        cause = _CAUSES.get(error.errno or 0) or error.strerror or str(error)
        return EpisodeError(f"the bag {self._path} cannot be written: {cause}")

    def finish(self) -> BagSummary:
        """Complete the bag and move it to its final name.

        Raises EpisodeError: it cannot be written or moved; the partial bag stays where ``abandon`` puts it.
        """
        try:
            self._hand_over()
            self._worker.close()
            self._end_with_copies()
            self._folder.check()
            self._folder.close(self._metadata("complete"))
            self._folder.move_to(self._path)
        except OSError as error:
            raise self._lost(error) from error
        self._closed = True
        return self._summary(self._path)

    def abandon(self, reason: str) -> BagSummary:
        """Keep the messages so far as a readable bag with a partial name; its metadata contains the reason.

        Never raises: where the disk refuses even the end of the file, the chunks written so far stay.
        """
        if self._closed:
            return self._summary(self._path)
        self._closed = True
        with suppress(OSError, EpisodeError):
            self._hand_over()
        with suppress(OSError):
            self._worker.close()
        self._folder.free_reserve()
        for end in (self._end_with_copies, self._stream.finish):
            with suppress(OSError, ValueError):
                self._stream.rewind()
                end()
                break
        with suppress(OSError, ValueError):
            self._folder.restore()
        with suppress(OSError, ValueError):
            self._folder.close(self._metadata("partial", **{REASON_KEY: reason}))
        with suppress(OSError):
            return self._summary(self._folder.move_to(free_partial_path(self._path)))
        return self._summary(self._folder.path)

    def discard(self) -> None:
        """Delete the bag of an episode that did not begin."""
        if self._closed:
            return
        self._closed = True
        with suppress(OSError):
            self._worker.close()
        self._folder.remove()

    def _metadata(self, end: str, **custom: str) -> str:
        return metadata_text(self._file_name, self._topics(), *self._stream.span_ns, {END_KEY: end, **custom})

    def _topics(self) -> list[BagTopic]:
        """The topics in the file. Topics whose messages the disk refused are missing."""
        written = self._stream.counts
        return [
            BagTopic.of_channel(channel.record, channel.schema.name, written[channel.record.id])
            for channel in self._channels.values()
            if channel.record.id in written
        ]

    def _summary(self, path: Path) -> BagSummary:
        size = 0
        with suppress(OSError):
            size = sum(file.stat().st_size for file in path.iterdir())
        return BagSummary(path, size, {topic.name: topic.message_count for topic in self._topics()})
