"""The claim to a DDS domain: one holder at a time on a machine, given back however the holder ends."""

import os
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from siren_ros.errors import InputError
from siren_ros.running.ros.transport import domain
from siren_ros.running.ros.transport.domain import (
    VARIABLE,
    DomainTakenError,
    check_alone,
    claimed_domain,
    in_free_domain,
)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="abstract sockets are Linux's")
HOLD = """
import sys
from siren_ros.running.ros.transport import domain
domain.CLAIM = sys.argv[1]
with domain.claimed_domain():
    print("held", flush=True)
    input()
"""


@pytest.fixture(autouse=True, name="claims")
def _claims(monkeypatch: pytest.MonkeyPatch) -> str:
    """Claims of this process alone: what episodes and other tests of this machine hold makes no difference."""
    monkeypatch.setattr(domain, "CLAIM", f"siren_ros/test {os.getpid()}")
    return domain.CLAIM


def test_a_domain_is_claimed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "101")
    refusal = pytest.raises(InputError, match=r"another one runs here already .*ROS_DOMAIN_ID=0")
    with claimed_domain(), refusal, claimed_domain():
        pytest.fail("claimed twice")
    with claimed_domain():
        pass


def test_without_a_chosen_domain_the_next_free_one_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    monkeypatch.delenv(VARIABLE, raising=False)

    def nested(depth: int) -> int:
        """An episode within an episode within an episode."""
        if depth == 3:
            return int(os.environ[VARIABLE])
        monkeypatch.delenv(VARIABLE)
        return in_free_domain(lambda: nested(depth + 1), lines.append)

    assert in_free_domain(lambda: nested(0), lines.append) == 3
    assert [line.rpartition(" ")[2] for line in lines] == [f"ROS_DOMAIN_ID={number}" for number in (1, 2, 3)]
    assert lines[-1].endswith("this episode has ROS_DOMAIN_ID=3")


def test_a_domain_that_turns_out_to_be_taken_is_left_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    tried: list[int] = []

    def run() -> int:
        tried.append(int(os.environ[VARIABLE]))
        if len(tried) == 1:
            raise DomainTakenError(VARIABLE, tried[0], "another one")
        return 7

    assert in_free_domain(run, lambda _line: None) == 7
    assert tried == [0, 1]


def test_a_chosen_domain_that_is_taken_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "98")
    with claimed_domain(), pytest.raises(DomainTakenError, match="ROS_DOMAIN_ID: 98 cannot be used"):
        in_free_domain(lambda: pytest.fail("it ran"), lambda _line: None)


def test_two_domains_are_two_claims(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "11")
    with claimed_domain():
        monkeypatch.setenv(VARIABLE, "12")
        with claimed_domain():
            for number in ("11", "12"):
                monkeypatch.setenv(VARIABLE, number)
                with pytest.raises(InputError), claimed_domain():
                    pytest.fail("claimed twice")


def test_a_killed_holder_leaves_no_claim(claims: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "99")
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, claims], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(InputError), claimed_domain():
            pytest.fail("claimed twice")
        holder.kill()
        holder.wait()
    with claimed_domain():
        pass


class GraphOf:
    """A node that sees programs publish the clock: those of each call, and then for ever those of the last."""

    def __init__(self, *calls: tuple[str, ...]) -> None:
        self._calls = list(calls)

    def get_publishers_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        assert topic == "/clock"
        names = self._calls.pop(0) if len(self._calls) > 1 else self._calls[0]
        return [SimpleNamespace(node_name=name) for name in names]


@pytest.mark.parametrize("calls", [((),), (("cosim",),), ((), ("cosim",))])
def test_who_is_alone_with_the_clock_goes_on(calls: tuple[tuple[str, ...], ...]) -> None:
    check_alone(GraphOf(*calls), time.monotonic())


@pytest.mark.parametrize(
    "calls", [(("cosim", "player"),), (("cosim",), ("player", "cosim")), (("cosim", "player", "player"),)]
)
def test_one_more_publisher_of_the_clock_is_refused_by_name(calls: tuple[tuple[str, ...], ...]) -> None:
    message = rf"/clock has {len(calls[-1])} publishers: cosim, player\)"
    with pytest.raises(DomainTakenError, match=message):
        check_alone(GraphOf(*calls), time.monotonic())


def test_a_publisher_that_is_found_after_the_time_of_discovery_is_refused_too() -> None:
    """Loading modules may have taken longer than discovery does."""
    with pytest.raises(DomainTakenError):
        check_alone(GraphOf(("cosim", "player")), time.monotonic() - 10.0)
