from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError, InputError
from siren_ros.lab.calibration.fit import fit
from siren_ros.lab.calibration.parameters import parameters_named
from siren_ros.lab.calibration.searches import residuals_over
from siren_ros.lab.calibration.targets import (
    FAILED_M,
    FIRST_S,
    GROWTH,
    LAST,
    WHOLE,
    Situation,
    Target,
    Trajectory,
    driven,
    horizons_of,
)
from siren_ros.simulation.scenario.episode import EpisodeRequest


def line(speed_mps: float, end_s: float = 4.0, step_s: float = 0.5, begin_s: float = 0.0) -> Trajectory:
    time_s = np.arange(begin_s, end_s + 0.5 * step_s, step_s)
    return Trajectory(time_s, np.stack((speed_mps * time_s, 0.0 * time_s), axis=1))


def test_the_distance_is_the_root_mean_square_at_the_given_times() -> None:
    given, other = line(10.0, end_s=2.0, step_s=1.0), line(13.0, step_s=0.05)
    assert given.distance_m(other) == pytest.approx(np.sqrt((0.0 + 3.0**2 + 6.0**2) / 3))
    assert given.distance_m(given) == 0.0


def test_the_residuals_are_differences_of_places_and_their_norm_is_the_distance() -> None:
    given, other = line(10.0, end_s=2.0, step_s=1.0, begin_s=0.0), line(13.0, begin_s=1.0)
    apart = given.residuals_m(other)
    assert apart == pytest.approx(np.array([0.0, 3.0, 6.0, 0.0, 0.0, 0.0]) / np.sqrt(2))
    assert np.linalg.norm(apart) == given.distance_m(other)


def test_an_emv_that_left_earlier_counts_at_its_last_place() -> None:
    given, other = line(10.0, end_s=3.0, step_s=1.0), line(10.0, end_s=2.0)
    assert given.distance_m(other) == pytest.approx(np.sqrt(10.0**2 / 4))


def test_times_before_the_episode_do_not_count_and_others_are_needed() -> None:
    given = line(10.0, end_s=2.0, step_s=1.0)
    assert given.distance_m(line(10.0, begin_s=1.0)) == pytest.approx(0.0)
    with pytest.raises(InputError, match="times of the episode"):
        given.distance_m(line(10.0, begin_s=5.0, end_s=9.0))


@pytest.mark.parametrize(("length_s", "places"), [(1.0, 3), (1.2, 3), (0.1, 2), (9.0, 5), (float("inf"), 5)])
def test_the_first_seconds_count_from_its_first_place_and_two_places_remain(length_s: float, places: int) -> None:
    given = line(10.0, begin_s=2.0)
    cut = given.until(length_s)
    assert cut.time_s.tolist() == given.time_s[:places].tolist()
    assert cut.xy_m.tolist() == given.xy_m[:places].tolist()
    assert given.length_s == pytest.approx(2.0)


def test_a_record_gives_its_emv(record_of: Callable[..., EpisodeRecord]) -> None:
    way = Trajectory.of_record(record_of(duration_s=2.0))
    assert len(way.time_s) == 40
    assert way.end_s == pytest.approx(1.95)
    assert (np.diff(way.xy_m[:, 0]) > 0.0).all()


def test_a_file_is_read_by_its_columns(tmp_path: Path) -> None:
    file = tmp_path / "way.csv"
    file.write_text("y_m,time_s,x_m,speed\n1,0,5,9\n2,0.5,6,9\n", encoding="utf-8")
    way = Trajectory.read(file)
    assert way.time_s.tolist() == [0.0, 0.5]
    assert way.xy_m.tolist() == [[5.0, 1.0], [6.0, 2.0]]


