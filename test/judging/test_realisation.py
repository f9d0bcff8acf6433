from dataclasses import replace

import numpy as np
import pytest
from hand_made_record import EMV, NORTHBOUND, Driven, at_speed, crossing, hand_made, line

from siren_ros.judging.realisation import realisation_of
from siren_ros.recording.episode_record import EpisodeRecord
from siren_ros.world.events import Event, EventKind

SITE = {"junction": "J"}


def test_arrival_is_when_the_emv_is_nearest_to_the_junction() -> None:
    """The junction's centre is at 110 m of the northbound way (the stop line at 100 m)."""
    slow, fast = (
        realisation_of(_at_junction({EMV: Driven(NORTHBOUND, at_speed(30.0, speed_mps, 400))}))
        for speed_mps in (5.0, 10.0)
    )
    assert slow.arrival_s == pytest.approx(2.0 * fast.arrival_s, abs=0.1)
    assert slow.emv_speed_mps == pytest.approx(5.0, abs=0.1)
    assert slow.queue == slow.yielding == 0


def test_an_emv_that_never_comes_does_not_arrive() -> None:
    found = realisation_of(_at_junction({EMV: Driven(NORTHBOUND, np.full(100, 20.0))}))
    assert np.isnan(found.arrival_s)


def test_the_queue_is_who_stands_around_the_emv_before_it_arrives() -> None:
    standing = {
        number: Driven(line((4.0, -100.0), (4.0, 100.0)), np.full(400, 60.0 + 7.0 * number)) for number in (2, 3)
    }
    rolling = {4: Driven(line((8.0, -100.0), (8.0, 100.0)), at_speed(20.0, 5.0, 400) % 190.0)}
    emv = {EMV: Driven(NORTHBOUND, at_speed(30.0, 10.0, 400))}
    assert realisation_of(_at_junction({**emv, **standing, **rolling})).queue == 2


def _at_junction(vehicles: dict[int, Driven]) -> EpisodeRecord:
    record = hand_made(crossing(), vehicles)
    return replace(record, description=replace(record.description, site=SITE))


def _standing_near(record: EpisodeRecord, steps: set[int]) -> EpisodeRecord:
    """Actor 2 stands at these steps alone; at all others it drives."""
    states = tuple(
        replace(
            state,
            vx_mps=np.where((state.actor_id == 2) & (state.step not in steps), 5.0, state.vx_mps),
        )
        for state in record.states
    )
    return replace(record, states=states)


def test_the_queue_is_counted_three_seconds_before_the_arrival_to_the_step() -> None:
    """The EMV is at the junction's centre, 115 m along its way, at step 190; also in a record that begins later."""
    vehicles = {
        EMV: Driven(NORTHBOUND, at_speed(20.0, 10.0, 400)),
        2: Driven(line((4.0, -100.0), (4.0, 100.0)), np.full(400, 70.0)),
    }
    record = _at_junction(vehicles)
    counted = round(realisation_of(record).arrival_s / 0.05) - 60
    for steps, queue in (({counted}, 1), ({counted - 1, counted + 1}, 0)):
        changed = _standing_near(record, steps)
        assert realisation_of(changed).queue == queue
        late = replace(changed, states=changed.states[20:], traffic=changed.traffic[20:])
        assert realisation_of(late).queue == queue
        assert realisation_of(late).arrival_s == realisation_of(changed).arrival_s


def test_wherever_the_map_lies_the_conflict_point_is_the_junctions() -> None:
    plain = _at_junction({EMV: Driven(NORTHBOUND, at_speed(30.0, 10.0, 400))})
    shift = np.array([300.0, -150.0])
    network = plain.network
    junctions = {
        name: replace(found, outline=found.outline + shift, x_m=found.x_m + shift[0], y_m=found.y_m + shift[1])
        for name, found in network.junctions.items()
    }
    states = tuple(replace(state, x_m=state.x_m + shift[0], y_m=state.y_m + shift[1]) for state in plain.states)
    moved = replace(plain, states=states, network=replace(network, junctions=junctions))
    assert realisation_of(moved).arrival_s == realisation_of(plain).arrival_s
    assert not np.isnan(realisation_of(plain).arrival_s)


def test_of_two_emvs_the_first_one_arrives() -> None:
    record = _at_junction(
        {EMV: Driven(NORTHBOUND, at_speed(30.0, 10.0, 400)), 2: Driven(NORTHBOUND, at_speed(80.0, 10.0, 400))}
    )
    both = {key: replace(actor, is_emv=True) for key, actor in record.actors.items()}
    arrivals = [
        realisation_of(replace(record, actors=both, description=replace(record.description, emv_ids=ids))).arrival_s
        for ids in ((1, 2), (2, 1))
    ]
    assert arrivals[0] - arrivals[1] == pytest.approx(5.0, abs=0.05)


def test_civilians_that_begin_to_yield_are_counted_once_each() -> None:
    record = _at_junction({EMV: Driven(NORTHBOUND, at_speed(30.0, 10.0, 400))})
    kinds = [(EventKind.YIELD_STARTED, 2), (EventKind.YIELD_STARTED, 3), (EventKind.YIELD_STARTED, 2)]
    kinds.append((EventKind.YIELD_REQUESTED, 4))
    events = tuple(Event(5 + k, kind, actor, EMV) for k, (kind, actor) in enumerate(kinds))
    assert realisation_of(replace(record, events=events)).yielding == 2
