"""The environments of Gymnasium, on short episodes, with left-hand traffic too."""

import pytest

gymnasium = pytest.importorskip("gymnasium", reason="the extra learn is not installed")

import subprocess
import sys
import warnings
from functools import partial
from pathlib import Path

import numpy as np
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv
from recorded_episode import quick_template

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import EpisodeError, InputError
from siren_ros.lab.learning import ENVIRONMENTS
from siren_ros.lab.learning.environment import EmergencyEnv, YieldEnv
from siren_ros.running.generation.replay_check import repeat_episode
from siren_ros.running.seat.policy import Manoeuvre
from siren_ros.scoring.judging.verify import check_message_counts, check_state_hashes
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.map_formats import mirrored_net
from siren_ros.simulation.traffic.observation import check_residual

SHORT = {"template": quick_template("S2"), "level": 2, "duration_s": 2.0}
YIELD = "siren/Yield-v0"
KEEP, STOP = 0, 4


def made(name: str = YIELD, **options):
    return gymnasium.make(name, **{**SHORT, **options})


@pytest.mark.parametrize(
    ("name", "options"),
    [(YIELD, {}), ("siren/Emergency-v0", {"action": "continuous", "observation": "raster"})],
)
def test_gymnasium_finds_nothing_wrong(name: str, options: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(made(name, **options).unwrapped)


def test_an_episode_without_an_end_before_is_truncated_when_its_time_is_over(tmp_path: Path) -> None:
    with made(record_to=tmp_path) as env:
        for _ in range(2):
            env.reset(seed=7)
            results = [env.step(KEEP) for _ in range(10)]
    assert len({*tmp_path.iterdir()}) == 2, "each episode has its bag"
    assert [result[2:4] for result in results] == [(False, False)] * 9 + [(False, True)]
    info = results[-1][4]
    assert info["ended"] == "time"
    assert info["time_s"] == pytest.approx(1.95)
    assert info["clauses"]["contact"] == "pass"
    assert "ended" not in results[0][4]


def test_a_contact_terminates() -> None:
    with made("siren/Emergency-v0", action="continuous", duration_s=30.0) as env:
        env.reset(seed=8)
        result = env.step(np.array([1.0, 0.0, 0.0], np.float32))
        while not (result[2] or result[3]):
            result = env.step(np.array([1.0, 0.0, 0.0], np.float32))
        assert result[2:4] == (True, False)
        assert result[4]["ended"] == "contact"
        assert result[4]["terms"]["contact"] == 1.0
        assert result[1] < -10.0
        with pytest.raises(EpisodeError, match="has ended"):
            env.step(np.zeros(3, np.float32))


def test_a_failed_simulation_terminates_and_its_steps_are_saved(tmp_path, monkeypatch) -> None:
    def failing(states, limit_m):
        if states.step == 9:
            raise EpisodeError("too far apart")
        check_residual(states, limit_m)

    with made() as env:
        monkeypatch.setattr("siren_ros.running.generation.closed_loop.check_residual", failing)
        env.reset(seed=7)
        env.step(KEEP)
        env.step(KEEP)
        _, _, terminated, truncated, info = env.step(KEEP)
        assert (terminated, truncated, info["ended"]) == (True, False, "failed")
        assert info["failure"] == "too far apart"
        assert env.unwrapped.save(tmp_path / "bag").outcome.steps == 9


def test_seeds_are_those_of_episodes_and_those_drawn_follow_from_the_last_one() -> None:
    with made() as env:
        first, info = env.reset(seed=7)
        assert info["seed"] == 7
        drawn = [env.reset()[1]["seed"] for _ in range(2)]
        again, _ = env.reset(seed=7)
        assert np.array_equal(first, again)
        assert [env.reset()[1]["seed"] for _ in range(2)] == drawn
        assert env.reset(seed=8)[1]["seed"] == 8
        assert env.reset()[1]["seed"] != drawn[0]
    with made(seeds=(5, 6)) as env:
        env.reset(seed=1)
        assert env.reset()[1]["seed"] == 5


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_a_saved_rollout_is_verified_and_has_the_same_states(name: str, tmp_path: Path) -> None:
    with made(name, action="continuous", duration_s=20.0) as env:
        env.action_space.seed(1)
        env.reset(seed=7)
        for _ in range(6):
            env.step(env.action_space.sample())
        hashes = [step.state_hash for step in env.unwrapped.rollout.steps]
        env.unwrapped.save(tmp_path / "bag")
        env.step(env.action_space.sample())  # the rollout goes on
    record = read_episode(tmp_path / "bag")
    assert record.complete
    assert [record.state_hashes[step] for step in range(25)] == hashes
    assert len(record.states) == 25
    for check in (check_message_counts, check_state_hashes):
        assert check(record).holds
    assert repeat_episode(record) is None


def test_two_environments_of_a_process_take_turns() -> None:
    def rewards(env, count: int) -> list[float]:
        return [env.step(STOP)[1] for _ in range(count)]

    with made() as alone:
        alone.reset(seed=7)
        expected = rewards(alone, 6)
    with made() as one, made() as other:
        one.reset(seed=7)
        before = rewards(one, 3)
        other.reset(seed=8)
        with pytest.warns(UserWarning, match="take turns"):
            after = rewards(one, 3)
    assert before + after == expected


def test_processes_give_the_same_as_one() -> None:
    expected = []
    for seed in (7, 8):
        with made() as env:
            env.reset(seed=seed)
            expected.append([env.step(STOP)[1] for _ in range(3)])
    environments = AsyncVectorEnv(
        [partial(gymnasium.make, f"siren_ros.lab.learning:{YIELD}", **SHORT)] * 2, context="forkserver"
    )
    try:
        environments.reset(seed=7)
        rewards = [environments.step(np.array([STOP, STOP]))[1] for _ in range(3)]
    finally:
        environments.close()
    assert np.allclose(np.array(rewards).T, expected, rtol=0.0, atol=1e-12)


def test_weights_make_the_reward_and_a_reset_has_its_own() -> None:
    with made(rewards={"progress": 1.0, "emv_delay": 0.0}) as env:
        env.reset(seed=7)
        _, reward, _, _, info = env.step(KEEP)
        assert info["terms"]["emv_delay"] > 0.0
        assert reward == pytest.approx(info["terms"]["progress"] - info["terms"]["indicator"])
        env.reset(seed=7, options={"decision_s": 0.5, "rewards": {"progress": 0.0, "emv_delay": -7.0}})
        _, reward, _, _, info = env.step(KEEP)
    assert info["time_s"] == pytest.approx(0.5)
    assert reward == pytest.approx(-7.0 * info["terms"]["emv_delay"] - info["terms"]["indicator"])


def test_options_of_a_reset_hold_for_one_episode() -> None:
    with made(template="S4") as other:
        wanted, _ = other.reset(seed=7)
    with made() as env:
        own, _ = env.reset(seed=7)
        changed, _ = env.reset(seed=7, options={"template": "S4"})
        again, _ = env.reset(seed=7)
    assert np.array_equal(changed, wanted)
    assert np.array_equal(again, own)
    assert not np.array_equal(own, wanted)


def test_options_of_a_reset_that_cannot_be_used_leave_the_episode_as_it_is() -> None:
    wrong = {"option: 'tempalte' .*template, level": {"tempalte": "S4"}, "level: 9": {"level": 9}}
    wrong |= {"option: 'observation'": {"observation": "raster"}, "rewards: 'speed'": {"rewards": {"speed": 1.0}}}
    with made() as env:
        env.reset(seed=7)
        for names, options in wrong.items():
            with pytest.raises(InputError, match=names):
                env.reset(seed=7, options=options)
        env.step(KEEP)
        assert env.unwrapped.rollout.setup.description.template == "S2"


NO_MANOEUVRES = [7, -1, 2.7, float("nan"), "keep", None, [0, 1], True]
NO_PEDALS = [[0.0, np.nan, 0.0], [np.inf, 0.0, 0.0], [0.0, 0.0], 0.0, ["a", "b", "c"]]


@pytest.mark.parametrize(
    ("kind", "wrong", "right", "allowed"),
    [
        ("manoeuvre", NO_MANOEUVRES, np.int64(KEEP), r"action: .*0 \(keep\), 1 \(left\)"),
        ("continuous", NO_PEDALS, [0.5, 0.0, 0.0], r"action: .*3 finite numbers"),
    ],
)
def test_what_is_no_action_is_refused_before_anything_changes(kind: str, wrong: list, right, allowed: str) -> None:
    with made(action=kind) as env:
        env.reset(seed=7)
        for action in wrong:
            with pytest.raises(InputError, match=allowed):
                env.step(action)
            assert len(env.unwrapped.rollout.steps) == 1
        assert env.step(right)[4]["time_s"] == pytest.approx(0.2)


def test_the_documented_order_of_imports_finds_the_name_and_warns_of_nothing() -> None:
    program = "import siren_ros.lab.learning, gymnasium; print(gymnasium.spec('siren/Yield-v0').id)"
    done = subprocess.run([sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.stderr) == ("siren/Yield-v0", "")


@pytest.mark.parametrize(
    ("options", "names"),
    [
        ({"observation": "radar"}, "observation: 'radar'"),
        ({"action": "fly"}, "action: 'fly'"),
        ({"level": 9}, "level: 9"),
        ({"decision_s": 0.07}, "decision_s: 0.07"),
        ({"rewards": {"speed": 1.0}}, "rewards: 'speed'"),
        ({"seeds": (3, 3)}, "seeds"),
        ({"render_mode": "ansi"}, "render_mode: 'ansi'"),
        ({"rulebook": "nowhere"}, "rulebook"),
        ({"snapshots": -1}, "snapshots: -1"),
        ({"sensors": "front"}, r"option: 'sensors' .*template, level"),
    ],
)
def test_options_that_cannot_be_used_are_named(options: dict[str, object], names: str) -> None:
    with pytest.raises(InputError, match=names):
        YieldEnv(**options)


MANOEUVRES = [Manoeuvre.KEEP, Manoeuvre.LEFT, Manoeuvre.LEFT, Manoeuvre.PULL_OVER, Manoeuvre.PULL_OVER, Manoeuvre.STOP]


@pytest.fixture(scope="module")
def towns(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    net = compile_map(None).read_bytes()
    for name, content in (("right", net), ("left", mirrored_net(net))):
        (folder / f"{name}.net.xml").write_bytes(content)
    return {name: str(folder / f"{name}.net.xml") for name in ("right", "left")}


@pytest.mark.parametrize(("kind", "action"), [(YieldEnv, "manoeuvre"), (EmergencyEnv, "continuous")])
def test_the_same_actions_give_the_same_observations_and_rewards(towns, kind, action) -> None:
    given = [int(manoeuvre) for manoeuvre in MANOEUVRES]
    if action == "continuous":
        given = list(np.random.default_rng(0).uniform(-1.0, 1.0, (6, 3)).astype(np.float32))
    seen, sides = {}, {}
    for side, town in towns.items():
        env = kind(map=town, template="S2", level=2, action=action, decision_s=0.5)
        first, _ = env.reset(seed=7)
        results = [env.step(one)[:4] for one in given]
        sides[side] = env.rollout.setup.network.left_hand
        env.close()
        seen[side] = [first, *results]
    assert sides == {"right": False, "left": True}
    assert np.array_equal(seen["right"][0], seen["left"][0])
    for right, left in zip(seen["right"][1:], seen["left"][1:], strict=True):
        assert np.array_equal(right[0], left[0])
        assert right[1:] == left[1:]
    assert any((one[0] != other[0]).any() for one, other in zip(seen["right"][1:], seen["right"][2:], strict=False))
