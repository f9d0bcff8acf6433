"""Episodes computed again: the first difference from the record, and the drivers' decisions to the last bit."""

import hashlib
import math
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_episode import quick_template

from siren_ros.base.params.folders import params_dir
from siren_ros.data.interfaces.conversions import (
    EpisodeClosing,
    from_episode_description,
    to_episode_description,
)
from siren_ros.data.recording.bag_folder import default_bag_path_of, default_kitti_path
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError, EpisodeError, InputError, MapError
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop, driven, record_of
from siren_ros.running.generation.episode_setup import (
    default_bag_path,
    plan_length,
    set_up_episode,
)
from siren_ros.running.generation.replay_check import (
    MISSING,
    Decision,
    Difference,
    Mismatch,
    answers_in,
    decisions_of,
    first_difference,
    first_mismatch,
    notes_on,
    repeat_episode,
    request_of,
)
from siren_ros.scoring.judging.outcome import outcome_of
from siren_ros.simulation.roads.maps.map_compiler import compile_map
from siren_ros.simulation.scenario.episode import EpisodeEnd, EpisodeRequest
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import Mode
from siren_ros.simulation.world.commands import AvControl, Controls

json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=12,
)


@dataclass(frozen=True)
class Table:
    """A structure of arrays with a nested one."""

    name: str
    rows: Any
    inner: Any = ()


TABLE = Table("a", np.array([1.0, 2.0, 3.0]), ({"x": 1}, (2, 3)))


@given(value=json_values)
def test_nothing_differs_from_itself(value: Any) -> None:
    assert first_mismatch(value, value) is None
    assert first_mismatch(Table("a", np.zeros(2), value), Table("a", np.zeros(2), value)) is None


@pytest.mark.parametrize(
    ("other", "mismatch"),
    [
        (replace(TABLE, name="b"), Mismatch(("name",), "a", "b")),
        (replace(TABLE, rows=np.array([1.0, 2.5, 3.5])), Mismatch(("rows", 1), 2.0, 2.5)),
        (replace(TABLE, rows=np.array([1.0, 2.0])), Mismatch(("rows", "length"), 3, 2)),
        (replace(TABLE, inner=({"x": 1}, (2, 4))), Mismatch(("inner", 1, 1), 3, 4)),
        (replace(TABLE, inner=({"x": 1}, (2,))), Mismatch(("inner", 1, 1), 3, MISSING)),
        (replace(TABLE, inner=({"x": 1, "y": None}, (2, 3))), Mismatch(("inner", 0, "y"), MISSING, None)),
        (replace(TABLE, inner=({}, (2, 3))), Mismatch(("inner", 0, "x"), 1, MISSING)),
    ],
)
def test_the_first_difference_has_its_path_and_both_values(other: Table, mismatch: Mismatch) -> None:
    assert first_mismatch(TABLE, other) == mismatch


def test_arrays_of_other_types_differ() -> None:
    assert first_mismatch(np.zeros(3, np.float32), np.zeros(3, np.float64)) is not None
    assert first_mismatch(np.zeros((2, 3)), np.zeros((3, 2))) is not None


@pytest.mark.parametrize("other", [MISSING, 0.0, [0.0, 0.0], None])
def test_an_array_differs_from_what_is_none(other: Any) -> None:
    array = np.zeros(2)
    for recorded, repeated in ((array, other), (other, array)):
        mismatch = first_mismatch({"a": recorded}, {"a": repeated})
        assert mismatch is not None
        assert mismatch.path == ("a",)
        assert mismatch.recorded is recorded


@pytest.mark.parametrize(
    ("recorded", "repeated"),
    [(1, 1.0), (0.0, -0.0), (True, 1), ("1", 1), (b"a", "a"), (None, "None"), ({}, []), ("ab", ["a", "b"]), (1, 2)],
)
def test_values_of_another_kind_differ(recorded: Any, repeated: Any) -> None:
    assert first_mismatch(recorded, repeated) == Mismatch((), recorded, repeated)


def test_minus_zero_is_not_zero_and_nan_is_itself() -> None:
    assert first_mismatch(np.array([0.0]), np.array([-0.0])) is not None
    assert first_mismatch(np.array([np.nan]), np.array([np.nan])) is None
    assert first_mismatch({"a": [float("nan")]}, {"a": [float("nan")]}) is None
    assert first_mismatch(Mode.REJOIN, int(Mode.REJOIN)) is None


STEPS = 40
REQUEST = EpisodeRequest(quick_template("S2"), seed=3, sensors="none")


