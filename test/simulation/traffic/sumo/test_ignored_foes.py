"""For whom SUMO's drivers do not wait on junctions."""

import libsumo
import pytest

from siren_ros.simulation.traffic.sumo.ignored_foes import IgnoredFoes


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, str]]:
    calls: list[tuple[str, str]] = []
    monkeypatch.setattr(libsumo.vehicle, "setParameter", lambda name, _, names: calls.append((name, names)))
    return calls


def test_drivers_are_told_where_something_has_changed_for_them(told) -> None:
    foes = IgnoredFoes()
    foes.apply(["a", "b"], ["kerb"], {})
    assert told == [("a", "kerb"), ("b", "kerb")]
    foes.apply(["a", "b"], ["kerb"], {})
    assert len(told) == 2
    foes.apply(["a", "b", "c"], ["kerb"], {})
    assert told[2:] == [("c", "kerb")]
    told.clear()
    foes.apply(["a", "c"], [], {})
    assert told == [("a", ""), ("c", "")], "b has left"


def test_what_holds_for_all_and_for_one_holds_at_once(told) -> None:
    """The parameter is one: who waits for nobody at the kerb still does not wait for the EMV."""
    foes = IgnoredFoes()
    foes.apply(["a", "b"], [], {"a": frozenset({"emv0", "car1"})})
    assert told == [("a", "car1 emv0")]
    foes.apply(["a", "b"], ["kerb"], {"a": frozenset({"emv0", "car1"})})
    assert told[1:] == [("a", "kerb car1 emv0"), ("b", "kerb")]
    foes.apply(["a", "b"], ["kerb"], {})
    assert told[3:] == [("a", "kerb")]


def test_nobody_is_told_where_there_is_nothing(told) -> None:
    IgnoredFoes().apply(["a"], [], {})
    assert told == []
