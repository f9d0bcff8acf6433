"""Several episodes in one file: columns and scenes of their own, scenes of one map shared."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from episode_page.unpacked import unpacked

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.reports.episode_page import shapes
from siren_ros.reports.episode_page.columns import ColumnFile
from siren_ros.reports.episode_page.parts import add_parts


@pytest.fixture(scope="module")
def episodes(record_of: Callable[..., EpisodeRecord]) -> tuple[EpisodeRecord, EpisodeRecord, EpisodeRecord]:
    """An episode, a shorter one on its map, and that on another map."""
    shorter = record_of(duration_s=1.0, civilians=2)
    elsewhere = replace(shorter, description=replace(shorter.description, map_sha256="1" * 64))
    return record_of(duration_s=2.0), shorter, elsewhere


def test_each_episode_has_its_motion_and_each_map_its_scene(episodes: tuple[EpisodeRecord, ...]) -> None:
    file = ColumnFile()
    head = add_parts(file, episodes[0], episodes[1:])
    _, columns = unpacked(file.packed({}))
    for prefix, record in zip(("", "1.", "2."), episodes, strict=True):
        assert columns[f"{prefix}motion.x_m"] == pytest.approx(
            np.concatenate([record.rows.x_m[record.rows_of(key)] for key in record.actors]), abs=0.0006
        )
    parts = (head, *head["against"])
    assert [part["prefix"] for part in parts] == ["", "1.", "2."]
    assert [part["scene"] for part in parts] == ["", "", "2."]
    assert [name for name in columns if name.endswith("static.xyz")] == ["static.xyz", "2.static.xyz"]
    assert [len(part["actors"]) for part in parts] == [5, 3, 3]


def test_pictures_share_the_triangles(episodes: tuple[EpisodeRecord, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shapes, "STATIC_TRIANGLES", 30)
    file = ColumnFile()
    add_parts(file, episodes[0], episodes[1:])
    _, columns = unpacked(file.packed({}))
    assert len(columns["static.triangles"]) == len(columns["2.static.triangles"]) == 3 * 10


def test_only_so_many_episodes_can_be_compared(episodes: tuple[EpisodeRecord, ...]) -> None:
    with pytest.raises(InputError, match="at most 3 other episodes"):
        add_parts(ColumnFile(), episodes[0], 4 * [episodes[1]])
