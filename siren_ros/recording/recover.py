"""Completes a bag whose writer was killed or whose storage file is damaged: all whole chunks, with a new summary."""

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from mcap.records import Channel, Schema

from siren_ros.errors import BagError, EpisodeError
from siren_ros.interfaces.topics import ACTORS
from siren_ros.recording.bag_guard import check_bag_files, storage_files
from siren_ros.recording.bag_metadata import METADATA_FILE, BagTopic, metadata_text, read_message_counts
from siren_ros.recording.bag_writer import END_KEY, REASON_KEY, BagOptions
from siren_ros.recording.mcap_scan import DamageError, PackedChunk, parse_content, read_chunks, unpack
from siren_ros.recording.mcap_stream import ChunkContent, McapStream, plain_bytes
from siren_ros.recording.working_folder import (
    PARTIAL_SUFFIX,
    RESERVE_FILE,
    free_partial_path,
    lock,
    working_path,
)

_REASON: Final = "recovered after its writer was cut off"


@dataclass(frozen=True)
class Recovery:
    """What became of a bag."""

    path: Path
    messages: int
    steps: int
    healthy: bool
    """The bag was complete as it was, and nothing has been written."""
    lost: str = ""
    """What could not be saved; empty where nothing was lost."""


@dataclass
class _Salvage:
    """Schemas, channels and counts of the chunks saved so far."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    times_ns: list[int] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)

    def take(self, content: ChunkContent) -> ChunkContent:
        """The part of a chunk that can be written: messages whose channels are known, with schemas that are."""
        schemas = tuple(item for item in content.schemas if item.id not in self.schemas)
        self.schemas.update({item.id: item for item in schemas})
        channels = tuple(
            item for item in content.channels if item.id not in self.channels and item.schema_id in self.schemas
        )
        self.channels.update({item.id: item for item in channels})
        messages = tuple(item for item in content.messages if item.channel_id in self.channels)
        if len(messages) < len(content.messages):
            self.lost.append(f"{len(content.messages) - len(messages)} messages of topics whose definition is damaged")
        self.counts.update(item.channel_id for item in messages)
        for item in messages:
            self.times_ns = [min([item.time_ns, *self.times_ns[:1]]), max([item.time_ns, *self.times_ns[1:]])]
        return ChunkContent(schemas, channels, messages)

    def topics(self) -> list[BagTopic]:
        """The saved topics as the metadata lists them."""
        return [
            BagTopic(
                channel.topic,
                self.schemas[channel.schema_id].name,
                channel.metadata.get("topic_type_hash", ""),
                "transient_local" in channel.metadata.get("offered_qos_profiles", ""),
                self.counts[key],
            )
            for key, channel in self.channels.items()
        ]


def recover_bag(path: Path, out: Path | None = None) -> Recovery:
    """Writes a complete bag from what can be read of a damaged one.

    Args:
        path: Folder of the bag: complete, partial, or the hidden ``.NAME.partial`` of a killed writer; also the
            name that the bag was to have.
        out: New folder; by default the first free one of ``NAME.partial``, ``NAME.partial-2``, … The hidden folder
            of a killed writer then goes away; any other folder stays as it is.

    Raises:
        BagError: There is no bag, it is being written now, it holds nothing that can be saved, or ``out`` exists.
        EpisodeError: The recovered bag cannot be written.
    """
    folder = _folder_of(path)
    files = storage_files(folder)
    if len(files) != 1:
        raise BagError(str(path), "a folder with one .mcap file")
    if (healthy := _as_it_is(folder)) is not None:
        return healthy
    if out is not None and out.exists():
        raise BagError(str(out), "the path of a new folder; this one exists already")
    target = out or free_partial_path(_final_path(folder))
    try:
        with files[0].open("rb", buffering=0) as held:
            if not lock(held):
                raise BagError(str(path), "a bag that no episode is writing now")
            salvage = _write(files[0], target)
        if out is None and folder == working_path(_final_path(folder)):
            _remove_working_folder(folder)
    except OSError as error:
        raise EpisodeError(f"the bag {target} cannot be written: {error.strerror or error}") from error
    steps = next((topic.message_count for topic in salvage.topics() if topic.name == ACTORS.name), 0)
    return Recovery(target, sum(salvage.counts.values()), steps, False, "; ".join(salvage.lost))


def _folder_of(path: Path) -> Path:
    for folder in (path, working_path(path), path.with_name(path.name + PARTIAL_SUFFIX)):
        if folder.is_dir():
            return folder
    raise BagError(str(path), "a folder that exists, of a recorded episode")


def _final_path(folder: Path) -> Path:
    name = folder.name.split(PARTIAL_SUFFIX)[0]
    return folder.with_name(name.removeprefix(".") or folder.name)


def _as_it_is(folder: Path) -> Recovery | None:
    """The bag itself where it is complete: metadata, summary and every chunk."""
    try:
        check_bag_files(folder, content=True)
        counts = read_message_counts(folder)
    except BagError:
        return None
    return Recovery(folder, sum(counts.values()), counts.get(ACTORS.name, 0), True)


def _write(source: Path, target: Path) -> _Salvage:
    working = target.with_name(f".{target.name.removeprefix('.')}.recovering")
    working.mkdir(parents=True)
    name = f"{_final_path(target).name}_0.mcap"
    try:
        salvage = _write_storage(source, working / name)
        first_ns, last_ns = (salvage.times_ns or [0, 0])[:2]
        custom = {END_KEY: "partial", REASON_KEY: _REASON}
        text = metadata_text(name, salvage.topics(), first_ns, last_ns, custom)
        (working / METADATA_FILE).write_text(text, encoding="utf-8")
        working.rename(target)
    except BaseException:
        for file_name in (name, METADATA_FILE):
            (working / file_name).unlink(missing_ok=True)
        working.rmdir()
        raise
    return salvage


def _write_storage(source: Path, target: Path) -> _Salvage:
    salvage = _Salvage()
    with source.open("rb") as file, target.open("wb", buffering=0) as output:
        stream = McapStream(output, BagOptions().compression_level)
        try:
            for chunk in read_chunks(file):
                _save_chunk(chunk, stream, salvage)
        except DamageError as error:
            salvage.lost.append(str(error))
        if not salvage.channels:
            raise BagError(str(source), f"a file with at least one whole chunk ({'; '.join(salvage.lost)})")
        stream.finish()
    return salvage


def _save_chunk(chunk: PackedChunk, stream: McapStream, salvage: _Salvage) -> None:
    try:
        plain = unpack(chunk)
        content = salvage.take(parse_content(plain))
    except DamageError as error:
        salvage.lost.append(str(error))
        return
    unchanged = chunk.compression == "zstd" and plain_bytes(content) == plain
    stream.adopt_chunk(content, chunk.packed if unchanged else None)


def _remove_working_folder(folder: Path) -> None:
    for file in (*storage_files(folder), folder / RESERVE_FILE, folder / METADATA_FILE):
        file.unlink(missing_ok=True)
    with suppress(OSError):  # something else lies in it, which is not ours to remove
        folder.rmdir()
