"""What ``import siren_ros`` offers: a dozen functions that make, read, judge, score, grade and export, without ROS."""

import ast
import inspect
import io
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_episode import quick_template
from repository import REPOSITORY
from tqdm import tqdm

import siren_ros
from siren_ros.base.at_import import full_name
from siren_ros.simulation.world.actors import EventKind

PUBLIC_MODULES = {"siren_ros", "siren_ros.learning", "siren_ros.training.torch_samples"}
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


@pytest.fixture(scope="module")
def civilian(bag: Path) -> int:
    """A driver of that episode, which has no AV under test."""
    return next(key for key, actor in siren_ros.read_record(bag).actors.items() if not actor.is_emv)


def test_the_import_loads_neither_numpy_nor_the_rest_of_the_library() -> None:
    program = "import sys, siren_ros; print(*sorted(name for name in sys.modules if name.startswith(('siren', 'num'))))"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    loaded = done.stdout.split()
    assert [name for name in loaded if name.startswith("siren")] == [
        "siren_ros",
        "siren_ros.base",
        "siren_ros.base.at_import",
    ]
    assert "numpy" not in loaded


def test_about_a_dozen_names_are_public_and_all_are_there() -> None:
    assert len(FUNCTIONS) == 10
    assert 12 <= len(siren_ros.__all__) <= 19
    assert set(siren_ros.__all__) <= set(dir(siren_ros))
    assert all(getattr(siren_ros, name).__doc__ for name in siren_ros.__all__)


def test_functions_that_take_long_move_a_bar_to_its_end(bag: Path, civilian: int, tmp_path: Path) -> None:
    study = siren_ros.Study(templates=("S2",), seeds=(0, 1), duration_s=1.0)
    request = siren_ros.EpisodeRequest(template="S2", sensors="none", duration_s=1.0)
    results, ends = [], []
    for run in (
        lambda bar: siren_ros.make_episode(request, tmp_path / "S2", progress=bar),
        lambda bar: siren_ros.score_predictions([bag, bag], progress=bar),
        lambda bar: siren_ros.export("csv", bag, tmp_path / "csv", progress=bar),
        lambda bar: siren_ros.generate_study(study, tmp_path / "study", progress=bar),
        lambda bar: siren_ros.generate_study(study, tmp_path / "study", progress=bar),
        lambda bar: siren_ros.examine([bag, bag, bag], actor_id=civilian, progress=bar),
    ):
        with tqdm(file=io.StringIO()) as bar:
            results.append(run(bar))
        ends.append((bar.n, bar.total))
    assert ends == [(20, 20), (2, 2), (pytest.approx(12.0, abs=1.0), 12.0), (2, 2), (2, 2), (3, 3)]
    assert results[2].notes == ()
    assert any((tmp_path / "csv").rglob("trajectory.csv"))
    assert [row.steps for row in results[3].rows] == [20, 20]
    assert results[4].kept == 2


def public_of(module: str) -> set[str]:
    """The names in a module's ``__all__``, read from its source: torch need not be there."""
    if module == "siren_ros":
        return set(siren_ros.__all__)
    file = REPOSITORY / full_name(module).replace(".", "/")
    file = file / "__init__.py" if file.is_dir() else file.with_suffix(".py")
    assigned = [node for node in ast.parse(file.read_text(encoding="utf-8")).body if isinstance(node, ast.Assign)]
    return {
        name for node in assigned if ast.unparse(node.targets[0]) == "__all__" for name in ast.literal_eval(node.value)
    }


def private_imports(program: str) -> list[str]:
    """What a program imports of the library that is not public."""
    found = []
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in {"siren_ros", "siren_nodes"}:
            public = public_of(node.module or "") if node.module in PUBLIC_MODULES else set()
            found += [f"{node.module}.{alias.name}" for alias in node.names if alias.name not in public]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names if alias.name.split(".")[0] in {"siren_ros", "siren_nodes"}]
            found += [name for name in names if name not in PUBLIC_MODULES]
    return found


@pytest.mark.parametrize("file", sorted((REPOSITORY / "examples").glob("*.py")), ids=lambda file: file.stem)
def test_examples_import_public_names_alone(file: Path) -> None:
    assert private_imports(file.read_text(encoding="utf-8")) == []


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


