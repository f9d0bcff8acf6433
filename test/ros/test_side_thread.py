"""Work beside a node's callbacks: in order, in one thread, with errors where they are waited for."""

import threading

import pytest

from siren_ros.ros.side_thread import SideThread
from siren_ros.world.errors import EpisodeError


def test_pieces_are_done_in_order_in_one_thread_of_their_own() -> None:
    side, seen = SideThread("side"), list[tuple[int, int]]()
    for number in range(100):
        side.put(lambda number=number: seen.append((number, threading.get_ident())))  # type: ignore[misc]  # binds now
    side.finish()
    assert [number for number, _ in seen] == list(range(100))
    assert len({thread for _, thread in seen}) == 1
    assert seen[0][1] != threading.get_ident()


def test_a_call_gives_what_the_piece_gives_or_raises() -> None:
    side = SideThread("side")
    assert side.call(lambda: 7) == 7
    with pytest.raises(ZeroDivisionError):
        side.call(lambda: 1 // 0)
    assert side.call(lambda: 8) == 8


def test_a_piece_that_does_not_end_is_reported() -> None:
    side, release = SideThread("side"), threading.Event()
    side.put(release.wait)
    with pytest.raises(EpisodeError, match="side still works on a step"):
        side.finish(0.02)
    release.set()
    side.finish()
