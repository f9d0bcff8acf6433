from dataclasses import replace
from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.generation.episode_setup import set_up_episode
from siren_ros.generation.request_files import files_of_request
from siren_ros.params.input_files import files_from_json
from siren_ros.params.resources import params_dir
from siren_ros.scenario.episode import FILES_PARAMETER
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.studies.draws import DrawPlan, Method
from siren_ros.studies.matrix import Study, plan_study

STUDY = Study(("S1", "S2"), ("L0", "own"), seeds=(0, 1, 2))


def test_the_matrix_has_every_cell_once() -> None:
    planned = plan_study(STUDY)
    names = [episode.name for episode in planned]
    assert len(set(names)) == len(names) == 12
    assert "S1_L3_seed2" in names
    assert {episode.request.level for episode in planned} == {"L0", "L2", "L3"}
    assert len({episode.inputs_sha256 for episode in planned}) == 12
    assert planned == plan_study(STUDY)


def test_draws_are_part_of_the_request() -> None:
    study = replace(STUDY, draws=DrawPlan(Method.RANDOM, samples=2, ranges={"emv.speed_mps": (12.0, 14.0)}))
    planned = plan_study(study)
    assert len(planned) == 24
    assert {episode.draw for episode in planned} == {0, 1}
    assert planned[0].name.endswith("_draw0")
    same = {episode.request.values for episode in planned if episode.draw == 1 and episode.request.template == "S1"}
    assert len(same) == 1, "all levels and seeds of a draw share its values"


def test_a_changed_file_changes_the_inputs(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    text = (params_dir() / "templates" / "S2.yaml").read_text(encoding="utf-8")
    hashes = []
    for content in (text, text + "# a remark\n"):
        file.write_text(content, encoding="utf-8")
        hashes.append(plan_study(Study((str(file),)))[0].inputs_sha256)
    assert hashes[0] != hashes[1]


def test_two_episodes_of_one_name_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text((params_dir() / "templates" / "S2.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    with pytest.raises(InputError, match="twice"):
        plan_study(Study(("S2", str(file))))
    with pytest.raises(InputError, match="once"):
        plan_study(Study(("S2",), seeds=(1, 1)))
    with pytest.raises(InputError, match="template"):
        plan_study(Study(("S9",)))


def test_the_files_of_a_request_are_those_of_its_episode() -> None:
    request = EpisodeRequest("S4", sensors="lidar", preset="realistic", look="night")
    described = set_up_episode(request).description.parameters[FILES_PARAMETER]
    assert files_of_request(request) == files_from_json(described)