@pytest.mark.parametrize("rows", [["0,1,1"], ["0,1,1", "0,1,1"], ["0,a,1", "1,1,1"], ["0,nan,1", "1,1,1"]])
def test_files_that_are_no_trajectory_are_refused(tmp_path: Path, rows: list[str]) -> None:
    file = tmp_path / "way.csv"
    for content in ("\n".join(["time_s,x_m,y_m", *rows, ""]), "", "time_s,x_m\n0,1\n1,2\n"):
        file.write_text(content, encoding="utf-8")
        with pytest.raises(InputError, match="trajectory"):
            Trajectory.read(file)
    with pytest.raises(InputError, match="CSV file"):
        Trajectory.read(tmp_path / "nothing.csv")


SITUATION = Situation(EpisodeRequest("S6", "L1", 0, sensors="none"))
SPEED = "emv.speed_mps"
UNTIL_S = 2.0


def test_a_generation_of_tries_comes_closer_to_a_known_parameter() -> None:
    """The benchmark of the recovery searches to the end, with several parameters."""
    truth = 10.5
    target = Target("made", SITUATION, driven(SITUATION, {SPEED: truth}, UNTIL_S))
    with residuals_over([target], 1) as residuals:
        (at_the_truth,) = residuals([{SPEED: truth}], WHOLE)
        assert not at_the_truth.any(), "the same parameters give the same trajectory"
        fitted = fit(parameters_named([SPEED]), residuals, 11)
    assert fitted.evaluations >= 11
    assert 0.0 < fitted.error_m < fitted.start_error_m
    assert abs(fitted.values[SPEED] - truth) < 1.5, "the middle of the range is 3.5 m/s off"


def test_a_situation_that_cannot_be_set_up_is_far_away() -> None:
    target = Target("made", SITUATION, driven(SITUATION, {}, 0.2))
    nowhere = Target("no such", Situation(EpisodeRequest("S99", "L1", 0)), target.trajectory)
    with residuals_over([target, nowhere], 1) as residuals:
        (apart,) = residuals([{}], WHOLE)
    assert np.linalg.norm(apart) == pytest.approx(np.sqrt(0.5) * FAILED_M)


def test_records_that_do_not_say_what_they_were_made_from_are_refused(record_of: Callable[..., EpisodeRecord]) -> None:
    with pytest.raises(BagError, match="request"):
        Situation.of_record(record_of(duration_s=1.0))


def test_an_episode_with_an_av_is_refused(record_of: Callable[..., EpisodeRecord]) -> None:
    record = record_of(duration_s=1.0)
    parameters = {**record.description.parameters, "request": EpisodeRequest("S2", av="civilian").to_json()}
    object.__setattr__(record.description, "parameters", parameters)
    with pytest.raises(InputError, match="AV under test"):
        Situation.of_record(record)


def targets_of(*lengths_s: float) -> list[Target]:
    """Each begins at 3 s: what counts is how long they are, not when they end."""
    return [
        Target("made", Situation(EpisodeRequest()), Trajectory(np.array([3.0, 3.0 + length]), np.zeros((2, 2))))
        for length in lengths_s
    ]


@pytest.mark.parametrize(
    ("length_s", "horizons"), [(4.0, (WHOLE,)), (7.1, (WHOLE,)), (7.3, (6.0, WHOLE)), (18.0, (6.0, 9.0, 13.5, WHOLE))]
)
def test_a_horizon_grows_by_half_until_little_is_left_out(length_s: float, horizons: tuple[float, ...]) -> None:
    assert horizons_of(targets_of(length_s)) == horizons
    assert horizons_of(targets_of(2.0, length_s, 3.0)) == horizons, "the longest counts"


@given(st.floats(0.1, 300.0))
def test_the_horizons_rise_to_the_whole(length_s: float) -> None:
    *horizons, last = horizons_of(targets_of(length_s))
    assert last == WHOLE
    assert horizons == [pytest.approx(FIRST_S * GROWTH**number) for number in range(len(horizons))]
    assert all(horizon * LAST < length_s for horizon in horizons)
    assert FIRST_S * GROWTH ** len(horizons) * LAST >= length_s - 3.1e-14 * length_s - 1e-12
