"""Motion as columns: the record's numbers, row for row, and frames without an actor."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from episode_page.unpacked import unpacked

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.reports.episode_page.columns import ColumnFile
from siren_ros.reports.episode_page.motion import ABSENT, add_motion, check_motion

RecordOf = Callable[..., EpisodeRecord]


def test_the_columns_hold_the_record_to_a_millimetre(record_of: RecordOf) -> None:
    record = record_of(duration_s=6.0)
    file = ColumnFile()
    actors = add_motion(file, record)
    _, columns = unpacked(file.packed({}))
    assert [actor["id"] for actor in actors] == sorted(record.actors)
    assert sum(actor["frames"] for actor in actors) == len(record.rows)
    for name, most in (("x_m", 0.0005), ("y_m", 0.0005), ("yaw_rad", 0.0001), ("speed_mps", 0.005)):
        assert np.abs(columns[f"motion.{name}"] - getattr(record.rows, name)).max() <= most + 1e-9, name
    for name in ("mode", "owner", "lights"):
        assert np.array_equal(columns[f"motion.{name}"], getattr(record.rows, name))
    assert columns["frame.step"].tolist() == [state.step for state in record.states]


def test_an_actor_that_is_away_for_a_while_is_absent_and_not_elsewhere(record_of: RecordOf) -> None:
    record = record_of(duration_s=1.0)
    away = range(5, 8)
    states = tuple(state.select(state.actor_id != 2) if state.step in away else state for state in record.states)
    file = ColumnFile()
    actors = add_motion(file, replace(record, states=states))
    _, columns = unpacked(file.packed({}))
    place = [actor["id"] for actor in actors].index(2)
    first = sum(actor["frames"] for actor in actors[:place])
    modes = columns["motion.mode"][first : first + actors[place]["frames"]]
    assert np.flatnonzero(modes == ABSENT).tolist() == list(away)
    assert actors[place]["first"] == 0


def test_turns_through_west_do_not_jump(record_of: RecordOf) -> None:
    record = record_of(duration_s=1.0)
    turned = tuple(
        replace(state, yaw_rad=np.where(state.step < 10, 3.14, -3.14) + 0.0 * state.yaw_rad) for state in record.states
    )
    file = ColumnFile()
    add_motion(file, replace(record, states=turned))
    _, columns = unpacked(file.packed({}))
    assert np.abs(np.diff(columns["motion.yaw_rad"][: record.steps])).max() < 0.004


@pytest.mark.parametrize("value", [np.nan, np.inf, 2.1e6])
def test_states_that_are_no_places_are_refused(record_of: RecordOf, value: float) -> None:
    record = record_of(duration_s=0.5)
    check_motion(record)
    broken = replace(record.states[3], y_m=np.full(len(record.states[3]), value))
    with pytest.raises(InputError, match="numbers within 2,000 km"):
        check_motion(replace(record, states=(*record.states[:3], broken)))


def test_unknown_actors_and_sizes_that_are_none_are_refused(record_of: RecordOf) -> None:
    record = record_of(duration_s=0.5)
    for actors in (
        {key: actor for key, actor in record.actors.items() if key != 2},
        {key: replace(actor, width_m=0.0 if key == 2 else 2.0) for key, actor in record.actors.items()},
        {key: replace(actor, width_m=np.nan if key == 2 else 2.0) for key, actor in record.actors.items()},
    ):
        with pytest.raises(InputError, match="numbers within 2,000 km"):
            check_motion(replace(record, actors=actors))