@pytest.fixture(scope="module")
def episode() -> tuple[EpisodeRecord, list[LoopStep]]:
    setup = set_up_episode(REQUEST)
    steps = list(closed_loop(setup, STEPS))
    return record_of(setup, steps), steps


def found(difference: Difference | None) -> Difference:
    assert difference is not None
    return difference


def test_a_record_is_repeated_to_the_last_bit(episode: tuple[EpisodeRecord, list[LoopStep]]) -> None:
    record, _ = episode
    assert request_of(record) == REQUEST
    assert repeat_episode(record) is None


def test_whoever_sits_in_a_seat_drives_again_by_the_answers_of_each_step(
    episode: tuple[EpisodeRecord, list[LoopStep]],
) -> None:
    """The answers differ from step to step; those for a vehicle that is not there are nobody's."""
    (emv_id, *_), request = episode[0].description.emv_ids, request_of(episode[0])
    setup, given = set_up_episode(request), {}

    def answer(step: LoopStep) -> Controls:
        controls = {one: AvControl(step.states.step, 0.01 * step.states.step) for one in (emv_id, 999)}
        given[step.states.step] = {emv_id: controls[emv_id]}
        return controls

    steps = [step for step, _ in driven(closed_loop(setup, 8), answer)]
    record = record_of(setup, steps)
    assert answers_in(record) == {step: controls for step, controls in given.items() if step < 7}
    assert repeat_episode(record) is None


def test_the_first_difference_is_named(episode: tuple[EpisodeRecord, list[LoopStep]]) -> None:
    record, steps = episode
    state = record.states[17]
    x_m = state.x_m.copy()
    x_m[4] += 1e-12
    changed = (*record.states[:17], replace(state, x_m=x_m), *record.states[18:])
    difference = found(first_difference(replace(record, states=changed), steps))
    assert (difference.step, difference.actor_id, difference.field) == (17, int(state.actor_id[4]), "x_m")
    assert str(difference).startswith(f"step 17, actor {state.actor_id[4]}, x_m of /siren/actor_states: recorded ")


def test_another_signal_alone_is_found_by_the_hash(episode: tuple[EpisodeRecord, list[LoopStep]]) -> None:
    record, steps = episode
    hashes = {**record.state_hashes, 11: 1}
    difference = first_difference(replace(record, state_hashes=hashes), steps)
    assert str(difference).startswith("step 11, state_hash of /siren/events: recorded 0000000000000001, repeated ")


@pytest.mark.parametrize("stored", [None, {}, {"template": "S2", "shoe_size": 44}, {"template": 7}])
def test_a_description_without_its_request_is_refused(
    episode: tuple[EpisodeRecord, list[LoopStep]], stored: object
) -> None:
    record, _ = episode
    description = replace(record.description, parameters={"request": stored})
    with pytest.raises(BagError, match="request"):
        repeat_episode(replace(record, description=description))


def test_names_and_lengths_come_from_the_request_and_names_from_the_description_alone() -> None:
    assert default_bag_path(REQUEST).as_posix() == "bags/S2_L2_seed3"
    there = replace(REQUEST, map="maps/Some Town.net.xml", level="L1")
    assert default_bag_path(there).as_posix() == "bags/S2_L1_seed3_Some Town"
    assert plan_length(replace(REQUEST, duration_s=2.5)) == 50
    for change in ({}, {"level": "L1", "seed": 7}, {"av": "civilian"}):
        request = replace(REQUEST, **change)
        assert default_bag_path_of(set_up_episode(request).description) == default_bag_path(request)
    assert default_kitti_path(default_bag_path(REQUEST)).as_posix() == "bags/S2_L2_seed3_kitti"


@pytest.mark.parametrize(
    ("change", "error"),
    [
        *[({"template": "S77"}, InputError), ({"preset": "wild"}, InputError), ({"sensors": "sonar"}, InputError)],
        ({"map": "nowhere.xodr"}, MapError),
    ],
)
def test_a_request_that_cannot_be_met_is_refused_by_name(change: dict[str, str], error: type[InputError]) -> None:
    with pytest.raises(error) as caught:
        set_up_episode(replace(REQUEST, **change))
    assert caught.value.parameter == next(iter(change))


@pytest.fixture(scope="module")
def complete(episode: tuple[EpisodeRecord, list[LoopStep]]) -> EpisodeRecord:
    """The record with its outcome, as the bag of an episode that ended as planned."""
    record, _ = episode
    closing = EpisodeClosing(STEPS, EpisodeEnd.COMPLETE, "")
    whole = replace(record, complete=True, outcome=outcome_of(record, closing))
    assert repeat_episode(whole) is None
    return whole


