"""One Parquet file of samples: each column is an array of fixed shape, or with a first axis of variable length.

The file is plain Parquet: nested values are flat lists, and the field's metadata has the shape, so that pandas, Polars
and Hugging Face's ``datasets`` read it, too.
"""

import json
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.base.params import plain_files
from siren_ros.errors import InputError, whole_file

Sample = Mapping[str, Any]
"""One sample: arrays, numbers and texts by column name."""
GROUP_BYTES: Final = 2_000_000
"""Size of the arrays in a row group, the smallest unit of reading: to read one sample costs as much as its group."""
_GROUPS_KEPT: Final = 4
_ANY: Final = -1


@dataclass(frozen=True)
class Column:
    """Description of one array of a sample."""

    kind: type[np.generic] | type[str]
    shape: tuple[int, ...]
    """Shape in one sample; −1 comes first if the number of rows varies. Empty for a number or a text."""
    meaning: str
    """Meaning for readers, with units and frame."""
    names: tuple[str, ...] = ()
    """Names of the entries along the last axis."""

    @property
    def is_text(self) -> bool:
        """Whether the values are texts."""
        return self.kind is str

    def field(self, name: str) -> pa.Field:
        """The column as a field of the file."""
        about = {"shape": list(self.shape), "meaning": self.meaning, "names": list(self.names)}
        return pa.field(name, self._arrow(), metadata={"siren": json.dumps(about)})

    def _arrow(self) -> pa.DataType:
        if self.is_text:
            return pa.string()
        flat = pa.from_numpy_dtype(np.dtype(self.kind))
        if not self.shape:
            return flat
        return pa.list_(flat)

    def packed(self, values: Sequence[Any]) -> pa.Array:
        """Pack the values of some samples; ValueError if a shape differs."""
        if self.is_text or not self.shape:
            return pa.array(values, self._arrow())
        arrays = [np.asarray(value, dtype=self.kind) for value in values]
        for array in arrays:
            if array.ndim != len(self.shape) or any(
                want not in (_ANY, have) for want, have in zip(self.shape, array.shape, strict=True)
            ):
                raise ValueError(f"an array of shape {array.shape} where {self.shape} is asked for")
        flat = np.concatenate([array.reshape(-1) for array in arrays])
        ends = np.cumsum([0, *(array.size for array in arrays)]).astype(np.int32)
        return pa.ListArray.from_arrays(pa.array(ends), pa.array(flat))

    def unpacked(self, values: pa.Array) -> "npt.NDArray[Any] | list[Any]":
        """Inverse of ``packed``: one array for all samples, or a list for variable shapes and texts."""
        if self.is_text:
            texts: list[Any] = values.to_pylist()
            return texts
        if not self.shape:
            return np.asarray(values.to_numpy(zero_copy_only=False))
        flat = np.asarray(values.flatten().to_numpy(zero_copy_only=False))
        if _ANY not in self.shape:
            return flat.reshape(len(values), *self.shape)
        ends = np.asarray(values.offsets) - values.offsets[0].as_py()
        return [flat[first:end].reshape(self.shape) for first, end in pairwise(ends.tolist())]


class SampleSource(Protocol):
    """Protocol: samples by number."""

    @property
    def columns(self) -> Mapping[str, Column]:
        """Columns of each sample."""

    def __len__(self) -> int:
        """Number of samples."""

    def __getitem__(self, number: int) -> Sample:
        """One sample; IndexError beyond the end."""


@dataclass(frozen=True)
class SamplesInMemory:
    """Samples in memory, for example read from bags."""

    columns: Mapping[str, Column]
    samples: Sequence[Sample]

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, number: int) -> Sample:
        return self.samples[number]


def schema_of(columns: Mapping[str, Column], task: str) -> pa.Schema:
    """Columns of the file, with the task of the samples."""
    return pa.schema([column.field(name) for name, column in columns.items()], metadata={"siren_task": task})


def write_samples(path: Path, columns: Mapping[str, Column], samples: Iterable[Sample], task: str) -> int:
    """Write a file, completely or not at all; returns the number of samples.

    Raises:
        OSError: The file cannot be written.
        ValueError: An array has another shape than its column.
    """
    schema, count, held, size = schema_of(columns, task), 0, list[Sample](), 0

    def table() -> pa.Table:
        packed = [column.packed([sample[name] for sample in held]) for name, column in columns.items()]
        return pa.Table.from_arrays(packed, schema=schema)

    with whole_file(path) as new, pq.ParquetWriter(new, schema, compression="zstd", use_dictionary=False) as writer:
        for sample in samples:
            held.append(sample)
            count += 1
            size += sum(np.asarray(value).nbytes for value in sample.values() if not isinstance(value, str))
            if size >= GROUP_BYTES:
                writer.write_table(table())
                held, size = [], 0
        if held:
            writer.write_table(table())
    return count


def join_files(parts: Sequence[Path], path: Path) -> None:
    """Join the files of one task into one file, group by group; OSError as ``write_samples``."""
    first = pq.ParquetFile(parts[0]).schema_arrow
    with whole_file(path) as new, pq.ParquetWriter(new, first, compression="zstd", use_dictionary=False) as writer:
        for part in parts:
            file = pq.ParquetFile(part)
            for group in range(file.num_row_groups):
                writer.write_table(file.read_row_group(group))


