"""ScenarioNet databases out of recorded episodes."""

import pickle
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from siren_ros.datasets.exporting.file_writer import FileWriter
from siren_ros.datasets.exporting.format import EpisodePart, EpisodeReport
from siren_ros.datasets.exporting.staging import link
from siren_ros.datasets.scenarionet.description import description, summary_of
from siren_ros.datasets.sources.episode_source import EpisodeSource
from siren_ros.datasets.sources.tracks import tracks_of

_FILE: Final = "sd_siren_1.0_{}.pkl"
"""How MetaDrive tells a scenario's file: its name begins with ``sd_`` and ends with the scenario's id."""
_SUMMARY: Final = "dataset_summary.pkl"
_MAPPING: Final = "dataset_mapping.pkl"
_PROTOCOL: Final = 4


class ScenarioNetExporter:
    """One pickled description for each episode, and a database for each split."""

    def write_episode(self, source: EpisodeSource, episode_id: str, files: FileWriter) -> EpisodeReport:
        """Writes the description; all tracks of the episode are in memory."""
        record = source.record()
        tracks = [track for track in tracks_of(record) if len(track) > 1]
        scenario = description(record, tracks, episode_id, min(record.emv_ids))
        files.write(_FILE.format(episode_id), pickle.dumps(scenario, _PROTOCOL))
        files.write("summary.pkl", pickle.dumps(summary_of(scenario), _PROTOCOL))
        classes = Counter(track.actor.actor_class.name.lower() for track in tracks)
        return EpisodeReport({"scenarios": 1, "tracks": len(tracks)}, dict(classes))

    def assemble(self, parts: Sequence[EpisodePart], folder: Path) -> None:
        """Writes the summary and the mapping of each split."""
        for split in sorted({part.split for part in parts}):
            summary: dict[str, Any] = {}
            for part in [part for part in parts if part.split == split]:
                name = _FILE.format(part.episode_id)
                link(part.folder / name, folder / split / name)
                summary[name] = pickle.loads((part.folder / "summary.pkl").read_bytes())  # noqa: S301 - written by this export
            (folder / split / _SUMMARY).write_bytes(pickle.dumps(summary, _PROTOCOL))
            (folder / split / _MAPPING).write_bytes(pickle.dumps(dict.fromkeys(summary, ""), _PROTOCOL))
