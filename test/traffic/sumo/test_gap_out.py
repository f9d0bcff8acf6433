"""When a green ends behind a platoon: a stand-in for SUMO says the state of the signal and when the vehicles arrive."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest

from siren_ros.numerics.units import STEP_S
from siren_ros.traffic.demand.plan import SignalTiming
from siren_ros.traffic.sumo import signal_timing
from siren_ros.traffic.sumo.signal_timing import GapOut, SignalPhase, detector_s

PHASES = [SignalPhase(10.0, "rG"), SignalPhase(3.0, "ry"), SignalPhase(20.0, "Gr"), SignalPhase(3.0, "yr")]


@dataclass
class Signal:
    """The stand-in; link 1 is green in phase 0, link 0 in phase 2."""

    phase: int = 0
    switch_s: float = 100.0
    arrivals_s: dict[str, float] = field(default_factory=dict)
    phases: list[SignalPhase] = field(default_factory=lambda: list(PHASES))
    asked: list[tuple[str, float]] = field(default_factory=list)

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        light = SimpleNamespace(
            getRedYellowGreenState=lambda _signal: self.phases[self.phase].state,
            getPhase=lambda _signal: self.phase,
            getNextSwitch=lambda _signal: self.switch_s,
            setPhase=lambda _signal, phase: self.asked.append(("phase", phase)),
            setPhaseDuration=lambda _signal, duration_s: self.asked.append(("duration", duration_s)),
        )
        clock = SimpleNamespace(getTime=lambda: 50.0)
        monkeypatch.setattr(signal_timing, "libsumo", SimpleNamespace(trafficlight=light, simulation=clock))
        monkeypatch.setattr(signal_timing, "_programme", lambda _signal: self.phases)
        monkeypatch.setattr(
            signal_timing,
            "_arrivals_s",
            lambda name, _signal: [self.arrivals_s[name]] if name in self.arrivals_s else [],
        )


@pytest.fixture(name="signal")
def _signal(monkeypatch: pytest.MonkeyPatch) -> Signal:
    signal = Signal()
    signal.install(monkeypatch)
    return signal


def gap_out(red_from_s: float = 5.0, platoon: tuple[str, ...] = ("a", "b")) -> GapOut:
    return GapOut(SignalTiming(signal_id="s", link=1, red_from_s=red_from_s, crossing=(0,), platoon=platoon))


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


@pytest.mark.parametrize(("left_s", "holds"), [(STEP_S + 0.01, False), (0.5 * STEP_S, True), (0.0, True)])
def test_a_green_that_would_end_before_is_held_from_step_to_step(signal: Signal, left_s: float, holds: bool) -> None:
    signal.arrivals_s = {"a": 9.0, "b": 0.1}
    signal.switch_s = 50.0 + left_s
    control = gap_out()
    for _ in range(3):
        control.apply(BOTH)
    assert signal.asked == [("duration", 2.0 * STEP_S)] * (3 if holds else 0)


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
    signal.arrivals_s, signal.switch_s = {"a": 9.0}, 50.0
    control = gap_out(red_from_s=1.0)
    steps = round((1.0 + signal_timing._LONGEST_GREEN_S) / STEP_S)
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
    signal.phases = list(PHASES)
    control.apply(BOTH)
    gap_out(platoon=()).apply(BOTH)
    assert not signal.asked