class PackedSamples:
    """Samples of a file of ``write_samples``; only some groups are in memory at a time."""

    def __init__(self, path: Path) -> None:
        """Read the columns and the places of the groups.

        Raises:
            InputError: No such file, or one that ``siren pack`` did not write.
        """
        self.path = Path(path)
        try:
            file = pq.ParquetFile(self.path)
            fields = {field.name: plain_files.load_json(field.metadata[b"siren"]) for field in file.schema_arrow}
            self.task = file.schema_arrow.metadata[b"siren_task"].decode()
            self.columns: Mapping[str, Column] = {
                field.name: _column(field, fields[field.name]) for field in file.schema_arrow
            }
        except (OSError, KeyError, TypeError, ValueError, pa.ArrowException) as error:
            raise InputError("samples", str(path), f"a file of `siren pack` ({error})") from error
        rows = [file.metadata.row_group(group).num_rows for group in range(file.num_row_groups)]
        self.first_of_group: npt.NDArray[np.int64] = np.cumsum([0, *rows]).astype(np.int64)
        """Number of the first sample of each group, and of all samples; shape ``(G + 1,)``."""
        self._file: pq.ParquetFile | None = file
        self._kept: OrderedDict[int, Mapping[str, Any]] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        """State without the open file, which another process opens again."""
        return {**self.__dict__, "_file": None, "_kept": OrderedDict()}

    def __len__(self) -> int:
        return int(self.first_of_group[-1])

    def __getitem__(self, number: int) -> Sample:
        if not 0 <= number < len(self):
            raise IndexError(number)
        group = int(np.searchsorted(self.first_of_group, number, side="right")) - 1
        row = number - int(self.first_of_group[group])
        return {name: values[row] for name, values in self.group(group).items()}

    def group(self, number: int) -> Mapping[str, Any]:
        """Columns of a group of samples; recently read groups are cached.

        Raises:
            InputError: The file is damaged there.
        """
        if number not in self._kept:
            try:
                self._file = self._file or pq.ParquetFile(self.path)
                table = self._file.read_row_group(number, use_threads=False)
            except (OSError, pa.ArrowException) as error:
                raise InputError("samples", str(self.path), f"an undamaged file ({error})") from error
            whole = {name: table[name].combine_chunks() for name in self.columns}
            self._kept[number] = {name: self.columns[name].unpacked(_one(values)) for name, values in whole.items()}
            while len(self._kept) > _GROUPS_KEPT:
                self._kept.popitem(last=False)
        with suppress(KeyError):
            self._kept.move_to_end(number)
        return self._kept[number]


def _one(values: pa.Array | pa.ChunkedArray) -> pa.Array:
    return values.chunk(0) if isinstance(values, pa.ChunkedArray) else values


def _column(field: pa.Field, about: Mapping[str, Any]) -> Column:
    flat = field.type.value_type if pa.types.is_list(field.type) else field.type
    kind: type[Any] = str if pa.types.is_string(flat) else pa.array([], flat).to_numpy(zero_copy_only=False).dtype.type
    return Column(kind, tuple(about["shape"]), about["meaning"], tuple(about["names"]))


GROUPS_MIXED: Final = 8
"""Number of groups whose samples are mixed, because neighbours in a file are also neighbours in time."""


def shuffled(count: int, seed: int, turn: int) -> list[int]:
    """The numbers below ``count`` in the random order of a pass (``turn``)."""
    return [int(number) for number in np.random.default_rng([seed, turn]).permutation(count)]


def samples_of_shard(
    files: Sequence[PackedSamples], shard: int = 0, shards: int = 1, *, seed: int | None = None, turn: int = 0
) -> Iterator[Sample]:
    """Samples of one shard; all shards together give each sample once.

    Args:
        files: The files, in the order that counts.
        shard: Number of the shard, from 0 on.
        shards: Number of all shards.
        seed: Seed of the random order; None for the order of the files.
        turn: Number of the pass over the files; each has an order of its own.

    Raises:
        InputError: A shard that is not below the number of shards, or a damaged file.
    """
    if not 0 <= shard < shards:
        raise InputError("shard", shard, f"0 to {shards - 1}")
    groups = [(file, group) for file in files for group in range(len(file.first_of_group) - 1)]
    if seed is not None:
        groups = [groups[number] for number in shuffled(len(groups), seed, turn)]
    mine = iter(groups[shard::shards])
    while mixed := list(islice(mine, GROUPS_MIXED if seed is not None else 1)):
        held = [sample for file, group in mixed for sample in _samples(file, group)]
        order = range(len(held)) if seed is None else _within(held, seed, turn, mixed[0][1])
        for number in order:
            yield held[number]


def _samples(file: PackedSamples, group: int) -> list[Sample]:
    columns = file.group(group)
    count = int(file.first_of_group[group + 1] - file.first_of_group[group])
    return [{name: values[row] for name, values in columns.items()} for row in range(count)]


def _within(held: Sequence[Sample], seed: int, turn: int, group: int) -> list[int]:
    return [int(number) for number in np.random.default_rng([seed, turn, 1, group]).permutation(len(held))]
