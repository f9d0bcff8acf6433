"""HOTA of tracks by hand, its properties, and the same by TrackEval's own code."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reader_environments import read_with

from siren_ros.scoring.evaluation.detection.hota import ALPHAS, ZERO_M, Hota, TrackTable, hota_sums


def table(*rows: tuple[int, float, int], episode: int = 0) -> TrackTable:
    """Rows of frame, x and track."""
    frame, x, track = (np.array(column) for column in zip(*rows, strict=True)) if rows else np.zeros((3, 0))
    places = np.stack((x, np.zeros(len(x))), axis=-1)
    return TrackTable(
        np.full(len(x), episode), frame.astype(np.intp), places, track.astype(np.intp), np.full(len(x), 0.5)
    )


def joined(*tables: TrackTable) -> TrackTable:
    columns = [[getattr(one, name) for one in tables] for name in TrackTable.__dataclass_fields__]
    return TrackTable(*(np.concatenate(column) for column in columns))


def whole(labels: TrackTable, found: TrackTable, episodes: int = 1) -> Hota:
    return hota_sums(labels, found, episodes).of(np.ones(episodes))


STANDS = tuple((frame, 0.0, 7) for frame in range(4))


def test_the_labels_themselves_are_perfect() -> None:
    assert whole(table(*STANDS), table(*STANDS)) == (1.0, 1.0, 1.0)


def test_a_change_of_the_number_halves_the_association() -> None:
    """Two tracks of two boxes each for a vehicle of four: each hit shares 2 of 4 boxes."""
    found = table((0, 0.0, 1), (1, 0.0, 1), (2, 0.0, 2), (3, 0.0, 2))
    assert whole(table(*STANDS), found) == pytest.approx((np.sqrt(0.5), 1.0, 0.5))


def test_a_false_alarm_in_each_frame_halves_the_detection() -> None:
    found = joined(table(*STANDS), table(*((frame, 50.0, 9) for frame in range(4))))
    found = found.at(np.argsort(found.frame, kind="stable"))
    assert whole(table(*STANDS), found) == pytest.approx((np.sqrt(0.5), 0.5, 1.0))


@pytest.mark.parametrize("away_m", [0.3, 1.0, 1.7])
def test_a_track_aside_is_found_as_long_as_it_is_near_enough(away_m: float) -> None:
    found = table(*((frame, away_m, 1) for frame in range(4)))
    share = float(np.mean(1.0 - away_m / ZERO_M >= ALPHAS - 1e-12))
    assert whole(table(*STANDS), found) == pytest.approx((share, share, share))


def test_nothing_at_all_has_no_value_and_nothing_found_is_zero() -> None:
    assert np.isnan(whole(table(), table())).all()
    assert whole(table(*STANDS), table()) == (0.0, 0.0, 0.0)
    assert whole(table(), table(*STANDS)) == (0.0, 0.0, 0.0)


def random_tables(seed: int, episodes: int = 3) -> tuple[TrackTable, TrackTable]:
    """Vehicles that move at random, found with errors, gaps, changes of numbers and false alarms."""
    rng = np.random.default_rng(seed)
    labels, found = [], []
    for episode in range(episodes):
        rows: list[tuple[int, float, int]] = []
        seen: list[tuple[int, float, int]] = []
        for frame in range(100 * episode, 100 * episode + 8):
            for vehicle in range(int(rng.integers(1, 6))):
                x = 4.0 * vehicle + 0.2 * (frame % 100)
                rows.append((frame, x, vehicle))
                if rng.random() < 0.8:
                    seen.append((frame, x + rng.normal(0.0, 0.8), vehicle + 10 * int(rng.random() < 0.2)))
            seen += [(frame, rng.uniform(-10.0, 30.0), 90 + k) for k in range(int(rng.integers(0, 3)))]
        labels.append(table(*rows, episode=episode))
        found.append(table(*seen, episode=episode))
    return joined(*labels), joined(*found)


@given(st.integers(0, 10_000))
def test_numbers_mean_nothing_and_a_farther_track_is_never_better(seed: int) -> None:
    labels, found = random_tables(seed, episodes=1)
    value = whole(labels, found)
    other = TrackTable(found.episode, found.frame, found.centre_m, 1000 - found.track, found.score)
    assert whole(labels, other) == pytest.approx(value)
    assert 0.0 <= value.hota <= 1.0
    assert value.hota <= np.sqrt(value.detection * value.association) + 1e-12, "the mean of roots is below that"
    away = TrackTable(found.episode, found.frame, found.centre_m + np.array([100.0, 0.0]), found.track, found.score)
    assert whole(labels, away).hota == 0.0


def test_trackeval_gives_the_same(tmp_path: Path) -> None:
    labels, found = random_tables(4)
    ours = whole(labels, found, 3)
    assert 0.1 < ours.hota < 0.9
    sequences = {}
    for episode in range(3):
        frames = []
        for frame in range(100 * episode, 100 * episode + 8):
            one, other = (side.at(side.frame == frame) for side in (labels, found))
            way = one.centre_m[:, None] - other.centre_m[None]
            alike = np.maximum(0.0, 1.0 - np.linalg.norm(way, axis=-1) / 2.0)
            frames.append({"labels": one.track.tolist(), "tracks": other.track.tolist(), "alike": alike.tolist()})
        sequences[str(episode)] = frames
    file = tmp_path / "sequences.json"
    file.write_text(json.dumps(sequences))
    told = read_with("trackeval", "read_hota.py", file)
    assert ours == pytest.approx((told["HOTA"], told["DetA"], told["AssA"]), abs=1e-9)
