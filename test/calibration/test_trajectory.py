from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from siren_ros.calibration.trajectory import Trajectory
from siren_ros.errors import InputError
from siren_ros.recording.episode_record import EpisodeRecord


def line(speed_mps: float, end_s: float = 4.0, step_s: float = 0.5, begin_s: float = 0.0) -> Trajectory:
    time_s = np.arange(begin_s, end_s + 0.5 * step_s, step_s)
    return Trajectory(time_s, np.stack((speed_mps * time_s, 0.0 * time_s), axis=1))


def test_the_distance_is_the_root_mean_square_at_the_given_times() -> None:
    given, found = line(10.0, end_s=2.0, step_s=1.0), line(13.0, step_s=0.05)
    assert given.distance_m(found) == pytest.approx(np.sqrt((0.0 + 3.0**2 + 6.0**2) / 3))
    assert given.distance_m(given) == 0.0


def test_the_residuals_are_differences_of_places_and_their_norm_is_the_distance() -> None:
    given, found = line(10.0, end_s=2.0, step_s=1.0, begin_s=0.0), line(13.0, begin_s=1.0)
    apart = given.residuals_m(found)
    assert apart == pytest.approx(np.array([0.0, 3.0, 6.0, 0.0, 0.0, 0.0]) / np.sqrt(2))
    assert np.linalg.norm(apart) == given.distance_m(found)


def test_an_emv_that_left_earlier_counts_at_its_last_place() -> None:
    given, found = line(10.0, end_s=3.0, step_s=1.0), line(10.0, end_s=2.0)
    assert given.distance_m(found) == pytest.approx(np.sqrt(10.0**2 / 4))


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
    found = Trajectory.of_record(record_of(duration_s=2.0))
    assert len(found.time_s) == 40
    assert found.end_s == pytest.approx(1.95)
    assert (np.diff(found.xy_m[:, 0]) > 0.0).all()


def test_a_file_is_read_by_its_columns(tmp_path: Path) -> None:
    file = tmp_path / "way.csv"
    file.write_text("y_m,time_s,x_m,speed\n1,0,5,9\n2,0.5,6,9\n", encoding="utf-8")
    found = Trajectory.read(file)
    assert found.time_s.tolist() == [0.0, 0.5]
    assert found.xy_m.tolist() == [[5.0, 1.0], [6.0, 2.0]]


@pytest.mark.parametrize(
    "content",
    [
        "",
        "time_s,x_m\n0,1\n1,2\n",
        "time_s,x_m,y_m\n0,1,1\n",
        "time_s,x_m,y_m\n0,1,1\n0,1,1\n",
        "time_s,x_m,y_m\n0,a,1\n1,1,1\n",
        "time_s,x_m,y_m\n0,nan,1\n1,1,1\n",
    ],
)
def test_files_that_are_no_trajectory_are_refused(tmp_path: Path, content: str) -> None:
    file = tmp_path / "way.csv"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match="trajectory"):
        Trajectory.read(file)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="CSV file"):
        Trajectory.read(tmp_path / "nothing.csv")
