import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from siren_ros.errors import InputError
from siren_ros.generation.episode_setup import set_up_episode
from siren_ros.generation.request_files import files_of_request
from siren_ros.params.input_files import files_from_json
from siren_ros.params.resources import params_dir
from siren_ros.roads.maps.map_compiler import name_of_map
from siren_ros.scenario.episode import FILES_PARAMETER
from siren_ros.scenario.request import EpisodeRequest
from siren_ros.studies import matrix
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


def test_values_are_those_of_every_request_as_they_were_typed() -> None:
    planned = plan_study(replace(STUDY, values="emv.speed_mps=12"))
    assert {episode.request.values for episode in planned} == {"emv.speed_mps=12"}
    drawn = DrawPlan(Method.GRID, values={"demand.background_vehicles": (20.0, 22.0)})
    planned = plan_study(replace(STUDY, templates=("S2",), values="emv.speed_mps=12", draws=drawn))
    assert {episode.request.values for episode in planned} == {
        f"demand.background_vehicles={count},emv.speed_mps=12.0" for count in (20.0, 22.0)
    }


@pytest.mark.parametrize(
    ("asked", "line"),
    [
        ({"values": "emv.speed_mps=12"}, "values: 'emv.speed_mps=12' cannot be used; allowed: parameters that"),
        ({"values": "emv.speed_mps=99"}, "emv.speed_mps: 99.0 cannot be used; allowed: a number from"),
        ({"values": "emv.speed_mps=a"}, "values: 'emv.speed_mps=a' cannot be used; allowed: PATH=NUMBER"),
        ({"duration_s": math.nan}, "duration_s: nan cannot be used; allowed: a number from 0 to 3600"),
        ({"duration_s": 1e12}, "duration_s: 1000000000000.0 cannot be used; allowed: a number from 0 to 3600"),
    ],
)
def test_what_the_request_refuses_the_study_refuses(asked: dict[str, Any], line: str) -> None:
    drawn = DrawPlan(Method.GRID, values={"emv.speed_mps": (12.0, 13.0)})
    with pytest.raises(InputError) as refused:
        plan_study(replace(STUDY, draws=drawn, **asked))
    assert str(refused.value).startswith(line)


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


def test_templates_change_first_then_levels_maps_draws_and_seeds_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """A map has a name in the episode's, the town has none; draws are counted from 0."""
    monkeypatch.setattr(matrix._Inputs, "sha256_of", lambda *_: "")
    study = Study(
        ("S2", "S1"), ("own", "L0"), (7, 3), ("town", "maps/Some Map.xodr"),
        duration_s=30.0, sensors="lidar", look="rain",
        draws=DrawPlan(Method.GRID, values={"emv.speed_mps": (12.0, 13.0)}),
    )  # fmt: skip
    planned = plan_study(study)
    names = [episode.name for episode in planned]
    elsewhere = name_of_map(Path("maps/Some Map.xodr"))
    assert names[:8] == [
        "S2_L2_seed7_draw0",
        "S1_L3_seed7_draw0",
        "S2_L0_seed7_draw0",
        "S1_L0_seed7_draw0",
        f"S2_L2_{elsewhere}_seed7_draw0",
        f"S1_L3_{elsewhere}_seed7_draw0",
        f"S2_L0_{elsewhere}_seed7_draw0",
        f"S1_L0_{elsewhere}_seed7_draw0",
    ]
    assert [name for name in names if name.startswith("S1_L0_seed")] == [
        f"S1_L0_seed{seed}_draw{draw}" for seed in (7, 3) for draw in (0, 1)
    ]
    assert [episode.group for episode in planned[:5]] == ["S2_L2", "S1_L3", "S2_L0", "S1_L0", f"S2_L2_{elsewhere}"]
    first, other = planned[0].request, planned[4].request
    assert (first.map, other.map) == ("", "maps/Some Map.xodr")
    assert (first.duration_s, first.sensors, first.look, first.preset) == (30.0, "lidar", "rain", "paper")
    assert (first.values, planned[8].request.values) == ("emv.speed_mps=12.0", "emv.speed_mps=13.0")
    assert {episode.draw for episode in planned} == {0, 1}


def test_without_draws_none_is_counted() -> None:
    (planned,) = plan_study(Study(("S2",), ("L1",)))
    assert (planned.name, planned.draw, planned.request.values) == ("S2_L1_seed0", -1, "")


@pytest.mark.parametrize("field", ["templates", "levels", "seeds", "maps"])
def test_nothing_of_a_kind_is_no_study(field: str) -> None:
    with pytest.raises(InputError, match=field):
        plan_study(replace(STUDY, **{field: ()}))
