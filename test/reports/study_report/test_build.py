"""The page of a study: its parts, its sections, and what readers find in them."""

import json
import re
from dataclasses import replace
from pathlib import Path
from shlex import split
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser_pages import PageBrowser
from evaluation.made_profiles import profile
from evaluation.made_records import moving, record_with
from evaluation.made_scores import reported_scores
from synthetic_episode import NET_XML

from siren_ros.base.tables import Measure, Table
from siren_ros.cli.evaluation.yielding import score_bag
from siren_ros.cli.generate import study_of
from siren_ros.cli.main import parser
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import InputError
from siren_ros.reports.study_report import build
from siren_ros.reports.study_report.build import (
    build_page,
    chosen_episodes,
    detection_section,
    diversity_section,
    film_steps,
    generated_section,
    making_way_section,
    prediction_section,
    risk_section,
)
from siren_ros.reports.study_report.page import generate_command
from siren_ros.reports.study_report.study import PageOptions, StudyMeasures, StudyRows, measure_study, stored_tables
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import DrawPlan, Method, PlannedEpisode, Study
from siren_ros.scoring.evaluation.prediction.reports.report import prediction_tables
from siren_ros.scoring.evaluation.prediction.reports.score_table import differences, score_table
from siren_ros.scoring.evaluation.prediction.scoring import ScoringJob, score_bags
from siren_ros.scoring.evaluation.yielding.metrics import EPISODE_METRICS, PEOPLE_METRICS
from siren_ros.scoring.evaluation.yielding.scoring import DriverMarks, ScoredEpisode, YieldScores
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import Event, EventKind


def test_the_page_opens_in_a_browser_without_network_or_complaint(made: SimpleNamespace, browser: PageBrowser) -> None:
    with browser.opened(made.file) as opened:
        assert opened.problems == []
        assert opened.requests == []
        opened.page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
        assert opened.page.locator("img").count() >= 8
        assert opened.empty_images() == []
        assert opened.page.locator("video").count() == 1
        assert opened.unplayable_videos() == []
        targets = opened.page.evaluate("[...document.querySelectorAll('nav a')].map(a => a.getAttribute('href'))")
        assert targets == [f"#section_{section.key}" for section in made.page.sections]
        for key, table in made.tables.items():
            shown = opened.table(f"#{key}")
            assert shown == [list(table.head), *map(list, table.cells())], key
        ids = opened.page.evaluate("[...document.querySelectorAll('[id]')].map(one => one.id)")
        assert len(ids) == len(set(ids))


def test_the_page_has_all_its_parts_and_its_texts_stay_text(made: SimpleNamespace) -> None:
    content = made.file.read_text(encoding="utf-8")
    assert "no site on &lt;this&gt; map" in content
    assert "<this>" not in content
    assert not re.search(r"(?:src|href)=\"(?!data:|#|my%20%231%20pages/)", content), "the rest is inside the file"
    rows = {row[:2]: row for row in made.tables["generated_groups"].cells()}
    assert rows["S2", "L2 (own)"][3:6] == ("2", "2 of 2", "2 of 2 [–]"), "with the row that the table lacks"
    assert made.tables["detection_by_template"].cells()[0] == ("made", "0.312/0.438", "0.312/0.438")
    assert made.tables["detection_parts"].cells() == [("EMV", "the EMV", "12", "0.312 [0.250, 0.375]")]
    assert made.tables["risk_scores"].cells()[0][:3] == ("made", "4/5", "50.00 [–]")
    scenes = next(section for section in made.page.sections if section.key == "scenes")
    assert [clip.key for clip in scenes.clips] == ["film_S2"]
    assert [figure.key for figure in scenes.figures] == ["picture_S2"]


def test_the_paper_is_held_against_the_episodes_at_their_own_level(made: SimpleNamespace) -> None:
    table = made.tables["next_to_the_paper_paper_0"]
    assert (table.caption, table.head) == ("ADE in m", ("", "S2", "mean"))
    paper, ours, *_ = table.cells()
    at_own = [one for one in made.measures.prediction if one.level.name == "L2"]
    values = np.concatenate([one.models["cv"].values["ade_m"] for one in at_own])
    assert paper == ("CV, paper", "1.17", "1.44")
    assert ours[0] == "CV, here"
    assert ours[1] == f"{values.mean():.2f}"


