"""One episode of a page: actors, motion and signals; each episode's columns have their own names."""

from collections.abc import Sequence
from typing import Any, Final

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError, shown_text
from siren_ros.reports.episode_page.columns import ColumnFile
from siren_ros.reports.episode_page.motion import add_motion, check_motion
from siren_ros.reports.episode_page.shapes import add_static_scene
from siren_ros.sensing.meshes.mesh import StaticScene
from siren_ros.sensing.scene.kept_scenes import kept_scene
from siren_ros.sensing.scene.kerbside import scene_config_of

MOST_OTHERS: Final = 3
"""Largest number of episodes for comparison: a screen has space for four pictures."""


def title_of(record: EpisodeRecord) -> str:
    """Title such as ``S2 at L2, seed 0, on town``."""
    episode = record.description
    return shown_text(f"{episode.template} at {episode.level.name}, seed {episode.seed}, on {episode.map_name}")


def add_parts(
    file: ColumnFile, record: EpisodeRecord, others: Sequence[EpisodeRecord], scene: StaticScene | None = None
) -> dict[str, Any]:
    """Add an episode and those for comparison; returns their entries for the head.

    ``scene`` is that of the first episode, where it has been made already. Episodes on the same map share its scene.
    Its triangles are fewer where there are more pictures to draw.

    Raises:
        InputError: Too many others, or a record that ``check_motion`` refuses.
    """
    if len(others) > MOST_OTHERS:
        raise InputError("against", str(len(others)), f"at most {MOST_OTHERS} other episodes")
    records = (record, *others)
    maps = [each.description.map_sha256 for each in records]
    parts = []
    for place, each in enumerate(records):
        check_motion(each)
        first = maps.index(maps[place])
        part = _part(file, each, _prefix(place)) | {"scene": _prefix(first)}
        if first == place:
            sharing = [other for other, sha256 in zip(records, maps, strict=True) if sha256 == maps[place]]
            config = scene_config_of(each.description.template_values)
            made = scene if scene and not place else kept_scene(each.network, each.description.seed, config)
            part |= add_static_scene(file, sharing, made, _prefix(place), pictures=len(records))
        parts.append(part)
    return {**parts[0], "against": parts[1:]}


def _prefix(place: int) -> str:
    return f"{place}." if place else ""


def _part(file: ColumnFile, record: EpisodeRecord, prefix: str) -> dict[str, Any]:
    return {
        "title": title_of(record),
        "prefix": prefix,
        "actors": add_motion(file, record, prefix),
        "emvs": list(record.emv_ids),
        "left_hand": record.network.left_hand,
        "signals": signals_of(record),
    }


def signals_of(record: EpisodeRecord) -> dict[str, list[tuple[int, str]]]:
    """For each signal the steps at which its state changes, with the new state."""
    changes: dict[str, list[tuple[int, str]]] = {}
    for traffic in record.traffic:
        for signal in traffic.signals:
            known = changes.setdefault(signal.signal_id, [])
            if not known or known[-1][1] != signal.state:
                known.append((traffic.step, signal.state))
    return changes