def with_description(record: EpisodeRecord, **changes: Any) -> EpisodeRecord:
    return replace(record, description=replace(record.description, **changes))


def with_parameters(record: EpisodeRecord, **changes: Any) -> EpisodeRecord:
    return with_description(record, parameters={**record.description.parameters, **changes})


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        *[({"template": "S3"}, "template"), ({"level": EmergencyLevel.L3}, "level"), ({"seed": 1}, "seed")],
        *[({"map_name": "elsewhere"}, "map_name"), ({"duration_s": 7.5}, "duration_s")],
        *[({"sensor_suite": "full"}, "sensor_suite"), ({"preset": "realistic"}, "preset")],
        *[({"emv_ids": (1, 2)}, "emv_ids.1"), ({"site": {"kind": "other"}}, "site.junction")],
    ],
)
def test_a_changed_field_of_the_description_is_named(complete: EpisodeRecord, changes: Any, field: str) -> None:
    difference = found(repeat_episode(with_description(complete, **changes)))
    assert (difference.topic, difference.field, difference.step) == ("/siren/episode", field, None)


def test_a_changed_value_of_the_template_or_the_predicate_is_named(complete: EpisodeRecord) -> None:
    parameters = complete.description.parameters
    template: Any = {**parameters["template"], "emv.speed_mps": 1.5}  # type: ignore[dict-item] # a dict
    predicate: Any = {**parameters["predicate"], "name": "red_crossing"}  # type: ignore[dict-item] # a dict
    for changes, field in (
        ({"template": template}, "parameters.template.emv.speed_mps"),
        ({"predicate": predicate}, "parameters.predicate.name"),
        ({"shoe_size": 44}, "parameters.shoe_size"),
    ):
        assert found(repeat_episode(with_parameters(complete, **changes))).field == field


def test_another_map_than_the_described_one_is_refused(complete: EpisodeRecord) -> None:
    with pytest.raises(BagError, match="SHA-256"):
        repeat_episode(with_description(complete, map_sha256="0" * 64))
    with pytest.raises(BagError, match="SHA-256"):
        repeat_episode(replace(complete, map_xml=complete.map_xml + b"\n"))


def changed_row(items: Any, step: int, column: str) -> Any:
    """The structures of arrays with one value of the last row changed at a step."""
    values = getattr(items[step], column).copy()
    values[-1] += 1
    return (*items[:step], replace(items[step], **{column: values}), *items[step + 1 :])


def test_a_change_of_traffic_or_commands_is_named_with_its_step_and_actor(complete: EpisodeRecord) -> None:
    traffic = changed_row(complete.traffic, 9, "lane_position_m")
    difference = repeat_episode(replace(complete, traffic=traffic))
    assert str(difference).startswith(
        f"step 9, actor {traffic[9].actor_id[-1]}, lane_position_m of /siren/traffic_state: recorded "
    )
    commands = changed_row(complete.commands["emv_controller"], 12, "throttle")
    changed = replace(complete, commands={**complete.commands, "emv_controller": commands})
    assert str(repeat_episode(changed)).startswith(
        "step 12, actor 1, throttle of commands of emv_controller: recorded "
    )
    without = replace(complete, commands={"emv_controller": complete.commands["emv_controller"]})
    assert "yield_manager: recorded 'nothing'" in str(repeat_episode(without))


def test_a_change_of_an_event_or_of_the_outcome_is_named(complete: EpisodeRecord) -> None:
    event = complete.events[-1]
    changed = replace(event, x_m=event.x_m + 1.0)
    difference = found(repeat_episode(replace(complete, events=(*complete.events[:-1], changed))))
    assert (difference.topic, difference.step) == ("/siren/events", event.step)
    assert difference.field.endswith(".x_m")
    assert complete.outcome is not None
    outcome = replace(complete.outcome, measures={**complete.outcome.measures, "collisions": 3})
    difference = repeat_episode(replace(complete, outcome=outcome))
    assert str(difference) == "measures.collisions of /siren/outcome: recorded 3, repeated 0"


