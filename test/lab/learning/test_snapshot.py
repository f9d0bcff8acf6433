"""Runs of a snapshot have the bytes of the episode from its beginning, and their failures reach the program."""

import pytest

gymnasium = pytest.importorskip("gymnasium", reason="the extra learn is not installed")

import os
import select
import signal
from contextlib import closing
from pathlib import Path

from recorded_episode import quick_template

from siren_ros.errors import EpisodeError
from siren_ros.lab.learning import snapshot as snapshots
from siren_ros.lab.learning.environment import YieldEnv
from siren_ros.lab.learning.snapshot import drop_snapshot, run_of, take_snapshot
from siren_ros.running.generation.closed_loop import closed_loop
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest

REQUEST = EpisodeRequest(template=quick_template("S2"), level="L2", seed=7, sensors="none", duration_s=2.0)
SHORT = {"template": quick_template("S2"), "level": 2, "duration_s": 2.0}
PULL_OVER = 3


@pytest.fixture(scope="module")
def snapshot():
    taken = take_snapshot(REQUEST)
    yield taken
    drop_snapshot(taken)


def children_of(process: int) -> set[int]:
    return {int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text("ascii").split()}


def hashes(loop, steps: int = 20) -> list[int]:
    """Of steps without an answer, which the first and every second one have as None."""
    with closing(loop):
        return [loop.send(None if step % 2 == 0 else {}).state_hash for step in range(steps)]


def test_each_run_has_the_bytes_of_the_episode_from_its_beginning(snapshot) -> None:
    setup = set_up_episode(REQUEST)
    expected = hashes(closed_loop(setup, setup.steps))
    hashes(run_of(snapshot), 3)  # a run that ends early
    assert [hashes(run_of(snapshot)) for _ in range(2)] == [expected, expected]


def test_a_failure_reaches_the_program_and_the_next_run_is_as_before(snapshot, monkeypatch) -> None:
    first = hashes(run_of(snapshot), 2)
    loop = run_of(snapshot)
    next(loop)
    with pytest.raises(EpisodeError, match="AttributeError"):
        loop.send({1: "no control"})
    assert hashes(run_of(snapshot), 2) == first

    monkeypatch.setattr(snapshots, "closed_loop", lambda *_: os._exit(3))
    broken = take_snapshot(REQUEST)
    with pytest.raises(EpisodeError, match="has ended"):
        next(run_of(broken))
    drop_snapshot(broken)


def test_a_run_that_is_killed_is_an_error_and_no_hang() -> None:
    taken = take_snapshot(REQUEST)
    loop = run_of(taken)
    next(loop)
    (run,) = children_of(taken[2])
    os.kill(run, signal.SIGKILL)
    with pytest.raises(EpisodeError, match="has ended"):
        loop.send({})
    assert hashes(run_of(taken), 1)
    drop_snapshot(taken)


def test_the_processes_end_with_the_program() -> None:
    there, held_open = os.pipe()
    program = os.fork()
    if not program:
        next(run_of(take_snapshot(REQUEST)))
        os._exit(0)
    os.close(held_open)
    os.waitpid(program, 0)
    assert select.select([there], [], [], 60.0)[0], "a process of the snapshot still holds the pipe"
    os.close(there)


def test_an_environment_with_snapshots_gives_the_same_and_keeps_as_many_as_it_may() -> None:
    def drive(env, seed: int) -> list[int]:
        env.reset(seed=seed)
        for action in (0, PULL_OVER, PULL_OVER):
            env.step(action)
        return [step.state_hash for step in env.rollout.steps]

    before = children_of(os.getpid())
    plain, kept = YieldEnv(**SHORT), YieldEnv(**SHORT, snapshots=1)
    expected = {seed: drive(plain, seed) for seed in (7, 8)}
    plain.close()
    processes = []
    for seed in (7, 7, 8, 7):
        assert drive(kept, seed) == expected[seed]
        (process,) = children_of(os.getpid()) - before
        processes.append(process)
    assert processes[0] == processes[1]
    assert len(set(processes)) == 3
    kept.close()
    assert children_of(os.getpid()) == before


def test_an_environment_with_snapshots_takes_no_turns_with_another_one(recwarn) -> None:
    one, other = YieldEnv(**SHORT), YieldEnv(**SHORT, snapshots=1)
    one.reset(seed=7)
    other.reset(seed=8)
    one.step(0)
    other.step(0)
    one.step(0)
    one.close()
    other.close()
    assert not recwarn.list
