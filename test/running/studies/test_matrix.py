import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from siren_ros.base.params.folders import params_dir
from siren_ros.base.params.parameters import files_from_json
from siren_ros.errors import InputError
from siren_ros.running.generation.episode_setup import files_of_request, set_up_episode
from siren_ros.running.studies import matrix
from siren_ros.running.studies.matrix import (
    DrawPlan,
    Method,
    Seat,
    Study,
    draws_of,
    grid_of,
    levels_of,
    plan_study,
    ranges_of,
    read_study,
    seeds_of,
)
from siren_ros.simulation.roads.maps.map_compiler import name_of_map
from siren_ros.simulation.scenario.episode import FILES_PARAMETER, EpisodeRequest
from siren_ros.simulation.scenario.scenario import PEOPLE, VARIETY
from siren_ros.simulation.scenario.templates import load_template

S2 = load_template("S2")
RANGES = {"emv.speed_mps": (12.0, 16.0), "demand.background_vehicles": (16.0, 19.0)}


def test_a_grid_is_every_combination() -> None:
    plan = DrawPlan(
        Method.GRID, values={"emv.speed_mps": (12.0, 14.0), "demand.background_vehicles": (16.0, 20.0, 24.0)}
    )
    draws = draws_of(plan, S2)
    assert len(draws) == len({tuple(sorted(values.items())) for values in draws}) == 6
    assert draws[0] == {"demand.background_vehicles": 16.0, "emv.speed_mps": 12.0}


def test_a_latin_hypercube_has_one_draw_in_each_slice_of_each_parameter() -> None:
    plan = DrawPlan(Method.LATIN_HYPERCUBE, samples=8, ranges=RANGES)
    draws = draws_of(plan, S2)
    slices = np.floor([(values["emv.speed_mps"] - 12.0) / 0.5 for values in draws])
    assert sorted(slices) == list(range(8))
    counts = [values["demand.background_vehicles"] for values in draws]
    assert sorted(counts) == [16.0, 16.0, 17.0, 17.0, 18.0, 18.0, 19.0, 19.0]


def test_a_study_draws_parameters_of_drivers_within_their_ranges() -> None:
    name = "emv_driver.corridor.narrow_mps"
    draws = draws_of(DrawPlan(Method.RANDOM, samples=3, ranges={name: (4.0, 6.0)}), S2)
    assert all(set(values) == {name} and 4.0 <= values[name] <= 6.0 for values in draws)
    with pytest.raises(InputError, match="narrow_mps"):
        draws_of(DrawPlan(Method.RANDOM, samples=3, ranges={name: (4.0, 60.0)}), S2)


@pytest.mark.parametrize("method", [Method.RANDOM, Method.LATIN_HYPERCUBE])
def test_draws_depend_on_seed_and_template_alone(method: Method) -> None:
    plan = DrawPlan(method, samples=5, seed=3)
    assert draws_of(plan, S2) == draws_of(plan, S2)
    assert draws_of(plan, S2) != draws_of(DrawPlan(method, samples=5, seed=4), S2)
    assert set(draws_of(plan, S2)[0]) == set(S2.ranges) - {
        "duration_s",
        "emv.count",
        "emv.crossing",
        "emv.crossing_after_s",
        *PEOPLE,
        *VARIETY,
    }


def test_random_draws_stay_the_same_when_more_are_asked_for() -> None:
    few, many = (draws_of(DrawPlan(Method.RANDOM, samples=count, ranges=RANGES), S2) for count in (3, 9))
    assert many[:3] == few


@pytest.mark.parametrize(
    "plan",
    [
        DrawPlan(Method.GRID, values={"emv.speed_mps": (99.0,)}),
        DrawPlan(Method.GRID, values={"emv.colour": (1.0,)}),
        DrawPlan(Method.RANDOM, samples=3, ranges={"emv.colour": (0.0, 1.0)}),
        DrawPlan(Method.RANDOM, samples=3, ranges={"emv.speed_mps": (14.0, 99.0)}),
        DrawPlan(Method.LATIN_HYPERCUBE, samples=0),
    ],
)
def test_what_the_template_does_not_allow_is_refused(plan: DrawPlan) -> None:
    with pytest.raises(InputError):
        draws_of(plan, S2)


def test_values_go_to_their_own_parameters() -> None:
    """Each one lies in its own range, and whole numbers are whole and reach both ends."""
    ranges = {"emv.speed_mps": (12.0, 12.5), "demand.background_vehicles": (16.0, 18.0)}
    draws = draws_of(DrawPlan(Method.RANDOM, samples=60, ranges=ranges), S2)
    speeds = [values["emv.speed_mps"] for values in draws]
    counts = [values["demand.background_vehicles"] for values in draws]
    assert 12.0 <= min(speeds) < 12.05
    assert 12.45 < max(speeds) <= 12.5
    assert set(counts) == {16.0, 17.0, 18.0}
    assert np.corrcoef(speeds, counts)[0, 1] < 0.5, "each has numbers of its own"
    (same,) = draws_of(DrawPlan(Method.RANDOM, samples=1, ranges={"emv.speed_mps": (13.0, 13.0)}), S2)
    assert same == {"emv.speed_mps": 13.0}


