"""Counts of made rows."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from evaluation.made_records import moving, record_with
from synthetic_episode import NET_XML

from siren_ros.base.tables.table import Table
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.reports.study_report.episode_sections import film_steps, generated_section
from siren_ros.reports.study_report.study import StudyMeasures, StudyRows
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import PlannedEpisode
from siren_ros.simulation.roads.net_parser import parse_road_network
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.traffic_state import Event, EventKind


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


def test_the_text_counts_what_is_complete() -> None:
    section = generated_section(StudyRows(Path("s"), {}, ROWS, ""), StudyMeasures((), ()))
    assert section.text[0].startswith("5 episodes in the study, 3 of them complete: 1 simulated minutes, 4 MB. ")
    assert section.commands == (), "nobody knows what was asked for"
    asked = StudyRows(Path("s"), {"templates": ["S2"]}, ROWS, "")
    assert generated_section(asked, StudyMeasures((), ())).commands == ("./env siren generate --templates S2 --out s",)


def test_groups() -> None:
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


def test_what_is_missing_and_what_cannot_be_read() -> None:
    found = tables_of(ROWS, ((Path("a/b"), "damaged"),))
    assert found["missing"].cells() == [
        ("S2_L2_seed2", "crashed", "it hung", "3"),
        ("S2_L0_seed0", "refused", "no site", "1"),
    ]
    assert found["missing"].caption == "Episodes that are missing: 2"
    assert found["unread"].rows == (("b", "damaged"),)
    assert {"missing", "unread"}.isdisjoint(tables_of(ROWS[:3]))


def test_fifty_missing_episodes_are_named_and_all_are_counted() -> None:
    table = tables_of(tuple(row("L2", seed, Status.FAILED) for seed in range(51)))["missing"]
    assert (len(table.rows), table.caption) == (50, "Episodes that are missing: 51")


def test_what_the_episodes_share() -> None:
    rows = dict(tables_of(ROWS)["asked"].rows)
    assert rows["map"] == "town (4), Town04 (1)"
    assert rows["draw"] == "none (4), 4 (1)"
    assert rows["versions"] == "siren 1, sumo 9"
    assert rows["SHA-256 of manifest.parquet"] == "cd" * 32


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


def test_the_film_is_around_the_median_event() -> None:
    """Of ten seconds: five before step 300 and five after it, at every second step."""
    found = film_steps(record(told(10), told(300), told(590)), 10.0)
    assert (found.start, found.stop, found.step) == (200, 400, 2)


@pytest.mark.parametrize(("step", "start"), [(20, 0), (590, 400), (101, 0), (103, 2)])
def test_the_film_lies_inside_the_episode_and_begins_with_a_frame(step: int, start: int) -> None:
    found = film_steps(record(told(step)), 10.0)
    assert found.start == start
    assert len(found) == 100


def test_lines_that_others_cross_are_no_events_of_the_interaction() -> None:
    crossed = (Event(step, EventKind.STOP_LINE_CROSSED, CAR) for step in (10, 20, 30))
    found = film_steps(record(*crossed, Event(400, EventKind.STOP_LINE_CROSSED, EMV)), 5.0)
    assert found.start == 350


def test_a_short_episode_is_shown_whole() -> None:
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
