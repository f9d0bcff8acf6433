"""Episodes without ROS: recorded, on any map, with left-hand traffic; the times of a program's answers.

test/nodes/test_episode.py compares the bytes of a recorded episode with those of the nodes.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_episodes import digest
from recorded_episode import quick_template
from repository import REPOSITORY

from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.errors import BagError, EpisodeError, InputError, MapError
from siren_ros.running.generation import closed_loop as loop
from siren_ros.running.generation.closed_loop import AnswerTimes, LoopStep, closed_loop, record_episode, record_of
from siren_ros.running.generation.episode_setup import plan_length, set_up_episode
from siren_ros.running.generation.replay_check import repeat_episode, request_of
from siren_ros.scoring.judging.outcome import evaluate_predicate
from siren_ros.scoring.judging.verify import check_message_counts, check_state_hashes
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.roads.maps.map_formats import mirrored_net
from siren_ros.simulation.roads.road_network import mirror_image
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeRequest
from siren_ros.simulation.world.actors import ACTOR_STATE_DTYPES, EventKind, Lights, Mode, Owner


def test_percentiles_of_answers() -> None:
    assert AnswerTimes.of([0.001 * number for number in range(101)]) == AnswerTimes(50.0, 95.0, 100.0)


@given(st.lists(st.floats(0.0, 20.0), min_size=1, max_size=30))
def test_a_summary_is_read_back(times_s: list[float]) -> None:
    told = AnswerTimes.of(times_s)
    assert AnswerTimes.in_lines(["episode complete", told.line, "bag: x"]) == told
    assert AnswerTimes.in_lines(["episode complete", "real-time factor 3.0 (1.0 s of wall time)"]) is None


REQUEST = EpisodeRequest(
    quick_template("S3"), seed=4, duration_s=1.5, sensors="none", values="demand.background_vehicles=18.0"
)


def test_the_bag_is_sound_and_repeats(tmp_path: Path) -> None:
    recorded = record_episode(set_up_episode(REQUEST), tmp_path / "bag")
    assert recorded.outcome.end is EpisodeEnd.COMPLETE
    record = read_episode(tmp_path / "bag")
    assert record.complete
    assert record.steps == 30
    assert request_of(record) == REQUEST
    for check in (check_message_counts, check_state_hashes):
        assert check(record).holds
    assert repeat_episode(record) is None


def test_a_failed_episode_leaves_a_partial_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "check_residual", _fail_at(7))
    recorded = record_episode(set_up_episode(REQUEST), tmp_path / "bag")
    assert recorded.outcome.end is EpisodeEnd.FAILED
    assert recorded.outcome.steps == 7
    assert "too far apart" in recorded.outcome.reason
    assert not (tmp_path / "bag").exists()
    partial = read_episode(tmp_path / "bag.partial")
    assert partial.steps >= 7
    assert not partial.complete


def test_an_episode_without_a_step_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loop, "check_residual", _fail_at(0))
    recorded = record_episode(set_up_episode(REQUEST), tmp_path / "bags" / "bag")
    assert recorded.bag is None
    assert list(tmp_path.iterdir()) == []


def _fail_at(step: int):  # type: ignore[no-untyped-def] # stands for check_residual
    def check(states, _limit_m):  # type: ignore[no-untyped-def]
        if states.step == step:
            raise EpisodeError("too far apart")

    return check


SHORT = EpisodeRequest(quick_template("S2"), duration_s=0.5, sensors="none")


def test_an_earlier_episode_gives_way_where_that_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = tmp_path / "bag"
    record_episode(set_up_episode(SHORT), bag)
    first = digest(bag)
    with pytest.raises(BagError, match=r"overwrite:=true.*siren replay .*bag --check"):
        record_episode(set_up_episode(SHORT), bag)
    record_episode(set_up_episode(replace(SHORT, seed=1)), bag, overwrite=True)
    assert digest(bag) != first
    record_episode(set_up_episode(SHORT), bag, overwrite=True)
    assert digest(bag) == first
    monkeypatch.setattr(loop, "check_residual", _fail_at(3))
    record_episode(set_up_episode(SHORT), bag, overwrite=True)
    assert digest(bag) == first
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["bag", "bag.partial"]


def test_nothing_but_an_episode_gives_way(tmp_path: Path) -> None:
    bag, link, setup = tmp_path / "bag", tmp_path / "link", set_up_episode(SHORT)
    record_episode(setup, bag)
    link.symlink_to(bag)
    with pytest.raises(BagError, match="exists already"):
        record_episode(setup, link, overwrite=True)
    for foreign in (bag / "folder", bag / "notes.txt"):
        foreign.write_text("mine") if foreign.suffix else foreign.mkdir()
        before = sorted(bag.iterdir())
        with pytest.raises(BagError, match="not the bag of an episode alone"):
            record_episode(setup, bag, overwrite=True)
        assert sorted(bag.iterdir()) == before
        shutil.move(foreign, tmp_path)


def test_an_interrupted_episode_leaves_nothing_and_steps_are_told(tmp_path: Path) -> None:
    told: list[int] = []

    def interrupt(step: int) -> None:
        told.append(step)
        if step == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record_episode(set_up_episode(SHORT), tmp_path / "bags" / "bag", on_step=interrupt)
    assert told == [0, 1, 2, 3]
    assert list(tmp_path.iterdir()) == []


def test_an_av_under_test_needs_its_controller(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cosim"):
        record_episode(set_up_episode(EpisodeRequest("S2", av="civilian", sensors="none")), tmp_path / "bag")


MAPS = REPOSITORY / "test" / "maps"


def drive(template: str, name: str, steps: int) -> list[LoopStep]:
    setup = set_up_episode(EpisodeRequest(template, map=str(MAPS / name), sensors="none"))
    return list(closed_loop(setup, steps))


def test_nobody_flies_out_of_a_bend() -> None:
    steps = drive("S2", "bends.xodr", 500)
    owner = np.concatenate([step.states.owner for step in steps])
    lateral = np.abs(np.concatenate([step.states.lateral_accel_mps2 for step in steps]))[owner == Owner.SUMO]
    assert len(lateral) > 5000
    assert np.percentile(lateral, 99.9) < 4.0
    residual = np.concatenate([step.states.residual_m for step in steps])
    assert residual.max() < 1.5
    assert not [event for step in steps for event in step.events if event.kind is EventKind.REALIGNED]
    in_bend = np.concatenate([np.abs(step.states.yaw_rate_radps) for step in steps])[owner == Owner.SUMO] > 0.2
    assert in_bend.sum() > 50, "somebody drives through the bend"


def test_a_template_at_stop_signs_runs_on_openstreetmap() -> None:
    steps = drive("S6", "signs.osm", 320)
    crossed = [event for step in steps for event in step.events if event.kind is EventKind.STOP_LINE_CROSSED]
    assert any(event.detail["must_stop"] for event in crossed), "somebody passes a stop sign"
    assert all(step.states.residual_m.max() < 1.5 for step in steps)


def test_a_map_without_a_site_is_named_with_what_it_lacks() -> None:
    with pytest.raises(MapError, match=r"bends\.xodr.*has to stop or to give way"):
        drive("S5", "bends.xodr", 1)


@pytest.fixture(scope="module")
def towns(tmp_path_factory):
    """The town and its mirror image as files, so that both are compiled in the same way."""
    folder = tmp_path_factory.mktemp("maps")
    net = compile_map(None).read_bytes()
    for name, content in (("right", net), ("left", mirrored_net(net))):
        (folder / f"{name}.net.xml").write_bytes(content)
    return {name: str(folder / f"{name}.net.xml") for name in ("right", "left")}


def run(towns, side, template, steps=None):
    request = EpisodeRequest(quick_template(template), map=towns[side])
    setup = set_up_episode(request)
    return setup, list(closed_loop(setup, steps or plan_length(request)))


@pytest.mark.parametrize(("template", "steps"), [("S1", 240), ("S2", 200)])
def test_states_commands_and_events_are_mirrored(towns, template, steps):
    (right_setup, right), (left_setup, left) = (run(towns, side, template, steps) for side in ("right", "left"))
    assert left_setup.site == right_setup.site
    assert left_setup.plan == right_setup.plan
    assert left_setup.network.left_hand
    for own, other in zip(right, left, strict=True):
        image = mirror_image(other.states)
        for name in ACTOR_STATE_DTYPES:
            assert np.array_equal(getattr(own.states, name), getattr(image, name)), (own.states.step, name)
        assert tuple(map(mirror_image, other.events)) == own.events
    assert any(len(step.commands[0]) for step in right)


@pytest.fixture(scope="module")
def turns(towns):
    """S7 turns right where traffic keeps right."""
    return {side: run(towns, side, "S7") for side in ("right", "left")}


def test_a_turn_on_the_shoulder_is_to_the_left(turns):
    verdicts = {}
    for side, (setup, steps) in turns.items():
        verdicts[side] = evaluate_predicate(record_of(setup, steps))
        yaw_rad = np.unwrap([step.states.yaw_rad[0] for step in steps])
        turned_rad = float(yaw_rad[-1] - yaw_rad[0])
        assert turned_rad > 1.0 if side == "left" else turned_rad < -1.0
    assert verdicts["left"].holds
    assert verdicts["left"].measures() == verdicts["right"].measures()
    assert "to the left" in verdicts["left"].text
    assert "to the right" in verdicts["right"].text


@pytest.mark.parametrize(("template", "steps", "shown"), [("S7", 460, {Lights.INDICATOR_RIGHT}), ("S3", 200, set())])
def test_the_emv_indicates_where_it_turns_and_nowhere_else(towns, turns, template, steps, shown):
    setup, made = turns["right"] if template == "S7" else run(towns, "right", template, steps)
    states = [step.states for step in made[:steps]]
    row = [int(np.flatnonzero(state.actor_id == setup.description.emv_ids[0])[0]) for state in states]
    yaw = np.unwrap([state.yaw_rad[k] for state, k in zip(states, row, strict=True)])
    lights = np.array([state.lights[k] & Lights.INDICATORS for state, k in zip(states, row, strict=True)])
    follows = np.array([state.mode[k] == Mode.ROUTE_FOLLOW for state, k in zip(states, row, strict=True)])
    assert set(lights[follows].tolist()) - {Lights.NONE} == shown
    turned = np.flatnonzero(np.abs(yaw[60:] - yaw[:-60]) > 0.8) + 60
    assert bool(len(turned)) is bool(shown)
    if shown:
        before = lights[turned[0] - 80 : turned[0]]
        assert set(before.tolist()) == shown, "from 4 s before the road has turned"
