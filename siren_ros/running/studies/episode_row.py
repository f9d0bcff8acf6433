"""One row of a study's table: inputs of an episode, its outcome and its place; and the Parquet file of rows."""

import io
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, Self

import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.base.numerics.arrays import Brief
from siren_ros.base.params import plain_files
from siren_ros.errors import InputError
from siren_ros.running.studies.matrix import PlannedEpisode
from siren_ros.simulation.roads.maps.map_compiler import name_of_map
from siren_ros.simulation.scenario.episode import shortcomings


class Status(StrEnum):
    """Result of an episode in a study."""

    COMPLETE = "complete"
    FAILED = "failed"
    """It ended early and would do so again: SUMO teleported a vehicle, or a residual grew too large."""
    REFUSED = "refused"
    """It cannot be made: the map has no site for it."""
    CRASHED = "crashed"
    """Its process died or hung at every attempt."""


_OF_REQUEST: Final = ("template", "level", "seed", "map", "preset", "sensors", "look", "values")


def path_of(group: str, episode: str) -> str:
    """Place of an episode's bag, relative to the study's folder."""
    return f"episodes/{group}/{episode}"


@dataclass(frozen=True)
class EpisodeRow(Brief):
    """One episode of a study."""

    # Inputs.
    episode: str
    group: str
    template: str
    level: str
    seed: int
    map: str
    """Map as the study names it; empty for the built-in town."""
    preset: str
    sensors: str
    look: str
    draw: int
    values: str
    """Drawn values, as ``EpisodeRequest.values``."""
    inputs_sha256: str
    # Outcome.
    status: Status
    reason: str = ""
    attempts: int = 1
    retry_reasons: tuple[str, ...] = ()
    """Reasons of the failed attempts before the last one."""
    steps: int = 0
    simulated_s: float = 0.0
    predicate_holds: bool | None = None
    predicate: str = ""
    measures: str = "{}"
    """Numbers of the outcome as a JSON object."""
    # Place.
    bag: str = ""
    """Folder of the bag, relative to the study's folder."""
    bag_bytes: int = 0
    mcap_sha256: str = ""
    metadata_sha256: str = ""
    map_sha256: str = ""
    """Hash of the compiled net."""
    site: str = ""
    """Site on the map; for an episode that was not made, its pinned site."""
    # Duration.
    setup_s: float = 0.0
    run_s: float = 0.0
    """Wall time from the first step to the closed bag."""
    process_s: float = 0.0
    """Wall time of the last attempt, including the start of its process."""
    cpu_s: float = 0.0
    begun_at: str = ""
    """Start of the last attempt in UTC."""
    worker: str = ""
    versions: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def planned(cls, episode: PlannedEpisode, status: Status, reason: str = "", **known: Any) -> Self:
        """Row of a planned episode with further known values."""
        known |= {name: getattr(episode.request, name) for name in _OF_REQUEST}
        known |= {name: getattr(episode, name) for name in ("group", "draw", "inputs_sha256")}
        known = {"site": episode.request.site, **known}
        return cls(episode=episode.name, status=status, reason=reason, **known)

    @property
    def map_name(self) -> str:
        """Name of the map as in the bag: without folder and suffix, ``town`` for the built-in one."""
        return name_of_map(Path(self.map) if self.map else None)

    @property
    def shortcomings(self) -> tuple[str, ...]:
        """What a complete episode lacks, as ``EpisodeOutcome.shortcomings``."""
        return shortcomings(self.predicate_holds, self.collisions)

    @property
    def collisions(self) -> int:
        """Number of collisions."""
        return int(json.loads(self.measures).get("collisions", 0))

    @property
    def people(self) -> dict[str, int]:
        """Counts of people in the outcome, by ``pedestrians.near`` and so on; empty without people."""
        named = json.loads(self.measures).items()
        return {name.removeprefix("people."): int(value) for name, value in named if name.startswith("people.")}

    @property
    def path(self) -> str:
        """Place of the bag, relative to the study's folder."""
        return path_of(self.group, self.episode)

    def to_json(self) -> dict[str, Any]:
        """The row as JSON types."""
        return {**asdict(self), "status": self.status.value, "retry_reasons": list(self.retry_reasons)}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """Reads the message that ``to_json`` makes; missing columns get defaults, unknown ones are ignored.

        InputError if it is not a row.
        """
        values = {field.name: content[field.name] for field in fields(cls) if field.name in content}
        try:
            values["status"] = Status(values["status"])
            values["retry_reasons"] = tuple(values.get("retry_reasons") or ())
            values["versions"] = dict(values.get("versions") or {})
            return cls(**values)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError("row", json.dumps(content, default=str)[:80], "a row of a study's table") from error


_COLUMNS: Final = (
    ("episode group template level map site preset sensors look values", pa.string()),
    ("seed", pa.int64()),
    ("draw", pa.int32()),
    ("inputs_sha256 status reason", pa.string()),
    ("attempts", pa.int32()),
    ("retry_reasons", pa.list_(pa.string())),
    ("steps", pa.int32()),
    ("simulated_s", pa.float64()),
    ("predicate_holds", pa.bool_()),
    ("predicate measures bag", pa.string()),
    ("bag_bytes", pa.int64()),
    ("mcap_sha256 metadata_sha256 map_sha256", pa.string()),
    ("setup_s run_s process_s cpu_s", pa.float64()),
    ("begun_at worker versions", pa.string()),
)
SCHEMA: Final = pa.schema([(name, kind) for names, kind in _COLUMNS for name in names.split()])


def manifest_bytes(rows: Iterable[EpisodeRow]) -> bytes:
    """The table as a Parquet file, with rows sorted by episode."""
    ordered = sorted(rows, key=lambda row: row.episode)
    content = [{**row.to_json(), "versions": json.dumps(row.versions, sort_keys=True)} for row in ordered]
    sink = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(content, schema=SCHEMA), sink, compression="zstd")
    return sink.getvalue()


def rows_of_manifest(content: bytes) -> tuple[EpisodeRow, ...]:
    """Inverse of ``manifest_bytes``; InputError for other bytes."""
    try:
        # pyarrow's threads sometimes abort a program that ends soon after reading with them.
        table = pq.read_table(io.BytesIO(content), use_threads=False, pre_buffer=False)
        entries = [{**entry, "versions": plain_files.load_json(entry["versions"])} for entry in table.to_pylist()]
    except (pa.ArrowException, KeyError, ValueError) as error:
        raise InputError("manifest.parquet", f"{len(content)} bytes", f"the table of a study ({error})") from error
    return tuple(EpisodeRow.from_json(entry) for entry in entries)
