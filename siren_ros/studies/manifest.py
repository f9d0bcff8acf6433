"""The table of a study as Parquet: one row for each episode."""

import io
import json
from collections.abc import Iterable

import pyarrow as pa
import pyarrow.parquet as pq

from siren_ros.errors import InputError
from siren_ros.studies.episode_row import EpisodeRow

SCHEMA = pa.schema(
    [
        *[
            (name, pa.string())
            for name in ("episode", "group", "template", "level", "map", "preset", "sensors", "look", "values")
        ],
        ("seed", pa.int64()),
        ("draw", pa.int32()),
        ("inputs_sha256", pa.string()),
        ("status", pa.string()),
        ("reason", pa.string()),
        ("attempts", pa.int32()),
        ("retry_reasons", pa.list_(pa.string())),
        ("steps", pa.int32()),
        ("simulated_s", pa.float64()),
        ("predicate_holds", pa.bool_()),
        ("predicate", pa.string()),
        ("measures", pa.string()),
        ("bag", pa.string()),
        ("bag_bytes", pa.int64()),
        *[(name, pa.string()) for name in ("mcap_sha256", "metadata_sha256", "map_sha256")],
        *[(name, pa.float64()) for name in ("setup_s", "run_s", "process_s", "cpu_s")],
        ("begun_at", pa.string()),
        ("worker", pa.string()),
        ("versions", pa.string()),
    ]
)


def manifest_bytes(rows: Iterable[EpisodeRow]) -> bytes:
    """The table as a Parquet file, rows in the order of the episodes' names."""
    ordered = sorted(rows, key=lambda row: row.episode)
    content = [{**row.to_json(), "versions": json.dumps(row.versions, sort_keys=True)} for row in ordered]
    sink = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(content, schema=SCHEMA), sink, compression="zstd")
    return sink.getvalue()


def rows_of_manifest(content: bytes) -> tuple[EpisodeRow, ...]:
    """Inverse of ``manifest_bytes``.

    Raises:
        InputError: Not the table of a study.
    """
    try:
        table = pq.read_table(io.BytesIO(content))
        entries = [{**entry, "versions": json.loads(entry["versions"])} for entry in table.to_pylist()]
    except (pa.ArrowException, KeyError, ValueError) as error:
        raise InputError("manifest.parquet", f"{len(content)} bytes", f"the table of a study ({error})") from error
    return tuple(EpisodeRow.from_json(entry) for entry in entries)
