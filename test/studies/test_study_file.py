from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.params.resources import params_dir
from siren_ros.studies.draws import DrawPlan, Method
from siren_ros.studies.matrix import Study, plan_study
from siren_ros.studies.study_file import grid_of, levels_of, ranges_of, read_study, seeds_of

TEXT = """
templates: [S1, S2]
levels: [L0, own]
seeds: [0:3, 7]
maps: [town, some.xodr]
preset: realistic
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
        preset="realistic",
        risk_videos=2,
        values="demand.background_vehicles=20,duration_s=40",
        draws=DrawPlan(Method.LATIN_HYPERCUBE, samples=16, ranges=ranges_of(["emv.speed_mps=12:15.5"])),
    )


def test_a_grid_and_a_single_word(tmp_path: Path) -> None:
    text = "templates: S3\nseeds: 4\ndraw: {method: grid, values: {emv.speed_mps: [12, 13]}}\n"
    study = read_study(written(tmp_path, text))
    assert study == Study(("S3",), seeds=(4,), draws=grid_of(["emv.speed_mps=12,13"]))


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


@pytest.mark.parametrize("words", [["a"], ["a=1", "a=2"], ["a=x"]])
def test_words_of_a_grid_that_make_no_sense_are_refused(words: list[str]) -> None:
    with pytest.raises(InputError):
        grid_of(words)


def test_the_benchmark_is_a_study_of_the_seven_base_episodes() -> None:
    planned = plan_study(read_study(params_dir() / "studies" / "v1.yaml"))
    assert [episode.name for episode in planned] == [
        f"{template}_{level}_seed0"
        for template, level in zip(
            ("S1", "S2", "S3", "S4", "S5", "S6", "S7"), ("L3", "L2", "L1", "L1", "L1", "L1", "L3"), strict=True
        )
    ]
    assert {episode.request.sensors for episode in planned} == {"full"}


def test_what_a_file_does_not_say_is_as_always(tmp_path: Path) -> None:
    assert read_study(written(tmp_path, "templates: [S1]")) == Study(("S1",))


def test_every_key_has_its_place(tmp_path: Path) -> None:
    text = "templates: [S1]\nsensors: lidar\nlook: night\nduration_s: 30\ndraw: {method: random, samples: 5, seed: 9}"
    study = read_study(written(tmp_path, text))
    assert (study.sensors, study.look, study.duration_s) == ("lidar", "night", 30.0)
    assert study.draws == DrawPlan(Method.RANDOM, samples=5, seed=9)


@pytest.mark.parametrize(("word", "seeds"), [("0", (0,)), ("3", (3,)), ("2:5", (2, 3, 4)), ("4:5", (4,))])
def test_seeds_by_words(word: str, seeds: tuple[int, ...]) -> None:
    assert seeds_of([word]) == seeds
    assert seeds_of(["9", word]) == (9, *seeds)


@pytest.mark.parametrize("word", ["", "a", "1:", ":3", "3:3", "5:2", "-1:2", str(2**31)])
def test_words_that_are_no_seeds(word: str) -> None:
    with pytest.raises(InputError, match="seeds"):
        seeds_of([word])
    assert seeds_of([str(2**31 - 1)]) == (2**31 - 1,)


@pytest.mark.parametrize("words", [["a=1:2", "a=1:2"], ["a=1"], ["a=1:2:3"], ["a=x:2"]])
def test_words_of_a_range_that_make_no_sense_are_refused(words: list[str]) -> None:
    with pytest.raises(InputError):
        ranges_of(words)