STUDY = Study(("S1", "S2"), ("L0", "own"), seeds=(0, 1, 2))


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
    text = (params_dir() / "templates" / "S2.yaml").read_text(encoding="utf-8")
    contents = (text, text + "# a remark\n")
    first, second = (plan_study(Study((str(written(tmp_path, content)),)))[0].inputs_sha256 for content in contents)
    assert first != second


def test_the_users_traffic_is_an_input_by_its_content(tmp_path: Path) -> None:
    file, hashes = tmp_path / "own.rou.xml", []
    for vehicle in ('<trip id="a"/>', '<trip id="b"/>', '<trip id="a"/>'):
        file.write_text(f"<routes>{vehicle}</routes>")
        (planned,) = plan_study(Study(("S2",), demand=str(file)))
        assert planned.request.demand == str(file)
        hashes.append(planned.inputs_sha256)
    assert hashes[0] == hashes[2] != hashes[1]
    seats = (Seat("idm"), Seat("lawful-california"))
    hashes += [plan_study(Study(("S2",), demand=str(file), seat=seat))[0].inputs_sha256 for seat in seats]
    assert len({*hashes}) == 4


def test_another_version_of_siren_is_another_input(monkeypatch: pytest.MonkeyPatch) -> None:
    (first,) = plan_study(Study(("S2",)))
    monkeypatch.setattr(matrix, "present_versions", lambda: {"siren": "0"})
    assert plan_study(Study(("S2",)))[0].inputs_sha256 != first.inputs_sha256


def test_two_episodes_of_one_name_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path, (params_dir() / "templates" / "S2.yaml").read_text(encoding="utf-8"))
    for study, said in ((Study(("S2", str(file))), "twice"), (Study(("S2",), seeds=(1, 1)), "once")):
        with pytest.raises(InputError, match=said):
            plan_study(study)
    with pytest.raises(InputError, match="template"):
        plan_study(Study(("S9",)))


def test_the_files_of_a_request_are_those_of_its_episode() -> None:
    request = EpisodeRequest("S4", sensors="lidar", preset="realistic", look="night")
    described = set_up_episode(request).description.parameters[FILES_PARAMETER]
    assert files_of_request(request) == files_from_json(described)


def test_templates_change_first_then_levels_maps_draws_and_seeds_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """A map has a name in the episode's, the town has none; draws are counted from 0."""
    monkeypatch.setattr(matrix, "source_sha256_of", lambda _: "")
    study = Study(
        ("S2", "S1"), ("own", "L0"), (7, 3), ("town", "maps/Some Map.xodr"),
        duration_s=30.0, sensors="lidar", look="rain",
        draws=DrawPlan(Method.GRID, values={"emv.speed_mps": (12.0, 13.0)}),
    )  # fmt: skip
    planned = plan_study(study)
    names = [episode.name for episode in planned]
    elsewhere = name_of_map(Path("maps/Some Map.xodr"))
    groups = ("S2_L2", "S1_L3", "S2_L0", "S1_L0")
    assert names[:8] == [f"{group}{place}_seed7_draw0" for place in ("", f"_{elsewhere}") for group in groups]
    assert [name for name in names if name.startswith("S1_L0_seed")] == [
        f"S1_L0_seed{seed}_draw{draw}" for seed in (7, 3) for draw in (0, 1)
    ]
    assert [episode.group for episode in planned[:5]] == ["S2_L2", "S1_L3", "S2_L0", "S1_L0", f"S2_L2_{elsewhere}"]
    first, other = planned[0].request, planned[4].request
    assert (first.map, other.map) == ("", "maps/Some Map.xodr")
    assert (first.duration_s, first.sensors, first.look, first.preset) == (30.0, "lidar", "rain", "paper")
    assert (first.values, planned[8].request.values) == ("emv.speed_mps=12.0", "emv.speed_mps=13.0")
    assert {episode.draw for episode in planned} == {0, 1}


def test_sites_are_swept_between_maps_and_levels() -> None:
    """A name's folder has no characters that folders cannot have; a drawn site has no name there."""
    planned = plan_study(Study(("S3", "S4"), ("own", "L0"), sites=("drawn", "a/1..b#2")))
    assert [episode.name for episode in planned[:5]] == [
        *("S3_L1_seed0", "S4_L1_seed0", "S3_L0_seed0", "S4_L0_seed0"),
        "S3_L1_a-1..b#2_seed0",
    ]
    assert [episode.request.site for episode in planned] == [""] * 4 + ["a/1..b#2"] * 4
    assert len({episode.inputs_sha256 for episode in planned}) == 8


@pytest.mark.parametrize("field", ["templates", "levels", "seeds", "maps", "sites"])
def test_nothing_of_a_kind_is_no_study(field: str) -> None:
    with pytest.raises(InputError, match=field):
        plan_study(replace(STUDY, **{field: ()}))


