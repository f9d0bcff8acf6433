"""Terms of the reward."""

import pytest

pytest.importorskip("gymnasium", reason="the extra learn is not installed")

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from hand_made_record import NORTHBOUND, Driven, at_speed, crossing, hand_made
from made_seat_state import WANTED_MPS, state_of

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.base.numerics.units import STEP_S
from siren_ros.errors import InputError
from siren_ros.lab.learning import rollout
from siren_ros.lab.learning.options import TERMS, EnvOptions, terms_of, weights_of
from siren_ros.lab.learning.rollout import Seat
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.simulation.world.actors import Event, EventKind, Lights


@pytest.mark.parametrize(
    ("gap_m", "speed_mps", "aside_m", "stuck"),
    [
        (5.0, 1.0, 0.0, True),
        (11.0, 1.0, 0.0, False),
        (5.0, 2.5, 0.0, False),
        (5.0, 1.0, 1.9, True),
        (5.0, 1.0, 2.0, False),
    ],
)
def test_an_emv_is_stuck_that_creeps_close_behind_in_line(gap_m, speed_mps, aside_m, stuck) -> None:
    own_m = 20.0 + 0.5 * (6.0 + 4.0) + gap_m
    state = state_of(own_m=own_m, own_mps=speed_mps, emv_mps=speed_mps, aside_m=(aside_m, aside_m))
    assert terms_of(state)["obstruction"] == pytest.approx(STEP_S * stuck)


@pytest.mark.parametrize(
    ("rate_mps", "light", "counts"),
    [
        (0.5, Lights.NONE, True),
        (0.5, Lights.INDICATOR_RIGHT, True),
        (0.5, Lights.INDICATOR_LEFT, False),
        (-0.5, Lights.INDICATOR_RIGHT, False),
        (-0.5, Lights.NONE, True),
        (0.1, Lights.NONE, False),
    ],
)
def test_a_move_to_the_side_needs_the_indicator_of_that_side(rate_mps: float, light: Lights, counts: bool) -> None:
    state = state_of(aside_m=(0.0, rate_mps * STEP_S), lights=int(light))
    assert terms_of(state)["indicator"] == pytest.approx(STEP_S * counts)


@pytest.mark.parametrize(("gap_m", "short"), [(4.9, True), (5.1, False)])
def test_the_time_to_collision_is_short_below_one_second(gap_m: float, short: bool) -> None:
    ahead = {3: Driven(NORTHBOUND, at_speed(50.0 + 4.0 + gap_m + 0.25, 5.0, 2))}  # the own one comes 0.25 m nearer
    assert terms_of(state_of(others=ahead))["short_time"] == pytest.approx(STEP_S * short)


def test_braking_beyond_4_mps2_and_standing_in_a_junction_while_a_siren_comes_count() -> None:
    state = state_of()
    for accel_mps2, amount in ((-7.0, 3.0 * STEP_S), (-4.0, 0.0), (3.0, 0.0)):
        states = replace(state.sight.states, accel_mps2=np.array([0.0, accel_mps2]))
        assert terms_of(replace(state, sight=replace(state.sight, states=states)))["braking"] == pytest.approx(amount)
    for own_m, own_mps, amount in ((115.0, 0.0, STEP_S), (115.0, 2.0, 0.0), (90.0, 0.0, 0.0)):
        stands = state_of(own_m=own_m, own_mps=own_mps)
        assert terms_of(stands)["junction"] == amount
        assert terms_of(replace(stands, sight=replace(stands.sight, sirens=())))["junction"] == 0.0


def braking(state, accel_mps2: float):
    states = replace(state.sight.states, accel_mps2=np.array([-9.0, *[accel_mps2] * (len(state.sight.states) - 1)]))
    return replace(state, sight=replace(state.sight, states=states))


def test_all_terms_of_a_step_on_the_road_and_of_one_in_a_junction() -> None:
    """On the road the EMV creeps 4 m behind and a slow car is 5 m ahead; in the junction the own vehicle stands."""
    ahead = {3: Driven(NORTHBOUND, at_speed(59.0, 2.0, 2))}
    road = braking(state_of(50.0, 10.0, 41.0, 1.5, aside_m=(0.2, 0.25), others=ahead), -6.0)
    stands = braking(state_of(own_m=115.0, own_mps=0.4, emv_m=90.0, emv_mps=6.0), -4.5)
    terms = [terms_of(replace(road, contact=True, red_lines=2)), terms_of(replace(stands, red_lines=1))]
    table = {
        "contact": (1.0, 0.0),
        "off_road": (0.0, 0.0),
        "obstruction": (0.05, 0.0),
        "junction": (0.0, 0.05),
        "red_line": (2.0, 1.0),
        "indicator": (0.05, 0.0),
        "braking": (2.0 * 0.05, 0.5 * 0.05),
        "short_time": (0.05, 0.0),
        "emv_delay": (0.05 * (1.0 - 1.5 / 15.0), 0.05 * (1.0 - 6.0 / 15.0)),
        "progress": (10.0 * 0.05 / 13.9, 0.4 * 0.05 / 13.9),
    }
    assert {name: (terms[0][name], terms[1][name]) for name in terms[0]} == {
        name: pytest.approx(amounts) for name, amounts in table.items()
    }
    passed = replace(road.sight, sirens=tuple(replace(siren, behind=False) for siren in road.sight.sirens))
    assert terms_of(replace(road, sight=passed))["obstruction"] == 0.0
    assert terms_of(state_of(emv_mps=WANTED_MPS + 1.0))["emv_delay"] == 0.0, "it is faster than it wants to be"
    for aside_m, left in ((12.1, 1.0), (11.9, 0.0), (-11.9, 0.0), (-12.1, 1.0)):
        assert terms_of(state_of(aside_m=(aside_m, aside_m)))["off_road"] == left


