from pathlib import Path

from siren_ros.studies.episode_worker import WorkerOptions
from siren_ros.studies.matrix import Study, plan_study
from siren_ros.studies.study_folder import LocalFolder
from siren_ros.studies.workers import LocalWorkers


def test_a_study_that_is_stopped_leaves_no_row_of_what_was_under_way(tmp_path: Path) -> None:
    planned = plan_study(Study(("S2",), seeds=(0, 1, 2), duration_s=0.5))
    endless = plan_study(Study(("S5",), seeds=(0,), duration_s=3000.0))
    rows = LocalWorkers(2).rows([*endless, *planned], LocalFolder(tmp_path), WorkerOptions())
    assert next(rows).episode == planned[0].name
    rows.close()
    assert not (tmp_path / "episodes" / endless[0].group).exists()
    assert not list(tmp_path.glob(".work/*"))
