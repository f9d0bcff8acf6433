import signal
import threading

import pytest

from siren_ros.base.processes.interrupts import children_without_ctrl_c, deferred_interrupts


@pytest.fixture(autouse=True)
def _handlers():
    """SIGTERM raises as SIGINT does, as in the command line."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("numbers", [[signal.SIGINT], [signal.SIGTERM], [signal.SIGINT] * 2])
def test_a_signal_waits_for_the_end_and_a_second_one_acts_at_once(numbers) -> None:
    reached = []

    def work() -> None:
        with deferred_interrupts() as interrupted:
            assert not interrupted()
            for number in numbers:
                signal.raise_signal(number)
                reached.append(interrupted())

    with pytest.raises(KeyboardInterrupt):
        work()
    assert reached == [True]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_without_a_signal_nothing_is_raised_and_the_handlers_are_those_before() -> None:
    before = signal.getsignal(signal.SIGINT)
    with deferred_interrupts() as interrupted:
        assert signal.getsignal(signal.SIGINT) is not before
        assert not interrupted()
    assert signal.getsignal(signal.SIGINT) is before


def test_other_threads_get_no_signals() -> None:
    said = []

    def work() -> None:
        with deferred_interrupts() as interrupted:
            said.append(interrupted())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert said == [False]


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    """As SIGINT in a program that a script runs in the background."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with deferred_interrupts() as interrupted:
            signal.raise_signal(signal.SIGINT)
            assert not interrupted()
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("held", [set(), {signal.SIGINT}, {signal.SIGTERM}])
def test_ctrl_c_is_kept_from_children_alone(held) -> None:
    """What a thread blocked before it starts them stays blocked, and nothing else."""
    before = signal.pthread_sigmask(signal.SIG_SETMASK, held)
    try:
        with children_without_ctrl_c():
            assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == held | {signal.SIGINT}
        assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == held
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
