"""Every clause that applies to a driver, with limits that the driver breaks by half of them, and just keeps."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, Driven, at_speed, crossing, hand_made, line, with_states
from made_encounters import CAR, IN_LANE, arc

from siren_ros.base.params.folders import names_in_params
from siren_ros.reports.exam.grading import FOLDER, Grade, examine, load_rulebook
from siren_ros.simulation.world.actors import Event, EventKind, Lights

WEAVES = line((5.25, -120.0), (5.25, -80.0), (10.5, -70.0), (10.5, -50.0), (2.6, -38.0), (5.25, -30.0), (5.25, 110.0))
"""Leaves the road to the right, and comes back to the left."""
EASTBOUND = line((-90.0, -5.25), (60.0, -5.25))


def with_siren(record):
    lights = np.uint8(Lights.SIREN)
    record = with_states(record, lights=lambda state: np.where(state.actor_id == EMV, lights, np.uint8(0)))
    contact = Event(180, EventKind.COLLISION, CAR, EMV, 0.0, 0.0, {"impact_speed_mps": 3.0})
    return replace(record, events=(*record.events, contact))


def weaves():
    """A driver that speeds, leaves the road, and stands on the junction before an EMV that follows it."""
    driver = Driven(WEAVES, arc((17.0, 3.0), (9.0, 4.0), (0.0, 7.0), (5.0, 8.0), start_m=20.0))
    emv = Driven(IN_LANE, arc((9.0, 9.0), (3.0, 5.0), (12.0, 8.0)))
    return with_siren(hand_made(crossing(), {EMV: emv, CAR: driver}))


def crosses_at_red():
    """A driver that brakes hard, and drives over a red line right before an EMV from the side."""
    driver = Driven(IN_LANE, arc((10.0, 20.0), start_m=40.0))
    record = hand_made(crossing(), {EMV: Driven(EASTBOUND, at_speed(0.0, 10.0, 400)), CAR: driver}, lambda _: "r" * 20)
    brakes = lambda state: np.where((state.actor_id == CAR) & (10 < state.step < 40), -5.0, state.accel_mps2)  # noqa: E731
    return with_states(with_siren(record), accel_mps2=brakes)


@pytest.mark.parametrize("name", [name for name in names_in_params(FOLDER) if name != "base"])
def test_a_limit_that_is_broken_by_half_is_minor_and_one_that_is_kept_passes(name):
    book, broken = load_rulebook(name), set()
    for record in (weaves(), crosses_at_red()):
        measured = {mark.clause.clause_id: mark.finding.measure for mark in examine(record, CAR, book).marks}
        for factor, wanted in ((1.5, Grade.MINOR), (1.0 / 1.5, Grade.PASS)):
            clauses = []
            for clause in book.clauses:
                value = measured[clause.clause_id].value
                if not measured[clause.clause_id].valid or value <= 0.0:
                    continue
                less_is_worse = clause.major < clause.minor
                minor = value * factor if less_is_worse else value / factor
                clauses.append(replace(clause, minor=minor, major=minor * (0.5 if less_is_worse else 2.0)))
            marks = examine(record, CAR, replace(book, clauses=tuple(clauses))).marks
            assert {mark.clause.clause_id: mark.grade for mark in marks} == {one.clause_id: wanted for one in clauses}
            broken |= {clause.clause_id for clause in clauses}
    assert broken >= {"limit", "road", "box", "intersection", "right_of_way", "contact", "yield", "indicator"}