def test_what_is_measured_is_what_the_commands_measure(made: SimpleNamespace) -> None:
    one = made.measures.bags[0]
    (scored,) = score_bag(one.bag)
    assert isinstance(scored, ScoredEpisode)
    assert scored.row() == one.yielding.row()
    (result,) = score_bags(ScoringJob(("cv", "idm")), [one.bag])
    assert result.scores is not None
    for model, scores in result.scores.models.items():
        assert np.array_equal(scores.values["ade_m"], one.prediction.models[model].values["ade_m"])


def test_effects_are_paired_over_the_seeds(made: SimpleNamespace) -> None:
    (row,) = made.tables["effects_emv_delay_s"].cells()
    first, second = (
        [one.scores.metrics["emv_delay_s"].value for one in made.measures.yielding if one.level == level]
        for level in ("L2", "L1")
    )
    assert row[:2] == ("L2 − L1", "S2")
    assert float(row[2].split(" ")[0]) == pytest.approx(sum(first) / 2 - sum(second) / 2, abs=0.005)
    assert row[5] == "2"


def test_a_bag_that_cannot_be_read_does_not_hold_up_the_others(study: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad"
    bad.mkdir()
    good = next(study.glob("episodes/S2_L1/*/"))
    found = measure_study([bad, good], ("cv",), 1)
    assert [bag for bag, _ in found.unread] == [bad]
    assert [one.bag for one in found.bags] == [good]
    with pytest.raises(InputError, match="can be read"):
        measure_study([bad], ("cv",), 1)


@pytest.mark.parametrize("task", ["detection", "risk"])
def test_a_folder_without_the_scores_that_were_asked_for_is_refused(study: Path, tmp_path: Path, task: str) -> None:
    """Where nothing is asked for, the page has no such section."""
    with pytest.raises(InputError, match="siren generate"):
        build_page(tmp_path, PageOptions())
    with pytest.raises(InputError, match=f"siren evaluate {task} --out"):
        build_page(study, PageOptions(**{task: tmp_path}))
    PageOptions().check()
    (tmp_path / "scores.json").write_text("{}", encoding="utf-8")
    PageOptions(**{task: tmp_path}).check()


def test_scores_that_are_none_are_refused(study: Path, tmp_path: Path, made: SimpleNamespace) -> None:
    for content, task in (("[]", ""), ("nonsense", ""), ('{"a": {}}', " risk")):
        (tmp_path / "scores.json").write_text(content, encoding="utf-8")
        with pytest.raises(InputError, match=f"`siren evaluate{task}`"):
            risk_section(tmp_path)
    with pytest.raises(InputError, match=r"risk.*siren evaluate risk.*value"):
        stored_tables("risk", tmp_path, lambda content: [content["value"]])
    assert detection_section(made.rows, study / "episodes") is None


def test_the_shown_episode_is_at_its_own_level_with_a_predicate_that_holds(made: SimpleNamespace) -> None:
    complete: list[EpisodeRow] = [row for row in made.rows.rows if row.status is Status.COMPLETE]
    assert [row.episode for row in chosen_episodes(complete)] == ["S2_L2_seed0"]
    failed = [replace(row, predicate_holds=row.episode == "S2_L2_seed1") for row in complete]
    assert [row.episode for row in chosen_episodes(failed)] == ["S2_L2_seed1"]
    others = [row for row in complete if row.level == "L1"]
    assert [row.episode for row in chosen_episodes(others)] == ["S2_L1_seed0"]


STUDY = StudyRows(Path("a study"), {}, (), "")


def test_tables_of_predictors() -> None:
    section = prediction_section(STUDY, score_table(reported_scores()))
    scores = score_table(reported_scores())
    assert section.tables == prediction_tables(scores, differences(scores))
    by_template = {table.key: table for table in section.tables}["prediction"]
    assert by_template.head == ("model", "S1", "S2", "own", "mean", "samples", "coverage")
    assert [row[:4] for row in by_template.cells()] == [
        ("cv", "2.10/6.30", "4.00/12.00", "8.00/24.00"),
        ("net:v_1", "3.33/10.00", "6.00/18.00", "16.00/48.00"),
    ]
    assert section.commands == ("./env siren evaluate prediction 'a study' --models cv,net:v_1 --out prediction",)


NOTHING = {metric.name: Measure.lacking("nothing") for metric in EPISODE_METRICS}


def measures(*episodes: tuple[str, str, float], in_the_way: bool = False) -> StudyMeasures:
    """Episodes by level and map with their delays; nothing else has a value but the EMV's stops."""
    bags: list[Any] = []
    for seed, (level, map_name, delay_s) in enumerate(episodes):
        metrics = {**NOTHING, "emv_delay_s": Measure(delay_s), "emv_stops": Measure(1.0)}
        marks = dict.fromkeys(("response_time_s", "clearance_time_s"), Measure(1.0))
        drivers = (DriverMarks(3, 0.0, in_the_way, True, False, marks),)
        scores = YieldScores(metrics, drivers)
        bags.append(SimpleNamespace(yielding=ScoredEpisode(f"b{seed}", "S2", level, seed, map_name, "", "", scores)))
    return StudyMeasures(tuple(bags), ())


@pytest.mark.parametrize("in_the_way", [True, False])
def test_metrics_of_interest_that_have_a_value_are_drawn(*, in_the_way: bool) -> None:
    section = making_way_section(STUDY, measures(("L1", "town", 3.0), in_the_way=in_the_way))
    assert [figure.key for figure in section.figures] == ["metric_emv_delay_s"] + ["drivers"] * in_the_way


def test_means_by_level_and_map() -> None:
    given = measures(*(("L2", "town", delay_s) for delay_s in (1.0, 1.5, 2.0, 2.5, 3.0)), ("L0", "town", 9.0))
    (table,) = making_way_section(STUDY, given).tables
    assert (table.key, table.head) == ("S2", ("metric", "L0", "L2", "meaning"))
    rows = {row[0]: row[1:3] for row in table.cells()}
    assert rows["emv_delay_s"] == ("9.00 [–]", "2.00 [1.02, 2.98]")
    assert rows["compliance"] == ("–", "–")
    assert len(rows) == len(EPISODE_METRICS) - len(PEOPLE_METRICS)
    one, other = making_way_section(STUDY, measures(("L2", "town", 1.0), ("L2", "Town04", 5.0))).tables
    assert [one.key, other.key] == ["S2_Town04", "S2_town"]
    assert one.caption == "Yield metrics of S2 on Town04"
    assert {row[0]: row[1] for row in one.cells()}["emv_delay_s"] == "5.00 [–]"


def test_groups_and_the_novelty_of_their_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """At L2 three ways at 0, 3 and 10 m with two orders of events; at L3 one episode."""
    profiles = [
        profile(0, "a", "b", way=((0.0, 0.0),)),
        profile(1, "a", "b", way=((3.0, 0.0),)),
        profile(2, "a", way=((10.0, 0.0),)),
        profile(5, level="L3"),
    ]
    drawn: list[Any] = []
    monkeypatch.setattr(build, "figure_uri", lambda _: "data:")
    monkeypatch.setattr(build, "draw_coverage", lambda found, colours: drawn.append((found, colours)))
    bags: Any = tuple(SimpleNamespace(profile=one) for one in profiles)
    section = diversity_section(STUDY, StudyMeasures(bags, ()))
    groups, novelty = section.tables
    several, single = groups.cells()
    # Ways: 3, 7 and 10 m apart, the nearest 3, 3 and 7 m; orders of events: 0, 1/2 and 1/2 apart.
    assert several[:4] == ("S2", "L2", "town", "3")
    assert several[4] == "–", "the made parameters are none of S2's"
    assert several[5:9] == ("6.7", "4.3", "0.33", "0.17")
    # begin a, a b, b end, a end: the last one is of a single episode.
    assert several[9:11] == ("4", "0.3")
    assert single == ("S2", "L3", "town", "1", "–", "–", "–", "–", "–", "1", "–", "–")
    assert [row[3:] for row in novelty.cells()] == [
        ("0", "", "3.0", "0.00"),
        ("1", "", "3.0", "0.00"),
        ("2", "", "7.0", "0.50"),
        ("5", "", "–", "–"),
    ]
    ((found, colours),) = drawn
    assert [one.group[1] for one in found] == ["L2"], "its own level"
    assert len(colours) == 1


STUDIES = (
    Study(("S1", "S2"), ("L0", "own"), (0, 1, 7), ("town", "../a map.xodr"), duration_s=30.0, risk_videos=3),
    Study(("S2",), draws=DrawPlan(Method.GRID, values={"emv.speed_mps": [12.5, 14.0], "demand.platoon.vehicles": [4]})),
    Study(("S2",), draws=DrawPlan(Method.RANDOM, samples=3, seed=9), preset="realistic", sensors="lidar", look="rain"),
    Study(("S2",), draws=DrawPlan(Method.LATIN_HYPERCUBE, samples=4, ranges={"emv.speed_mps": (12.0, 14.5)})),
)


@pytest.mark.parametrize("study", STUDIES)
def test_the_command_asks_for_the_same_study(study: Study) -> None:
    words = split(generate_command(study.to_json(), Path("out folder")))
    assert words[:3] == ["./env", "siren", "generate"]
    arguments = parser().parse_args(words[2:])
    assert study_of(arguments).to_json() == study.to_json()
    assert arguments.out == "out folder"


def row(level: str, seed: int, status: Status = Status.COMPLETE, **known: object) -> EpisodeRow:
    name = f"S2_{level}_seed{seed}"
    planned = PlannedEpisode(name, f"S2_{level}", EpisodeRequest("S2", level, seed), -1, "ab" * 32)
    return replace(EpisodeRow.planned(planned, status), **known)  # type: ignore[arg-type] # fields by name


ROWS = (
    row("L2", 0, simulated_s=10.0, cpu_s=2.0, predicate_holds=True, bag_bytes=2_000_000, attempts=2),
    row("L2", 1, simulated_s=30.0, cpu_s=3.0, predicate_holds=False, bag_bytes=1_600_000, draw=4),
    row("L2", 1, simulated_s=20.0, cpu_s=0.0, predicate_holds=None, versions={"siren": "1", "sumo": "9"}),
    row("L2", 2, Status.CRASHED, reason="it hung", attempts=3, simulated_s=99.0),
    row("L0", 0, Status.REFUSED, reason="no site", map="Town04"),
)


def tables_of(rows: tuple[EpisodeRow, ...], unread: tuple[tuple[Path, str], ...] = ()) -> dict[str, Table]:
    section = generated_section(StudyRows(Path("s"), {}, rows, "cd" * 32), StudyMeasures((), unread))
    return {table.key: table for table in section.tables}


def test_what_is_complete_is_counted_by_groups_with_what_they_share() -> None:
    section = generated_section(StudyRows(Path("s"), {}, ROWS, ""), StudyMeasures((), ()))
    assert section.text[0].startswith("5 episodes in the study, 3 of them complete: 1 simulated minutes, 4 MB. ")
    assert section.commands == (), "nobody knows what was asked for"
    asked = StudyRows(Path("s"), {"templates": ["S2"]}, ROWS, "")
    assert generated_section(asked, StudyMeasures((), ())).commands == ("./env siren generate --templates S2 --out s",)
    table = tables_of(ROWS)["groups"]
    assert table.cells() == [
        ("S2", "L0", "Town04", "1", "0 of 1", "–", "0", "–", "0"),
        # 0.2, 0.1 and no processor time for a simulated second; one and two attempts in vain.
        ("S2", "L2 (own)", "town", "3", "3 of 4", "1 of 2 [–]", "60", "0.100", "3"),
    ]
    assert not table.folded
    many = tuple(row("L2", 0, map=f"m{number}") for number in range(13))
    assert tables_of(many)["groups"].folded
    assert not tables_of(many[:12])["groups"].folded
    rows = dict(tables_of(ROWS)["asked"].rows)
    assert rows["map"] == "town (4), Town04 (1)"
    assert rows["draw"] == "none (4), 4 (1)"
    assert rows["versions"] == "siren 1, sumo 9"
    assert rows["SHA-256 of manifest.parquet"] == "cd" * 32


def test_what_is_missing_and_what_cannot_be_read() -> None:
    found = tables_of(ROWS, ((Path("a/b"), "damaged"),))
    assert found["missing"].cells() == [
        ("S2_L2_seed2", "crashed", "it hung", "3"),
        ("S2_L0_seed0", "refused", "no site", "1"),
    ]
    assert found["missing"].caption == "Episodes that are missing: 2"
    assert found["unread"].rows == (("b", "damaged"),)
    many = tables_of(tuple(row("L2", seed, Status.FAILED) for seed in range(51)))["missing"]
    assert (len(many.rows), many.caption) == (50, "Episodes that are missing: 51")
    assert {"missing", "unread"}.isdisjoint(tables_of(ROWS[:3]))


def test_people_have_a_table_where_there_are_some() -> None:
    def told(*met: int) -> str:
        kinds = zip(("pedestrians", "cyclists", "motorcycles"), met, strict=True)
        of_kind = {f"people.{kind}.met": number for kind, number in kinds}
        columns = ("near", "near_median", "with_emv", "with_yielding")
        all_ten = {f"people.{name}.{column}": 10 for name in ("cyclists", "motorcycles") for column in columns}
        walking = {f"people.pedestrians.{column}": at * met[0] for at, column in enumerate(columns, 1)}
        return json.dumps({"collisions": 0, **of_kind, **all_ten, **walking, "people.met": sum(met)})

    assert "people" not in tables_of(ROWS)
    rows = (row("L2", 0, measures=told(1, 0, 0)), row("L2", 1, measures=told(0, 0, 0)), row("L0", 0))
    assert tables_of(rows)["people"].cells() == [
        ("S2", "L2", "pedestrians", "0.5", "1.0", "1.5", "2.0", "1 of 2"),
        ("S2", "L2", "cyclists", "10.0", "10.0", "10.0", "10.0", "0 of 2"),
        ("S2", "L2", "motorcycles", "10.0", "10.0", "10.0", "10.0", "0 of 2"),
        ("S2", "L2", "all", "–", "–", "–", "–", "1 of 2"),
    ]


EMV, CAR = 1, 5


def record(*events: Event, steps: int = 601) -> EpisodeRecord:
    tracks = {EMV: moving(0.0, -5.25, 5.0, is_emv=True, steps=steps), CAR: moving(40.0, -5.25, 2.0, steps=steps)}
    made = record_with(tracks, parse_road_network(NET_XML.encode()))
    return replace(made, events=events, description=replace(made.description, emv_ids=(EMV,)))


def told(step: int) -> Event:
    return Event(step, EventKind.YIELD_STARTED, CAR)


@pytest.mark.parametrize(
    ("steps", "start"),
    [((10, 300, 590), 200), ((20,), 0), ((590,), 400), ((101,), 0), ((103,), 2)],
)
def test_the_film_lies_around_the_median_event_inside_the_episode(steps: tuple[int, ...], start: int) -> None:
    """Ten seconds, half of them before the event, at every second step; it begins with a frame."""
    assert film_steps(record(*map(told, steps)), 10.0) == range(start, start + 200, 2)


def test_lines_that_others_cross_are_no_events_and_a_short_episode_is_shown_whole() -> None:
    crossed = (Event(step, EventKind.STOP_LINE_CROSSED, CAR) for step in (10, 20, 30))
    assert film_steps(record(*crossed, Event(400, EventKind.STOP_LINE_CROSSED, EMV)), 5.0).start == 350
    found = film_steps(record(told(30), steps=61), 10.0)
    assert (found.start, found.stop) == (0, 61)


def test_emvs_besides_the_first_have_a_table_where_there_are_some() -> None:
    """Two episodes with a second EMV, one of them with a third."""
    second = {"emv2.predicate_holds": 1, "emv2.mean_speed_mps": 8.0}
    third = {
        "emv2.predicate_holds": 0,
        "emv2.mean_speed_mps": 4.0,
        "emv3.predicate_holds": 1,
        "emv3.mean_speed_mps": 5.0,
    }
    rows = tuple(row("L2", seed, measures=json.dumps(told)) for seed, told in enumerate((second, third, {"actors": 3})))
    section = generated_section(StudyRows(Path("s"), {}, rows, ""), StudyMeasures((), ()))
    (table,) = [table for table in section.tables if table.key == "further_emvs"]
    assert table.cells() == [("S2", "L2", "2", "1 of 2", "6.00"), ("S2", "L2", "3", "1 of 1", "5.00")]
    plain = generated_section(StudyRows(Path("s"), {}, (row("L2", 0),), ""), StudyMeasures((), ()))
    assert "further_emvs" not in {table.key for table in plain.tables}