@pytest.fixture(scope="module")
def returned(bag: Path, civilian: int, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What some of the public functions return."""
    place = tmp_path_factory.mktemp("returned")
    study = siren_ros.Study(templates=("S2",), seeds=(0,), duration_s=1.0)
    return {
        "read_record": siren_ros.read_record(bag),
        "score_predictions": siren_ros.score_predictions(bag, ["cv", "idm"]),
        "generate_study": siren_ros.generate_study(study, place / "study"),
        "examine": siren_ros.examine(bag, actor_id=civilian, rulebook="california"),
    }


def test_tables_become_frames_of_pandas(returned: dict[str, Any]) -> None:
    pytest.importorskip("pandas")
    table, record = returned["score_predictions"], returned["read_record"]
    scores = table.to_pandas()
    assert [*scores.columns] == ["model", "kind", "group", "metric", "value", "low", "high", "episodes", "samples"]
    assert len(scores) == len(table.cells)
    row = scores[(scores.model == "idm") & (scores.group == "S2") & (scores.metric == "fde_m")]
    assert row.value.item() == table.value("idm", "S2", "fde_m")
    assert scores.value.isna().any()
    assert record.rows.to_pandas().x_m.tolist() == record.rows.x_m.tolist()
    assert returned["generate_study"].to_pandas().steps.tolist() == [20]
    (sitting,) = returned["examine"].sittings
    graded = returned["examine"].to_pandas()
    assert [*graded.columns] == ["episode", "bag", "actor_id", "clause", "grade", "value", "unit", "time_s"]
    assert graded.grade.tolist() == [mark.grade for mark in sitting.marks]
    assert (graded.value.isna() == (graded.grade == "not applicable")).all()
    assert graded.grade.nunique() > 1


def test_frames_without_pandas_are_refused_by_name(returned: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    names = ("score_predictions", "generate_study", "examine")
    for table in (returned["read_record"].rows, *(returned[name] for name in names)):
        with pytest.raises(siren_ros.InputError, match="pip install pandas"):
            table.to_pandas()


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("cv", "S2", "ade"), "metric: 'ade' .*ade_m, fde_m"),
        (("cvv", "S2", "ade_m"), "model: 'cvv' .*one of cv, idm"),
        (("cv", "S3", "ade_m"), "group: 'S3' .*one of all, S2"),
    ],
)
def test_a_score_of_an_unknown_name_is_refused(returned: dict[str, Any], names: tuple[str, ...], message: str) -> None:
    with pytest.raises(siren_ros.InputError, match=message):
        returned["score_predictions"].value(*names)


def test_a_valid_score_without_a_value_is_none(returned: dict[str, Any]) -> None:
    assert returned["score_predictions"].value("cv", "S2", "brier_score") is None  # one hypothesis says nothing
    assert returned["score_predictions"].value("cv", "held", "path_collision_rate") is None  # a metric of frames


def test_a_record_refuses_what_it_does_not_have(returned: dict[str, Any]) -> None:
    record = returned["read_record"]
    with pytest.raises(siren_ros.InputError, match=r"actor_id: 99999 .*keys of `actors`"):
        record.track(99999)
    with pytest.raises(siren_ros.InputError, match=r"kind: 'crash' .*collision"):
        record.events_of("crash")
    with pytest.raises(siren_ros.InputError, match="signal_id: 'nowhere'"):
        record.signal_states("nowhere")
    with pytest.raises(siren_ros.InputError, match="kind: 'templates'"):
        returned["score_predictions"].of_kind("templates")
    assert record.events_of("siren_on") == record.events_of(EventKind.SIREN_ON) != ()
    assert [group.name for group in returned["score_predictions"].of_kind("template")] == ["S2"]


_PAIRED = {"progress", "evades"}
"""Monitors that need the episode of the paper's driver."""


def test_a_driver_is_examined_in_a_study_and_compared_with_the_papers(tmp_path: Path) -> None:
    study = siren_ros.Study(templates=(quick_template("S2"),), levels=("L3",), seeds=(0,), duration_s=2.0)
    first = siren_ros.examine(str(tmp_path), "lawful-california", study=study, rulebook="california")
    (sitting,) = first.sittings
    assert first.driver == "lawful-california"
    assert {*sitting.others} == {"emv_delay_s", "braked_hard"}
    again = siren_ros.examine([sitting.bag], rulebook="california")  # the AV under test of a recorded episode
    assert again.driver == "the AV under test"
    alone = [[mark for mark in one.marks if mark.clause.monitor not in _PAIRED] for one in (sitting, *again.sittings)]
    assert alone[0] == alone[1] != []
    (alone,) = siren_ros.examine(
        tmp_path, "lawful-california", study=study, rulebook="california", paired=False
    ).sittings
    assert alone.others == {}


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({}, "bag: .* an episode with an AV under test"),
        ({"actor_id": 99999}, "a civilian vehicle"),
        ({"rulebook": "atlantis"}, "one of base, california, germany, international"),
        ({"study": siren_ros.Study(templates=("S2",))}, "driver: '' .*the name of a driver"),
        ({"study": siren_ros.Study(templates=("S2",)), "driver": "nobody"}, "driver: 'nobody' .*idm"),
        ({"study": siren_ros.Study(templates=("S2",)), "driver": "idm", "bags": ["a", "b"]}, "bags: .*one folder"),
    ],
)
def test_an_exam_that_cannot_be_made_is_refused(bag: Path, asked: dict[str, Any], message: str) -> None:
    with pytest.raises(siren_ros.InputError, match=message):
        siren_ros.examine(**{"bags": bag, **asked})


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


def test_videos_with_risk_labels_are_left_to_the_command(tmp_path: Path) -> None:
    with pytest.raises(siren_ros.InputError, match="siren generate"):
        siren_ros.generate_study(siren_ros.Study(templates=("S2",), risk_videos=7), tmp_path)
