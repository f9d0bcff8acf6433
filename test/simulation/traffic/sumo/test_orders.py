"""Orders to signals and to single vehicles of SUMO."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import libsumo
import numpy as np
import pytest
from hand_made_record import traffic_of
from hypothesis import given
from hypothesis import strategies as st
from traffic_helpers import load_map, plan_of, plan_s2

from siren_ros.base.numerics.units import STEP_S
from siren_ros.simulation.roads.maps.netconvert import run_netconvert
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.traffic.demand.plan import JamHead, PlannedVehicle, SignalTiming, Spot
from siren_ros.simulation.traffic.simulation import SumoSimulation
from siren_ros.simulation.traffic.sumo import orders
from siren_ros.simulation.traffic.sumo.mirror import DEFAULT_LANE_CHANGE_MODE, KEEP_LANE_CHANGE_MODE
from siren_ros.simulation.traffic.sumo.orders import (
    GapOut,
    IgnoredFoes,
    JamOrders,
    RouteEnds,
    SignalPhase,
    crossing_first,
    detector_s,
    drivers_who_go,
    nema_cycle,
    parts_of_nema_phase,
    place_in_cycle,
    red_interval_s,
    yellow_after,
)
from siren_ros.simulation.traffic.sumo.rules import RULES, Setting
from siren_ros.simulation.world.actors import EventKind, Owner, TrafficFlags, TrafficState

PHASES = (
    SignalPhase(10.0, "rG"),
    SignalPhase(3.0, "ry"),
    SignalPhase(2.0, "rr"),
    SignalPhase(20.0, "Gr"),
    SignalPhase(3.0, "yr"),
    SignalPhase(2.0, "rr"),
)


def test_red_interval_runs_on_over_the_end_of_the_cycle_and_links_without_change_have_none() -> None:
    assert red_interval_s(PHASES, 0) == (38.0, 17.0)
    assert red_interval_s(PHASES, 1) == (13.0, 27.0)
    durations = (4.0, 9.0, 6.0, 5.0, 7.0, 2.0)
    phases = [SignalPhase(seconds, letter) for seconds, letter in zip(durations, "GrGrGr", strict=True)]
    assert red_interval_s(phases, 0) == (4.0, 9.0), "of several reds the longest counts wherever it stands"
    assert red_interval_s(phases[::-1], 0) == (20.0, 9.0)
    for letters in ("rr", "Gg", "G"):
        phases = [SignalPhase(5.0, letter) for letter in letters]
        assert red_interval_s(phases, 0) is None
        assert crossing_first(phases, 0, ()) == phases


def test_place_before_the_red_and_within_it() -> None:
    assert place_in_cycle(PHASES, 38.0, 0.0) == (5, 2.0)
    assert place_in_cycle(PHASES, 38.0, 4.0) == (3, 1.0)
    assert place_in_cycle(PHASES, 38.0, -3.0) == (0, 9.0)


ONE_BY_ONE = (
    *(SignalPhase(20.0, "Grr"), SignalPhase(5.0, "yrr")),
    *(SignalPhase(20.0, "rGr"), SignalPhase(5.0, "ryr")),
    *(SignalPhase(20.0, "rrG"), SignalPhase(5.0, "rry")),
)


@pytest.mark.parametrize(("link", "crossing"), [(0, (1,)), (0, (1, 2)), (0, (0,)), (2, (0,))])
def test_a_programme_stays_where_the_first_of_several_crosses_at_once(link: int, crossing: tuple[int, ...]) -> None:
    assert crossing_first(ONE_BY_ONE, link, crossing) == [*ONE_BY_ONE]
    assert crossing_first(PHASES, 0, ()) == crossing_first(PHASES, 0, (1,)) == [*PHASES]


@pytest.mark.parametrize(("link", "crossing"), [(0, 2), (2, 1), (1, 0)])
def test_those_who_cross_late_in_the_red_go_first(link: int, crossing: int) -> None:
    phases = crossing_first(ONE_BY_ONE, link, (crossing,))
    at = next(number for number, phase in enumerate(phases) if phase.state == "rrr")
    phases = [*phases[at:], *phases[:at]]
    assert phases[0] == SignalPhase(1.5, "rrr")
    assert phases[-1].state[link] == "y"
    greens = [phase.state.index("G") for phase in phases if "G" in phase.state]
    assert greens[0] == crossing
    assert greens[-1] == link
    assert sorted(phases[1:], key=lambda it: it.state) == sorted(ONE_BY_ONE, key=lambda it: it.state)


def test_a_turn_that_stays_green_over_the_yellow_gets_one_of_its_own() -> None:
    """The protected left turn leads in the programme, and lags after the change."""
    leading = [
        *(SignalPhase(20.0, "Ggr"), SignalPhase(3.0, "ygr"), SignalPhase(6.0, "rGr"), SignalPhase(3.0, "ryr")),
        *(SignalPhase(20.0, "rrG"), SignalPhase(3.0, "rry")),
    ]
    states = [phase.state for phase in crossing_first(leading, 0, (2,))]
    assert states == ["rrr", "rrG", "rry", "rGr", "ryr", "Ggr", "yyr"]


@given(st.floats(-200.0, 200.0), st.integers(0, 1))
def test_red_begins_after_the_wanted_time(red_in_s: float, link: int) -> None:
    begin_s, _ = red_interval_s(PHASES, link) or (0.0, 0.0)
    phase, left_s = place_in_cycle(PHASES, begin_s, red_in_s)
    assert 0.0 < left_s <= PHASES[phase].duration_s + 1e-9
    cycle_s = sum(phase.duration_s for phase in PHASES)
    now_s = sum(passed.duration_s for passed in PHASES[: phase + 1]) - left_s
    off_s = (now_s + red_in_s - begin_s) % cycle_s
    assert min(off_s, cycle_s - off_s) == pytest.approx(0.0, abs=1e-6)


def test_the_next_yellow_of_a_link_and_how_long_it_lasts() -> None:
    assert yellow_after(PHASES, 3, 0) == (4, 3.0)
    assert yellow_after(PHASES, 5, 0) == (4, 3.0)
    assert yellow_after(PHASES, 0, 1) == (1, 3.0)
    assert yellow_after((SignalPhase(5.0, "G"), SignalPhase(5.0, "r")), 0, 0) is None


@given(yellow_s=st.floats(0.0, 10.0))
def test_who_ends_the_green_drives_over_the_line_on_yellow(yellow_s: float) -> None:
    assert 0.0 <= detector_s(yellow_s) <= yellow_s
    assert detector_s(3.0) == pytest.approx(1.8)
    assert detector_s(8.0) == 1.8


FOLLOWING = ("static", "actuated", "NEMA")
"""Kinds of programmes; all but the first one follow their traffic."""


@pytest.fixture(name="two_signals", params=FOLLOWING)
def _two_signals(request, tmp_path):
    """A running simulation of two crossings with signals of one kind, and much traffic towards both."""
    places = [*(("c", 0, 0), ("d", 400, 0), ("w", -300, 0), ("n", 0, 300)), ("s", 0, -300), ("e", 700, 0)]
    places += [("m", 400, 300), ("t", 400, -300)]
    streets = ["wc", "cw", "cd", "dc", "de", "ed", "nc", "cn", "sc", "cs", "md", "dm", "td", "dt"]
    nodes = "".join(
        f'<node id="{k}" x="{x}" y="{y}"{" type=" + chr(34) + "traffic_light" + chr(34) if k in "cd" else ""}/>'
        for k, x, y in places
    )
    edges = "".join(f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="2"/>' for a, b in streets)
    (tmp_path / "nodes").write_text(f"<nodes>{nodes}</nodes>")
    (tmp_path / "edges").write_text(f"<edges>{edges}</edges>")
    options = ["--node-files", str(tmp_path / "nodes"), "--edge-files", str(tmp_path / "edges"), "--no-turnarounds"]
    options += ["--tls.default-type", request.param, "--tls.cycle.time", "60"]
    options += [] if request.param == "NEMA" else ["--tls.layout", "opposites"]
    net = tmp_path / "two.net.xml"
    net.write_bytes(run_netconvert(options, tmp_path / "out.xml", "two"))
    flows = "".join(
        f'<flow id="{a}{b}" begin="0" end="200" vehsPerHour="900" from="{a}" to="{b}"/>'
        for a, b in (("wc", "de"), ("ed", "cw"), ("nc", "cs"), ("td", "dm"))
    )
    routes = tmp_path / "flows.rou.xml"
    routes.write_text(f"<routes>{flows}</routes>")
    files = {"--net-file": str(net), "--route-files": str(routes), "--step-length": f"{STEP_S}"}
    quiet = {"--no-warnings": "true", "--no-step-log": "true", "--time-to-teleport": "-1"}
    libsumo.start(["sumo", *(part for pair in (files | quiet).items() for part in pair)])
    yield request.param
    libsumo.close()


def kinds_of(signal):
    """The kind of the programme that a signal has now."""
    program = libsumo.trafficlight.getProgram(signal)
    return [logic.type for logic in libsumo.trafficlight.getAllProgramLogics(signal) if logic.programID == program]


def link_of(signal, source, target):
    """The number of the movement between two edges."""
    for number, ways in enumerate(libsumo.trafficlight.getControlledLinks(signal)):
        if any((a.rpartition("_")[0], b.rpartition("_")[0]) == (source, target) for a, b, _ in ways):
            return number
    raise LookupError


def test_the_planned_red_comes_when_planned_on_every_kind_of_programme(two_signals):
    link, crossing = link_of("c", "wc", "cd"), link_of("c", "nc", "cs")
    planned_s, seen, other = 70.0, [], kinds_of("d")
    orders.time_signal(SignalTiming("c", link, planned_s), 0.0)
    for _ in range(round(95.0 / STEP_S)):
        libsumo.simulationStep()
        seen.append(str(libsumo.trafficlight.getRedYellowGreenState("c")))
    before, after = round((planned_s - 0.2) / STEP_S), round((planned_s + 0.2) / STEP_S)
    assert seen[before][link] == "y"
    assert seen[before - round(4.0 / STEP_S)][link] == "G"
    assert {letters[link] for letters in seen[after : after + round(15.0 / STEP_S)]} == {"r"}
    assert "G" in {letters[crossing] for letters in seen[after : after + round(6.0 / STEP_S)]}
    assert not any(letters[link] in "Gg" and letters[crossing] in "Gg" for letters in seen)
    assert kinds_of("c") == [0]
    assert kinds_of("d") == other, "other signals stay as they are"
    assert (other == [0]) == (two_signals == "static")


def test_a_nema_programme_is_fixed_ring_by_ring_and_waits_at_its_barriers() -> None:
    greens = {"1": 10.0, "2": 20.0, "5": 15.0, "6": 25.0, "4": 30.0, "8": 12.0}
    order = list(greens)
    parts = {
        name: parts_of_nema_phase(SignalPhase(s, "".join("G" if name == other else "r" for other in order)), 3.0, 2.0)
        for name, s in greens.items()
    }
    cycle = nema_cycle(parts, (("1", "2", "0", "4"), ("5", "6", "0", "8")), ("4", "8", "2", "6"))
    assert sum(phase.duration_s for phase in cycle) == pytest.approx((15.0 + 25.0 + 10.0) + 35.0)
    ends = np.cumsum([phase.duration_s for phase in cycle])
    expected = {
        5.0: "GrGrrr", 11.0: "yrGrrr", 14.0: "rrGrrr", 16.0: "rGyrrr", 19.0: "rGrrrr", 21.0: "rGrGrr",
        44.0: "rGrGrr", 46.0: "ryryrr", 49.0: "rrrrrr", 51.0: "rrrrGG", 79.0: "rrrrGG", 81.0: "rrrryy", 84.0: "rrrrrr",
    }  # fmt: skip
    for at_s, state in expected.items():
        assert cycle[int(np.searchsorted(ends, at_s, "right"))].state == state, at_s
    rotated = nema_cycle(parts, (("2", "4", "1"), ("6", "8", "5")), ("4", "8", "2", "6"))
    assert [phase.state for phase in rotated] == [phase.state for phase in cycle]


def green_after_stream_s(seed: int) -> float | None:
    """Time from the last vehicle of the stream to red; None where some of them do not cross before the EMV comes."""
    compiled, network = load_map(None)
    plan, _, site = plan_of("S3", network, seed)
    timing = plan.signal
    assert timing is not None
    assert set(timing.platoon) == {vehicle.name for vehicle in plan.groups}
    junction, ids, crossed, red_s = site.junction, {}, {}, None
    with SumoSimulation(compiled, network, plan, EmergencyLevel.L0) as simulation:
        for step in range(500):
            state = simulation.step(step, None)
            ids |= {actor.actor_id: actor.name for actor in state.spawned}
            for event in state.events:
                if event.kind is EventKind.STOP_LINE_CROSSED and event.detail["junction"] == junction:
                    crossed[ids[event.actor_id]] = step * STEP_S
            letters = {signal.signal_id: signal.state for signal in state.signals}[timing.signal_id]
            if letters[timing.link] == "r" and step > 20:
                red_s = step * STEP_S
                break
    assert red_s is not None
    if not crossed.keys() >= set(timing.platoon):
        return None
    return red_s - max(crossed[name] for name in timing.platoon)


def test_the_green_ends_behind_the_last_vehicle_of_the_stream() -> None:
    after_s = [late_s for seed in range(2) if (late_s := green_after_stream_s(seed)) is not None]
    assert after_s
    assert after_s == pytest.approx([1.2] * len(after_s), abs=0.7)


PROGRAMME = [SignalPhase(10.0, "rG"), SignalPhase(3.0, "ry"), SignalPhase(20.0, "Gr"), SignalPhase(3.0, "yr")]


@dataclass
class Signal:
    """A stand-in for SUMO: state and arrivals of vehicles; link 1 is green in phase 0, link 0 in phase 2.

    Vehicles drive with 10 m/s, of which all but the EMV wish for no more.
    """

    phase: int = 0
    switch_s: float = 100.0
    arrivals_s: dict[str, float] = field(default_factory=dict)
    leader: tuple[str, float] | None = None
    emv_most_mps: float = 10.0
    phases: list[SignalPhase] = field(default_factory=lambda: list(PROGRAMME))
    asked: list[tuple[str, float]] = field(default_factory=list)
    modes: list[tuple[str, int]] = field(default_factory=list)

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        def programmes(_signal: str) -> list[Any]:
            phases = [SimpleNamespace(duration=phase.duration_s, state=phase.state) for phase in self.phases]
            other = [SimpleNamespace(duration=1.0, state="rr")]
            return [SimpleNamespace(programID=name, phases=those) for name, those in (("0", other), ("1", phases))]

        light = SimpleNamespace(
            getProgram=lambda _signal: "1",
            getAllProgramLogics=programmes,
            getRedYellowGreenState=lambda _signal: self.phases[self.phase].state,
            getPhase=lambda _signal: self.phase,
            getNextSwitch=lambda _signal: self.switch_s,
            setPhase=lambda _signal, phase: self.asked.append(("phase", phase)),
            setPhaseDuration=lambda _signal, duration_s: self.asked.append(("duration", duration_s)),
        )
        clock = SimpleNamespace(getTime=lambda: 50.0)
        vehicle = SimpleNamespace(
            getSpeed=lambda _name: 10.0,
            getAllowedSpeed=lambda _name: self.emv_most_mps,
            getLeader=lambda _name, _range_m: self.leader,
            getNextTLS=lambda name: [("s", 1, 10.0 * self.arrivals_s[name], "G")] if name in self.arrivals_s else [],
            setLaneChangeMode=lambda name, mode: self.modes.append((name, mode)),
        )
        monkeypatch.setattr(orders, "libsumo", SimpleNamespace(trafficlight=light, simulation=clock, vehicle=vehicle))


@pytest.fixture(name="signal")
def _signal(monkeypatch: pytest.MonkeyPatch) -> Signal:
    signal = Signal()
    signal.install(monkeypatch)
    return signal


def gap_out(red_from_s: float = 5.0, platoon: tuple[str, ...] = ("a", "b")) -> GapOut:
    return GapOut(SignalTiming(signal_id="s", link=1, red_from_s=red_from_s, platoon=platoon, emv="e"))


BOTH = {"a", "b"}
NEAR_S = detector_s(3.0)


@pytest.mark.parametrize(
    ("last_s", "asked"), [(NEAR_S - 0.01, [("phase", 1)]), (NEAR_S, [("phase", 1)]), (NEAR_S + 0.01, [])]
)
def test_the_green_ends_as_the_last_one_reaches_the_detector(
    signal: Signal, last_s: float, asked: list[tuple[str, float]]
) -> None:
    signal.arrivals_s = {"a": 0.1, "b": last_s}
    control = gap_out()
    control.apply(BOTH)
    assert signal.asked == asked
    signal.arrivals_s = {"a": 0.1, "b": 0.1}
    control.apply(BOTH)
    assert signal.asked == [("phase", 1)], "once only"


@pytest.mark.parametrize(
    ("platoon_s", "emv_s", "more", "leader", "ends"),
    [
        *[(9.0, 3.41, {}, None, False), (9.0, 3.39, {}, None, True)],
        *[(9.0, 7.41, {"crossing": (0,)}, None, False), (9.0, 7.39, {"crossing": (0,)}, None, True)],
        *[(9.0, 3.0, {"emv_from_s": 3.3}, None, True), (9.0, 3.0, {"emv_from_s": 4.0}, None, False)],
        *[(0.1, 3.41, {}, ("a", 15.0), False), (0.1, 3.39, {}, ("a", 15.0), True), (0.1, 9.0, {}, ("z", 15.0), True)],
    ],
)
def test_the_red_begins_before_the_emv_comes_and_not_sooner_where_it_follows(
    signal: Signal, platoon_s: float, emv_s: float, more: Any, leader: Any, ends: bool
) -> None:
    """Yellow lasts 3 s, and the red begins 0.4 s before the EMV comes; crossing traffic needs 4 s more to be inside.

    Bends may keep the EMV until some time. An early red would slow it down behind the last one of its platoon.
    """
    signal.arrivals_s, signal.leader = {"a": platoon_s, "e": emv_s}, leader
    GapOut(SignalTiming("s", 1, 5.0, platoon=("a",), emv="e", **more)).apply({"a", "e"})
    assert signal.asked == ([("phase", 1)] if ends else [])


@pytest.mark.parametrize(
    ("leader", "ends"),
    [(None, True), (("b", 20.0), False), (("", -1.0), True), (("b", 50.0), True)],
    ids=["alone", "behind another one", "nobody", "behind one beyond the line"],
)
def test_an_emv_that_can_accelerate_is_there_sooner(
    signal: Signal, leader: tuple[str, float] | None, ends: bool
) -> None:
    """40 m ahead: 4 s at its speed, 3.1 s with 2 m/s2. An EMV that has left SUMO is not asked for."""
    signal.arrivals_s, signal.emv_most_mps, signal.leader = {"a": 1.0, "b": 9.0, "e": 4.0}, 20.0, leader
    control = gap_out()
    control.apply(BOTH)
    assert not signal.asked
    control.apply({*BOTH, "e"})
    assert signal.asked == ([("phase", 1)] if ends else [])


@pytest.mark.parametrize(("left_s", "holds"), [(STEP_S + 0.01, False), (0.5 * STEP_S, True), (0.0, True)])
def test_a_green_that_would_end_before_is_held_from_step_to_step(signal: Signal, left_s: float, holds: bool) -> None:
    signal.arrivals_s = {"a": 9.0, "b": 0.1}
    signal.switch_s = 50.0 + left_s
    control = gap_out()
    for _ in range(3):
        control.apply(BOTH)
    assert signal.asked == [("duration", 2.0 * STEP_S)] * (3 if holds else 0)


def test_the_platoon_keeps_its_lanes_up_to_the_line(signal: Signal) -> None:
    """On the way to the lane of its next turn it would drive in front of the EMV; so do those next to the EMV."""
    signal.arrivals_s = {"a": 0.1, "c": 20.0}
    GapOut(SignalTiming("s", 1, 5.0, platoon=("a",), emv="e", beside=("c",))).apply({"a", "c"})
    assert signal.modes == [("a", KEEP_LANE_CHANGE_MODE), ("c", KEEP_LANE_CHANGE_MODE)]
    assert signal.asked == [("phase", 1)], "the green does not wait for those"
    control = gap_out()
    for arrivals_s, modes in (
        ({"a": 3.0, "b": 5.0}, [("a", KEEP_LANE_CHANGE_MODE), ("b", KEEP_LANE_CHANGE_MODE)]),
        ({"a": 0.1, "b": 2.0}, []),
        ({"b": 1.0}, [("a", DEFAULT_LANE_CHANGE_MODE)]),
        ({}, [("b", DEFAULT_LANE_CHANGE_MODE)]),
        ({}, []),
    ):
        signal.arrivals_s, signal.modes = arrivals_s, []
        control.apply(BOTH)
        assert signal.modes == modes


@pytest.mark.parametrize(("approach", "kept"), [((), True), ((1, 2), True), ((2,), False)])
def test_who_comes_to_another_link_of_the_signal_has_passed(
    signal: Signal, approach: tuple[int, ...], kept: bool
) -> None:
    """One signal may stand at several junctions, one behind the other."""
    signal.arrivals_s = {"a": 1.0}
    control = GapOut(SignalTiming("s", 1, 5.0, platoon=("a",), emv="e", approach=approach))
    control.apply({"a"})
    assert signal.modes == ([("a", KEEP_LANE_CHANGE_MODE)] if kept else [])
    assert signal.asked == ([("phase", 1)] if kept else []), "nobody is waited for"


def test_a_red_is_waited_for(signal: Signal) -> None:
    signal.phase, signal.arrivals_s = 2, {"a": 0.1}
    control = gap_out()
    control.apply(BOTH)
    assert not signal.asked
    signal.phase = 0
    control.apply(BOTH)
    assert signal.asked == [("phase", 1)]


@pytest.mark.parametrize("gone", ["not present", "past the line"])
def test_nothing_is_done_any_more_once_the_platoon_is_gone(signal: Signal, gone: str) -> None:
    signal.arrivals_s = {} if gone == "past the line" else {"a": 9.0}
    control = gap_out()
    control.apply({"b", "c"} if gone == "not present" else BOTH)
    signal.arrivals_s = {"a": 0.1}
    control.apply(BOTH)
    assert not signal.asked


def test_nobody_is_waited_for_too_long(signal: Signal) -> None:
    """10 s longer than planned."""
    signal.arrivals_s, signal.switch_s = {"a": 9.0}, 50.0
    control = gap_out(red_from_s=1.0)
    steps = round((1.0 + 10.0) / STEP_S)
    for _ in range(steps + 5):
        control.apply(BOTH)
    assert len(signal.asked) == pytest.approx(steps, abs=1)
    signal.arrivals_s = {"a": 0.1}
    control.apply(BOTH)
    assert ("phase", 1) not in signal.asked


def test_a_link_without_yellow_and_a_signal_without_a_platoon_are_left_alone(signal: Signal) -> None:
    signal.phases = [SignalPhase(10.0, "rG"), SignalPhase(10.0, "Gr")]
    signal.arrivals_s = {"a": 0.1}
    control = gap_out()
    control.apply(BOTH)
    signal.phases = list(PROGRAMME)
    control.apply(BOTH)
    gap_out(platoon=()).apply(BOTH)
    assert not signal.asked


@pytest.mark.parametrize("level", [EmergencyLevel.L0, EmergencyLevel.L1])
def test_an_emv_that_sumo_drives_stays_at_the_end_of_its_route(level: EmergencyLevel) -> None:
    """At L1 it is driven from outside; here nobody does, and SUMO takes it out at the end of the road."""
    compiled, network = load_map(None)
    plan, _ = plan_s2(network)
    emv = plan.emvs[0]
    lane = network.lanes[emv.spot.lane]
    alone = replace(emv, route=emv.route[:1], spot=Spot(lane.index, lane.length_m - 60.0, 10.0))
    plan = replace(plan, emvs=(alone,), groups=(), background=(), reserve=())
    with SumoSimulation(compiled, network, plan, level) as simulation:
        for step in range(250):
            state = simulation.step(step, None)
    there = np.flatnonzero(state.actor_id == 1)
    assert len(there) == (level is EmergencyLevel.L0)
    assert (state.speed_mps[there] == 0.0).all()
    assert np.allclose(state.lane_position_m[there], lane.length_m - 1.0, atol=1.0)


def test_each_of_several_emvs_is_stopped_once_at_the_end_of_its_own_route(monkeypatch) -> None:
    stopped: list[tuple[str, str]] = []
    at_m = {"a": 10.0, "b": 10.0}
    for name, answer in {
        "getRouteIndex": lambda _: 1,
        "getLaneID": lambda name: f"{name}1_0",
        "getLaneIndex": lambda _: 0,
        "getSpeed": lambda _: 5.0,
        "getLanePosition": at_m.get,
        "setStop": lambda name, edge, *_: stopped.append((name, edge)),
    }.items():
        monkeypatch.setattr(libsumo.vehicle, name, answer)
    monkeypatch.setattr(libsumo.lane, "getLength", lambda _: 300.0)
    ends = RouteEnds([SimpleNamespace(name=name, route=(f"{name}0", f"{name}1")) for name in at_m])
    for changed, expected in (({"a": 10.0}, []), ({"a": 295.0}, ["a"]), ({"b": 295.0}, ["a", "b"]), ({}, ["a", "b"])):
        at_m.update(changed)
        ends.apply({*at_m})
        assert stopped == [(name, f"{name}1") for name in expected]


def test_the_head_of_a_jam_is_freed_once_and_only_those_whom_sumo_drives_are_told(monkeypatch) -> None:
    told: list[tuple[str, float]] = []
    monkeypatch.setattr(libsumo.vehicle, "setSpeed", lambda name, mps: told.append((name, mps)))
    orders = JamOrders(JamHead(names=("a", "b"), moves=False, roll_s=0.05, roll_mps=2.0, stand_s=1.0, until_s=0.1))
    for step, present in enumerate([{"a", "b", "c"}, {"b"}, {"a"}, {"a", "b"}]):
        orders.apply(step, present)
    assert told == [("a", 2.0), ("b", 2.0), ("b", 0.0), ("a", -1.0)]


EMV, FIRST, SECOND = 1, 2, 3
EMVS = frozenset({"emv0", "emv1"})


@pytest.fixture(scope="module")
def vehicles() -> dict[int, PlannedVehicle]:
    plan, _, _ = plan_of("S2", load_map(None)[1], 0)
    return {EMV: plan.emvs[0], FIRST: plan.background[0], SECOND: plan.background[1]}


def scene(
    speeds_mps: tuple[float, float, float],
    inside: tuple[bool, bool, bool] = (True, True, True),
    owner: Owner = Owner.SUMO,
) -> TrafficState:
    """The EMV and two civilians, with who is on the junction; ``owner`` is the first civilian's."""
    columns = {
        "actor_id": np.array([EMV, FIRST, SECOND], np.uint32),
        "owner": np.array([Owner.ROS, owner, Owner.SUMO], np.uint8),
        "speed_mps": np.array(speeds_mps),
        "flags": np.array([TrafficFlags.ON_JUNCTION if is_in else 0 for is_in in inside], np.uint8),
    }
    return replace(traffic_of(0, ""), **columns)  # type: ignore[arg-type] # fields by name


