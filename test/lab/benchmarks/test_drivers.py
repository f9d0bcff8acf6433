"""Benchmarks of drivers under test: how well lawful ones drive, whether faults are found."""

import json

import pytest
from recorded_episode import quick_template

from siren_ros.lab.benchmarks.drivers import main, record_with, requests_of, sittings_in
from siren_ros.lab.benchmarks.faulty_drivers import LAWFUL, broken_by, written_down
from siren_ros.reports.exam.examinee import PAPER
from siren_ros.reports.exam.grading import load_rulebook
from siren_ros.simulation.scenario.episode import EpisodeRequest


def test_every_driver_sits_in_the_same_episode_and_the_papers_drives_what_is_the_av_elsewhere() -> None:
    request = EpisodeRequest(quick_template("S2"), "L2", 3, sensors="none", duration_s=2.0)
    sittings = sittings_in(request, ["idm", "lawful-international"], load_rulebook("international"))
    assert [*sittings] == [PAPER, "idm", "lawful-international"]
    assert len({sitting.episode for sitting in sittings.values()}) == 1
    assert sittings[PAPER].others == {}
    assert {*sittings["idm"].others} == {"emv_delay_s", "braked_hard"}

    (paper, paper_id), (other, av_id) = record_with(PAPER, request), record_with("idm", request)
    assert paper.actors[paper_id].name == other.actors[av_id].name
    assert other.description.av_id == av_id
    first = [record.track(one) for record, one in ((paper, paper_id), (other, av_id))]
    assert first[0].x_m[0] == pytest.approx(first[1].x_m[0])


def test_an_episode_that_cannot_be_made_is_left_out(tmp_path, capsys) -> None:
    requests = requests_of(["S2", "S99"], ["L2"], [0], ["town", "other.xodr"], 2.5)
    assert {one.duration_s for one in requests} == {2.5}
    asked = {("S2", ""), ("S99", ""), ("S2", "other.xodr"), ("S99", "other.xodr")}
    assert {(one.template, one.map) for one in requests} == asked
    file = tmp_path / "figures.json"
    matrix = "idm --templates S3 S99 --levels L2 --seeds 0 --duration-s 2 --jobs 1 --json"
    main([*matrix.split(), str(file)])
    assert "1 of 2 episodes" in capsys.readouterr().out
    figures = json.loads(file.read_text())
    assert figures["episodes"] == 1
    assert figures["siren"].keys() == {"violations"}
    assert figures["idm"]["violations"]["value"] >= 0.0


SCENES, CASES = written_down()
QUICK = {
    *((LAWFUL, place) for place in ("california", "international")),
    ("no-indicator", "international"),
    ("brakes-hard", "germany"),
    ("creeps", "california"),
}


def test_what_is_written_down_are_clauses_of_the_rulebooks():
    for case in CASES:
        assert case.breaks <= {clause.clause_id for clause in load_rulebook(case.place).clauses}, case
    by_fault = {case.fault for case in CASES if case.breaks}
    assert by_fault == {case.fault for case in CASES} - {LAWFUL, "blocks-the-shoulder"}


@pytest.mark.parametrize(
    "case", [case for case in CASES if (case.fault, case.place) in QUICK], ids=lambda one: one.driver
)
def test_it_breaks_what_was_written_down_and_nothing_else(case):
    scenes = ("platoon",) if case.fault == LAWFUL else case.scenes
    broken = [broken_by(case.driver, case.place, SCENES[name], case.paired) for name in scenes]
    assert frozenset().union(*broken) == case.breaks
