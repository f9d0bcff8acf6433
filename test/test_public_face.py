"""What ``import siren_ros`` offers: a dozen functions that make, read, judge, score and export, without ROS."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from repository import REPOSITORY

import siren_ros

FUNCTIONS = [name for name in siren_ros.__all__ if inspect.isfunction(getattr(siren_ros, name))]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An episode of 12 s without sensors."""
    path = tmp_path_factory.mktemp("made") / "S2"
    episode = siren_ros.make_episode(
        siren_ros.EpisodeRequest(template="S2", seed=3, sensors="none", duration_s=12.0), path
    )
    assert episode.bag is not None
    return path


def test_the_import_loads_neither_numpy_nor_the_rest_of_the_library() -> None:
    program = "import sys, siren_ros; print(*sorted(name for name in sys.modules if name.startswith(('siren', 'num'))))"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    loaded = done.stdout.split()
    assert [name for name in loaded if name.startswith("siren")] == [
        "siren_ros",
        "siren_ros.numerics",
        "siren_ros.numerics.arithmetic",
    ]
    assert "numpy" not in loaded


def test_about_a_dozen_names_are_public_and_all_are_there() -> None:
    assert len(FUNCTIONS) == 9
    assert 12 <= len(siren_ros.__all__) <= 16
    assert set(siren_ros.__all__) <= set(dir(siren_ros))
    assert all(getattr(siren_ros, name).__doc__ for name in siren_ros.__all__)


def test_no_public_name_hides_a_folder_or_a_module() -> None:
    inside = {path.stem for path in (REPOSITORY / "siren_ros").iterdir()}
    assert inside.isdisjoint(siren_ros.__all__)


def test_a_name_that_is_not_public_is_refused_as_python_does_it() -> None:
    with pytest.raises(AttributeError, match="module 'siren_ros' has no attribute 'no_such_name'"):
        _ = siren_ros.no_such_name  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_functions_say_what_they_take_and_what_goes_wrong(name: str) -> None:
    function = getattr(siren_ros, name)
    text = inspect.getdoc(function) or ""
    assert "Raises:" in text
    assert all(
        re.search(rf"^    {argument}: ", text, re.MULTILINE) for argument in inspect.signature(function).parameters
    ) or (list(inspect.signature(function).parameters) == ["record"])


def test_a_made_episode_is_read_judged_and_verified(bag: Path) -> None:
    record = siren_ros.read_record(bag)
    assert record.description.template == "S2"
    assert record.steps == 12 * 20
    assert siren_ros.judge(record) == siren_ros.verify(record).verdict


@pytest.mark.parametrize("kind", [str, Path])
def test_an_episode_is_not_made_twice_at_one_place(bag: Path, kind: type[str] | type[Path]) -> None:
    with pytest.raises(siren_ros.InputError):
        siren_ros.make_episode(siren_ros.EpisodeRequest(template="S2", sensors="none", duration_s=1.0), kind(bag))


def test_a_place_is_a_path_or_its_text_and_one_or_several(bag: Path, tmp_path: Path) -> None:
    assert siren_ros.read_record(str(bag)).state_hashes == siren_ros.read_record(bag).state_hashes
    for bags in (bag, str(bag), [str(bag)]):
        assert [len(samples) for samples in siren_ros.iterate_samples(bags)] == [
            len(samples) for samples in siren_ros.iterate_samples([bag])
        ]
    assert siren_ros.export("csv", str(bag), str(tmp_path / "csv")).notes == ()


def test_predictions_are_scored_on_the_samples_that_are_iterated(bag: Path) -> None:
    (samples,) = siren_ros.iterate_samples([bag])
    table = siren_ros.score_predictions([bag], ["cv"])
    cell = table.cells["cv", "S2", "ade_m"]
    assert cell.samples == len(samples) > 0
    constant_velocity = samples.batch.xy_m[:, None] + samples.batch.velocity_mps[:, None] * (
        0.2 * np.arange(1, 26)[:, None]
    )
    ade_m = np.hypot(*np.moveaxis(constant_velocity - samples.future_xy_m, -1, 0)).mean()
    assert cell.interval.value == pytest.approx(ade_m)


def test_samples_of_other_windows_and_vehicles_are_others(bag: Path) -> None:
    (everybody,) = siren_ros.iterate_samples([bag], population="all")
    (region,) = siren_ros.iterate_samples([bag])
    assert len(everybody) >= len(region)
    (argoverse,) = siren_ros.iterate_samples([bag], window="argoverse2", population="all")
    assert argoverse.batch.window.points == 50


@pytest.mark.parametrize("argument", ["window", "population"])
def test_what_samples_cannot_be_is_named(bag: Path, argument: str) -> None:
    with pytest.raises(siren_ros.InputError, match=argument):
        next(siren_ros.iterate_samples([bag], **{argument: "wrong"}))


def test_an_episode_is_exported(bag: Path, tmp_path: Path) -> None:
    result = siren_ros.export("csv", [bag], tmp_path / "csv")
    assert result.notes == ()
    assert (tmp_path / "csv" / "README.md").exists() or any((tmp_path / "csv").rglob("trajectory.csv"))


def test_frames_need_a_lidar(bag: Path) -> None:
    with pytest.raises(siren_ros.BagError, match="LiDAR"):
        next(siren_ros.iterate_frames(bag))


def test_frames_come_with_points_and_labels(tmp_path: Path) -> None:
    request = siren_ros.EpisodeRequest(template="S2", sensors="lidar", duration_s=0.5)
    siren_ros.make_episode(request, tmp_path / "bag")
    bag = str(tmp_path / "bag")
    frames = [frame for frame in siren_ros.iterate_frames(bag, pose=True) if frame.points is not None]
    assert len(frames) == 10  # 20 Hz
    assert all(len(frame.points) and frame.map_from_base is not None for frame in frames if frame.points is not None)


def test_a_study_is_generated_and_continued(tmp_path: Path) -> None:
    study = siren_ros.Study(templates=("S2",), seeds=(0, 1), duration_s=1.0)
    assert [row.steps for row in siren_ros.generate_study(study, tmp_path, workers=2).rows] == [20, 20]
    assert siren_ros.generate_study(study, str(tmp_path)).kept == 2


def test_videos_with_risk_labels_are_left_to_the_command(tmp_path: Path) -> None:
    with pytest.raises(siren_ros.InputError, match="siren generate"):
        siren_ros.generate_study(siren_ros.Study(templates=("S2",), risk_videos=7), tmp_path)