def test_who_stands_there_with_the_emv_need_not_wait_for_it_until_the_junction_lies_behind(vehicles) -> None:
    names, passed = [vehicles[key].name for key in (FIRST, SECOND)], EMVS | {vehicles[EMV].name}
    going = drivers_who_go({}, scene((1.0, 0.0, 0.0)), vehicles, EMVS)
    assert going == {}, "the EMV moves"
    going = drivers_who_go(going, scene((0.0, 0.0, 3.0)), vehicles, EMVS)
    assert going == {names[0]: passed}
    going = drivers_who_go(going, scene((2.0, 3.0, 0.0)), vehicles, EMVS)
    assert going == {names[0]: passed}, "who has begun to go goes on, and nobody else begins"
    assert drivers_who_go(going, scene((2.0, 3.0, 0.0), inside=(True, False, True)), vehicles, EMVS) == {}


def test_who_stands_there_with_a_civilian_who_makes_room_need_not_wait_for_it(vehicles) -> None:
    """The EMV is still on its way; it is not waited for either, once it stands behind those two."""
    first, second = (vehicles[key].name for key in (FIRST, SECOND))
    going = drivers_who_go({}, scene((4.0, 0.0, 0.0), inside=(False, True, True), owner=Owner.ROS), vehicles, EMVS)
    assert going == {second: EMVS | {first}}
    moves = scene((4.0, 1.0, 0.0), inside=(False, True, True), owner=Owner.ROS)
    assert drivers_who_go({}, moves, vehicles, EMVS) == {}