TEXT = """
templates: [S1, S2]
levels: [L0, own]
seeds: [0:3, 7]
maps: [town, some.xodr]
sites: [drawn, a..b]
preset: realistic
sensors: lidar
look: night
duration_s: 30
risk_videos: 2
values: demand.background_vehicles=20,duration_s=40
draw:
  method: latin_hypercube
  samples: 16
  ranges: {emv.speed_mps: [12, 15.5]}
"""


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "study.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_file_says_what_the_command_line_says(tmp_path: Path) -> None:
    assert read_study(written(tmp_path, TEXT)) == Study(
        templates=("S1", "S2"),
        levels=levels_of(["L0", "own"]),
        seeds=seeds_of(["0:3", "7"]),
        maps=("town", "some.xodr"),
        sites=("drawn", "a..b"),
        preset="realistic",
        sensors="lidar",
        look="night",
        duration_s=30.0,
        risk_videos=2,
        values="demand.background_vehicles=20,duration_s=40",
        draws=DrawPlan(Method.LATIN_HYPERCUBE, samples=16, ranges=ranges_of(["emv.speed_mps=12:15.5"])),
    )


@pytest.mark.parametrize(
    "text",
    [
        "levels: [L0]",
        "templates: [S1]\nsize: 3",
        "templates: [S1]\nlevels: [L7]",
        "templates: [S1]\nseeds: [5:5]",
        "templates: [S1]\nseeds: [-1]",
        "templates: [S1]\ndraw: {method: sobol, samples: 3}",
        "templates: [S1]\ndraw: {method: random}",
        "templates: [S1]\ndraw: {method: grid, values: {a: [x]}}",
        "templates: [S1]\ndraw: {method: random, samples: 3, ranges: {a: [1]}}",
        "templates: [S1]\nrisk_videos: -1",
        "templates: [S1]\nrisk_videos: [74, 25, 6]",
        "templates: {S1: 1}",
    ],
)
def test_mistakes_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError):
        read_study(written(tmp_path, text))


@pytest.mark.parametrize(
    ("reader", "words"),
    [
        *((grid_of, words) for words in (["a"], ["a=1", "a=2"], ["a=x"])),
        *((ranges_of, words) for words in (["a=1:2", "a=1:2"], ["a=1"], ["a=1:2:3"], ["a=x:2"])),
    ],
)
def test_words_of_grids_and_ranges_that_make_no_sense_are_refused(reader, words) -> None:
    with pytest.raises(InputError):
        reader(words)


def test_the_benchmark_is_a_study_of_the_seven_base_episodes() -> None:
    planned = plan_study(read_study(params_dir() / "studies" / "v1.yaml"))
    groups = ("S1_L3", "S2_L2", "S3_L1", "S4_L1", "S5_L1", "S6_L1", "S7_L3")
    assert [episode.name for episode in planned] == [f"{group}_seed0" for group in groups]
    assert {episode.request.sensors for episode in planned} == {"full"}


@pytest.mark.parametrize(
    ("text", "study"),
    [
        ("templates: [S1]", Study(("S1",))),
        (
            "templates: S3\nseeds: 4\ndraw: {method: grid, values: {emv.speed_mps: [12, 13]}}",
            Study(("S3",), seeds=(4,), draws=grid_of(["emv.speed_mps=12,13"])),
        ),
        (
            "templates: S1\ndraw: {method: random, samples: 5, seed: 9}",
            Study(("S1",), draws=DrawPlan(Method.RANDOM, samples=5, seed=9)),
        ),
    ],
)
def test_single_words_and_other_draws(tmp_path: Path, text: str, study: Study) -> None:
    assert read_study(written(tmp_path, text)) == study


@pytest.mark.parametrize(("word", "seeds"), [("0", (0,)), ("3", (3,)), ("2:5", (2, 3, 4)), ("4:5", (4,))])
def test_seeds_by_words(word: str, seeds: tuple[int, ...]) -> None:
    assert seeds_of([word]) == seeds
    assert seeds_of(["9", word]) == (9, *seeds)


@pytest.mark.parametrize("word", ["", "a", "1:", ":3", "3:3", "5:2", "-1:2", str(2**31)])
def test_words_that_are_no_seeds(word: str) -> None:
    with pytest.raises(InputError, match="seeds"):
        seeds_of([word])
    assert seeds_of([str(2**31 - 1)]) == (2**31 - 1,)


def test_a_template_with_its_own_map_is_made_on_it_unless_another_one_is_named() -> None:
    def maps_of(asked: str) -> list[str]:
        return [episode.request.map for episode in plan_study(Study(("S8", "S2"), maps=(asked,)))]

    assert maps_of("town") == ["motorway", ""]
    assert maps_of("motorway") == ["motorway", "motorway"]


def test_a_sealed_study_is_planned_anew_with_another_salt(tmp_path: Path) -> None:
    hashes = set()
    for number in range(2):
        (tmp_path / f"salt{number}").write_text(f"{number:032x}")
        (planned,) = plan_study(Study(("S2",), salt=str(tmp_path / f"salt{number}")))
        hashes.add(planned.inputs_sha256)
    (planned,) = plan_study(Study(("S2",)))
    assert len({*hashes, planned.inputs_sha256}) == 3