def test_the_request_of_an_episode_has_all_options() -> None:
    options = EnvOptions(
        "S3", 1, "maps/a.xodr", "site", "fitted", values="civilians=3", duration_s=4.5, decision_s=0.15
    )
    expected = EpisodeRequest("S3", "L1", seed=17, map="maps/a.xodr", site="site", preset="fitted", sensors="none")
    expected = replace(expected, values="civilians=3", duration_s=4.5)
    assert options.request(17, with_av=False) == replace(expected, av="")
    assert options.request(17, with_av=True) == replace(expected, av="civilian")
    assert options.steps_per_decision == 3


def test_ones_own_weights_replace_the_others() -> None:
    assert {name: tuple(weights_of(seat)[name] for seat in (Seat.CIVILIAN, Seat.EMV)) for name in TERMS} == {
        "contact": (-20.0, -20.0),
        "off_road": (-10.0, -10.0),
        "obstruction": (-1.0, 0.0),
        "junction": (-1.0, 0.0),
        "red_line": (-5.0, 0.0),
        "indicator": (-1.0, -0.2),
        "braking": (-1.0, -0.2),
        "short_time": (-2.0, -2.0),
        "emv_delay": (-0.2, -1.0),
        "progress": (0.1, 0.1),
    }
    changed = weights_of(Seat.EMV, {"progress": 3.0})
    assert changed == {**weights_of(Seat.EMV), "progress": 3.0}
    assert list(changed) == list(TERMS)
    with pytest.raises(InputError, match="rewards: 'speed'"):
        weights_of(Seat.EMV, {"speed": 1.0})


@pytest.mark.parametrize(("red_from", "lines"), [(0, 1), (20, 0)])
@pytest.mark.parametrize("pair", [(2, 1), (1, 2)])
def test_the_reward_of_an_episode_is_the_sum_over_its_steps(monkeypatch, red_from: int, lines: int, pair) -> None:
    """The front comes to the line, 100 to 101 m on its way, at step 16 to 18; the middle is there 4 steps later."""
    monkeypatch.setattr(rollout, "av_way", lambda *_: Polyline.through(NORTHBOUND))
    vehicles = {1: Driven(NORTHBOUND, at_speed(60.0, 9.0, 40)), 2: Driven(NORTHBOUND, at_speed(90.1, 10.0, 40))}
    record = hand_made(crossing(), vehicles, lambda step: ("r" if step >= red_from else "G") * 7)
    description = SimpleNamespace(template_values={"emv.speed_mps": WANTED_MPS})
    run = SimpleNamespace(
        setup=SimpleNamespace(plan=None, description=description),
        network=record.network,
        actors=record.actors,
        actor_of=lambda seat: 2 if seat is Seat.CIVILIAN else 1,
        steps=[],
    )
    view, sums = rollout.SeatView(run, Seat.CIVILIAN), dict.fromkeys(TERMS, 0.0)
    before, touched, crossed = None, [], []
    for states, traffic in zip(record.states, record.traffic, strict=True):
        touch = Event(states.step, EventKind.COLLISION, *pair, detail={"impact_speed_mps": 1.0})
        run.states = states
        run.steps.append(SimpleNamespace(traffic=traffic, events=(touch,) if states.step in {9, 30} else ()))
        state = view.look()
        assert state is not None
        assert state.before is (before or state.sight), "the first step has none before"
        assert state.emv_row == 0
        before = state.sight
        touched += [states.step] * state.contact
        crossed += [states.step] * state.red_lines
        sums = {name: sums[name] + amount for name, amount in terms_of(state).items()}
    assert touched == [9, 30]
    assert len(crossed) == lines
    assert set(crossed) <= {16, 17, 18}
    assert sums["red_line"] == lines
    assert sums["contact"] == 2.0
    assert sums["progress"] == pytest.approx(39 * 10.0 * STEP_S / 13.9, rel=1e-3), "the first step is none"
    assert sums["emv_delay"] == pytest.approx(40 * STEP_S * (1.0 - 9.0 / WANTED_MPS))


@pytest.mark.parametrize("order", [1, -1])
def test_of_several_others_any_may_be_too_close(order: int) -> None:
    others = {3: Driven(NORTHBOUND, at_speed(62.0, 2.0, 2)), 4: Driven(NORTHBOUND, at_speed(95.0, 9.0, 2))}
    places = list(others.values())[::order]
    state = state_of(own_m=50.0, own_mps=10.0, others=dict(zip(others, places, strict=True)))
    assert terms_of(state)["short_time"] == STEP_S