def test_only_drivers_of_sumo_on_the_junction_go(vehicles) -> None:
    assert drivers_who_go({}, scene((0.0, 0.0, 0.0), inside=(False, True, True)), vehicles, EMVS) == {}
    assert drivers_who_go({}, scene((0.0, 0.0, 1.0), owner=Owner.ROS), vehicles, EMVS) == {}


def test_who_has_left_the_simulation_is_forgotten(vehicles) -> None:
    before = scene((0.0, 0.0, 0.0))
    going = drivers_who_go({}, before, vehicles, EMVS)
    rest = before.actor_id != FIRST
    columns = {name: getattr(before, name)[rest] for name in ("actor_id", "owner", "speed_mps", "flags")}
    assert list(drivers_who_go(going, replace(before, **columns), vehicles, EMVS)) == [vehicles[SECOND].name]


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    calls: list[tuple[str, str]] = []
    monkeypatch.setattr(libsumo.vehicle, "setParameter", lambda name, _, names: calls.append((name, names)))
    return calls


def test_drivers_are_told_where_something_has_changed_for_them(told) -> None:
    foes = IgnoredFoes()
    foes.apply(["a"], [], {})
    assert told == []
    foes.apply(["a", "b"], ["kerb"], {})
    assert told == [("a", "kerb"), ("b", "kerb")]
    foes.apply(["a", "b"], ["kerb"], {})
    assert len(told) == 2
    foes.apply(["a", "b", "c"], ["kerb"], {})
    assert told[2:] == [("c", "kerb")]
    told.clear()
    foes.apply(["a", "c"], [], {})
    assert told == [("a", ""), ("c", "")], "b has left"