@pytest.fixture
def own_files(tmp_path: Path) -> EpisodeRequest:
    """A request whose files are all the user's own."""
    kinds = {"template": "templates/S2", "preset": "presets/paper", "sensors": "suites/none", "look": "looks/fog"}
    for kind, name in kinds.items():
        shutil.copy(params_dir() / f"{name}.yaml", tmp_path / f"{kind}.yaml")
    (tmp_path / "own.net.xml").write_bytes(compile_map(None).read_bytes())
    names = {kind: str(tmp_path / f"{kind}.yaml") for kind in kinds}
    return EpisodeRequest(**names, seed=3, map=str(tmp_path / "own.net.xml"))  # type: ignore[arg-type] # all are texts


def test_a_record_needs_none_of_the_users_files(own_files: EpisodeRequest, tmp_path: Path) -> None:
    setup = set_up_episode(own_files)
    record = record_of(setup, list(closed_loop(setup, 20)))
    message = to_episode_description(record.description)
    record = replace(record, description=from_episode_description(message))
    assert [*notes_on(record)] == []
    files: Any = record.description.parameters["files"]
    assert {entry["folder"] for entry in files} == {"templates", "presets", "suites", "looks", "drivers", "vehicles"}
    for entry in files:
        path = Path(entry["name"])
        on_disk = path if path.is_absolute() else params_dir() / entry["folder"] / f"{path}.yaml"
        assert entry["text"] == on_disk.read_text(encoding="utf-8")
        assert entry["sha256"] == hashlib.sha256(on_disk.read_bytes()).hexdigest()
    shutil.copy(params_dir() / "presets" / "realistic.yaml", own_files.preset)
    assert [*notes_on(record)] == [f"{own_files.preset} (presets) has changed; its recorded text was used"]
    assert repeat_episode(record) is None
    for file in tmp_path.iterdir():
        file.unlink()
    assert repeat_episode(record) is None
    notes = [*notes_on(record)]
    assert len(notes) == 5
    assert all("cannot be read here" in note and str(tmp_path) in note for note in notes)


def test_a_recorded_file_without_its_hash_is_refused_and_one_with_another_text_is_noticed(
    complete: EpisodeRecord,
) -> None:
    files: Any = [dict(entry) for entry in complete.description.parameters["files"]]  # type: ignore[attr-defined] # dicts
    template = next(entry for entry in files if entry["folder"] == "templates")
    template["text"] = template["text"].replace("warm_up_s:", "warm_up_s: 0.0 #")
    with pytest.raises(BagError, match=r"templates.*/S2"):
        repeat_episode(with_parameters(complete, files=files))
    template["sha256"] = hashlib.sha256(template["text"].encode()).hexdigest()
    assert repeat_episode(with_parameters(complete, files=files)) is not None
    with pytest.raises(InputError, match=r"templates.*/S2"):
        repeat_episode(with_parameters(complete, files=[entry for entry in files if entry["folder"] == "templates"]))


def test_other_versions_are_noted_and_no_difference(complete: EpisodeRecord) -> None:
    older = with_description(complete, versions={**complete.description.versions, "numpy": "1.0"})
    assert repeat_episode(older) is None
    (note,) = notes_on(older)
    assert note.startswith("numpy was 1.0 and is ")


DECIDED_STEPS = 500


@pytest.fixture(scope="module", params=[("S2", "L2"), ("S1", "L3")], ids=["L2", "L3"])
def record(request: Any) -> EpisodeRecord:
    template, level = request.param
    setup = set_up_episode(EpisodeRequest(template, level=level, sensors="none"))
    return record_of(setup, list(closed_loop(setup, DECIDED_STEPS)))


@pytest.fixture(scope="module")
def decided(record: EpisodeRecord) -> dict[int, dict[int, Decision]]:
    """By step and actor."""
    return dict(decisions_of(record))


def test_each_driven_actor_has_a_decision_at_each_step(record: EpisodeRecord, decided: Any) -> None:
    assert list(decided) == [traffic.step for traffic in record.traffic]
    for commands in (commands for rows in record.commands.values() for commands in rows):
        for actor_id, mode, owner in zip(commands.actor_id.tolist(), commands.mode, commands.owner, strict=True):
            decision = decided[commands.step][actor_id]
            assert decision.mode == mode
            assert math.isnan(decision.target_mps) == (owner == 0 or not decision.limits)
            assert all(guard.why for guard in decision.guards)


def test_another_decision_than_the_recorded_one_is_told(record: EpisodeRecord) -> None:
    source = "emv_controller"
    rows = list(record.commands[source])
    rows[50] = replace(rows[50], throttle=rows[50].throttle + 1e-12)
    other = replace(record, commands={**record.commands, source: tuple(rows)})
    with pytest.raises(EpisodeError, match="at step 50: throttle"):
        list(decisions_of(other))
