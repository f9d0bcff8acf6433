"""The rows of a study's episodes, and what the study asked for."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from siren_ros.errors import InputError
from siren_ros.studies.episode_row import EpisodeRow
from siren_ros.studies.study_folder import MANIFEST, STUDY, LocalFolder, read_table


@dataclass(frozen=True)
class StudyRows:
    """What a study's folder says about its episodes."""

    folder: Path
    asked: Mapping[str, Any]
    """``study.json``: what the last run asked for; empty where it is missing."""
    rows: tuple[EpisodeRow, ...]
    manifest_sha256: str


def read_rows(folder: Path) -> StudyRows:
    """Reads the table of a study, and the rows next to bags that a run without an end left out of it.

    Raises:
        InputError: The folder is none that ``siren generate`` made.
    """
    local = LocalFolder(folder)
    content = local.read(MANIFEST)
    if content is None:
        raise InputError("dir", str(folder), f"a folder that `siren generate` made, with {MANIFEST}")
    rows = {row.episode: row for row in read_table(local)}
    for file in sorted((folder / "episodes").glob("*/*.json")):
        if file.stem not in rows:
            row = local.row_of(file.relative_to(folder).with_suffix("").as_posix())
            if row is not None:
                rows[row.episode] = row
    asked = local.read(STUDY)
    ordered = tuple(rows[name] for name in sorted(rows))
    return StudyRows(folder, json.loads(asked) if asked else {}, ordered, sha256(content).hexdigest())