@pytest.mark.parametrize(("level", "ignored"), [(EmergencyLevel.L1, "emv0 emv1"), (EmergencyLevel.L0, "")])
def test_stand_offs_are_looked_for_where_emvs_run_red_lights(told, vehicles, level, ignored) -> None:
    network, first = load_map(None)[1], vehicles[FIRST].name
    plan, emv = plan_s2(network)[0], vehicles[EMV]
    plan = replace(plan, emvs=(emv, replace(emv, name="emv1")))
    act = next(rule for rule in RULES if rule.name == "stand-offs").make(Setting(network, plan, level))
    columns = SimpleNamespace(names=[first])
    for last in (None, scene((0.0, 0.0, 3.0))):
        assert told == []
        act(SimpleNamespace(last=last, reported=vehicles, columns=columns, walkers=None))
    assert told == ([(first, ignored)] if ignored else [])


def test_what_holds_for_all_and_for_one_holds_at_once(told) -> None:
    """The parameter is one: who waits for nobody at the kerb still does not wait for the EMV."""
    foes = IgnoredFoes()
    foes.apply(["a", "b"], [], {"a": frozenset({"emv0", "car1"})})
    assert told == [("a", "car1 emv0")]
    foes.apply(["a", "b"], ["kerb"], {"a": frozenset({"emv0", "car1"})})
    assert told[1:] == [("a", "kerb car1 emv0"), ("b", "kerb")]
    foes.apply(["a", "b"], ["kerb"], {})
    assert told[3:] == [("a", "kerb")]
