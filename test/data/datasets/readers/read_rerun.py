"""Reads a recording with rerun's own data frames."""

import json
import sys
from pathlib import Path

import rerun as rr

from siren_ros.cli.main import main

bag, out = sys.argv[1:3]
code = main(["export", "rerun", bag, "--out", out])
recording = rr.dataframe.load_recording(next(Path(out).glob("*.rrd")))
schema = recording.schema()
entities = sorted({column.entity_path for column in schema.component_columns()})
table = recording.view(index="episode", contents="/map/vehicles").select().read_all()
times = [value.total_seconds() for value in table.column("episode").to_pylist()]
answer = {
    "code": code,
    "application": recording.application_id(),
    "entities": [name for name in entities if "/path/" not in name],
    "path": sum("/path/" in name for name in entities),
    "timelines": sorted(column.name for column in schema.index_columns()),
    "steps": len(times),
    "last_s": max(times),
}
print(json.dumps(answer))
