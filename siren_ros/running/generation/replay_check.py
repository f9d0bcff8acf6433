"""Computes a recorded episode again: its states, the first difference from the record, and the drivers' decisions."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from siren_ros.base.params.parameters import FILES_ON_DISK, files_from_json
from siren_ros.data.interfaces.conversions import EpisodeClosing
from siren_ros.data.interfaces.messages import json_object, json_text
from siren_ros.data.interfaces.topics import ACTORS, EPISODE, EVENTS, OUTCOME, TRAFFIC
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import BagError, EpisodeError, SirenError
from siren_ros.running.generation.closed_loop import LoopStep, closed_loop, driven, record_of
from siren_ros.running.generation.episode_setup import (
    EpisodeSetup,
    behaviour_world,
    map_of,
    present_versions,
    set_up_episode,
)
from siren_ros.scoring.judging.outcome import outcome_of
from siren_ros.simulation.behaviour.civilians.yield_manager import SOURCE as YIELD_SOURCE
from siren_ros.simulation.behaviour.civilians.yield_manager import YieldState, step_yield
from siren_ros.simulation.behaviour.driving.driver_states import GuardState, civilian_guards, emv_guards
from siren_ros.simulation.behaviour.driving.navigator import NavigatorState, SpeedLimit
from siren_ros.simulation.behaviour.driving.speed_mechanisms import MECHANISMS
from siren_ros.simulation.behaviour.emv.controller import SOURCE as EMV_SOURCE
from siren_ros.simulation.behaviour.emv.controller import EmvState, step_emv
from siren_ros.simulation.roads.maps.map_compiler import CompiledMap, compile_map, name_of_map, source_sha256_of
from siren_ros.simulation.roads.maps.map_source import SourceKind
from siren_ros.simulation.scenario.episode import (
    DEMAND_PARAMETER,
    FILES_PARAMETER,
    MAP_SOURCE_PARAMETER,
    EpisodeDescription,
    EpisodeRequest,
)
from siren_ros.simulation.scenario.templates import load_template
from siren_ros.simulation.traffic.demand.own_demand import OwnDemand, sha256_of_demand
from siren_ros.simulation.world.actors import Event, Mode, Owner
from siren_ros.simulation.world.commands import AV_SOURCE, Controls, VehicleCommands, controls_in

MISSING: Final = "nothing"
"""Stands for a value that one of the two structures does not have."""


@dataclass(frozen=True)
class Mismatch:
    """One value that differs."""

    path: tuple[str | int, ...]
    """Path to the value: names of fields and keys, and positions, from the outermost structure."""
    recorded: object
    repeated: object

    @property
    def name(self) -> str:
        """The path as text: ``parameters.request.seed``."""
        return ".".join(str(part) for part in self.path)


def first_mismatch(recorded: Any, repeated: Any) -> Mismatch | None:
    """Find the first value that differs in any bit, in the order of fields, keys and positions."""
    return next(_mismatches(recorded, repeated, ()), None)


def _mismatches(recorded: Any, repeated: Any, path: tuple[str | int, ...]) -> Iterator[Mismatch]:
    if isinstance(recorded, np.ndarray) and isinstance(repeated, np.ndarray):
        yield from _array_mismatches(recorded, repeated, path)
    elif is_dataclass(recorded) and type(recorded) is type(repeated):
        for field in fields(recorded):
            values = (getattr(recorded, field.name), getattr(repeated, field.name))
            yield from _mismatches(*values, (*path, field.name))
    elif isinstance(recorded, Mapping) and isinstance(repeated, Mapping):
        for key in sorted({*recorded, *repeated}, key=str):
            values = (recorded.get(key, MISSING), repeated.get(key, MISSING))
            yield from _mismatches(*values, (*path, key))
    elif all(isinstance(side, Sequence) and not isinstance(side, str | bytes) for side in (recorded, repeated)):
        for position in range(max(len(recorded), len(repeated))):
            before, after = (side[position] if position < len(side) else MISSING for side in (recorded, repeated))
            yield from _mismatches(before, after, (*path, position))
    elif not _same(recorded, repeated):
        yield Mismatch(path, recorded, repeated)


def _array_mismatches(recorded: Any, repeated: Any, path: tuple[str | int, ...]) -> Iterator[Mismatch]:
    if recorded.tobytes() == repeated.tobytes() and recorded.shape == repeated.shape:
        return
    if recorded.shape != repeated.shape or recorded.dtype != repeated.dtype:
        yield Mismatch((*path, "length"), len(recorded), len(repeated))
        return
    for position, (before, after) in enumerate(zip(recorded.ravel(), repeated.ravel(), strict=True)):
        if before.tobytes() != after.tobytes():
            yield Mismatch((*path, position), before.item(), after.item())


def _same(recorded: Any, repeated: Any) -> bool:
    """Compare plain values by their JSON text, so that 1 and 1.0, or 0.0 and −0.0, differ."""
    for kind in (str, bytes, np.ndarray):
        if isinstance(recorded, kind) or isinstance(repeated, kind):
            return isinstance(recorded, kind) and isinstance(repeated, kind) and bool(recorded == repeated)
    return json_text(recorded) == json_text(repeated)


@dataclass(frozen=True)
class Difference:
    """The first difference between repetition and record."""

    topic: str
    """Topic whose messages differ, or ``commands``."""
    field: str
    recorded: object
    repeated: object
    step: int | None = None
    """Step of the difference; None if it belongs to no step."""
    actor_id: int = 0
    """Actor of the difference; 0 if it belongs to no actor."""

    def __str__(self) -> str:
        step = "" if self.step is None else f"step {self.step}, "
        actor = f"actor {self.actor_id}, " if self.actor_id else ""
        recorded, repeated = self.recorded, self.repeated
        if self.field == "state_hash" and isinstance(recorded, int) and isinstance(repeated, int):
            recorded, repeated = f"{recorded:016x}", f"{repeated:016x}"
        else:
            recorded, repeated = _shortened(recorded), _shortened(repeated)
        return f"{step}{actor}{self.field} of {self.topic}: recorded {recorded}, repeated {repeated}"


def _shortened(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 100 else f"{text[:97]}…"


def request_of(record: EpisodeRecord) -> EpisodeRequest:
    """Request from which the episode was made.

    Raises:
        BagError: The description does not hold it.
    """
    stored = record.description.parameters.get("request")
    names = {field.name for field in fields(EpisodeRequest)}
    if not isinstance(stored, dict) or not set(stored) <= names or "template" not in stored:
        raise BagError(record.description.template, "a bag whose description holds the request of the episode")
    defaults = EpisodeRequest("")
    for name, value in stored.items():
        if type(value) is not type(getattr(defaults, name)):
            raise BagError(record.description.template, f"a request whose {name} is not {value!r}")
    return EpisodeRequest(**stored)


def repeat_episode(record: EpisodeRecord) -> Difference | None:
    """Simulate the episode again without sensors, and compare all simulated data with the record.

    Map and parameter files come from the record, wherever it holds them. An AV under test drives by its controller's
    recorded answers; so does whoever else sits in a seat. Compared are the description without its versions, the map's
    hash, and at every step SUMO's state, the controllers' commands, the actor states, the state hash and the events;
    for a complete episode the outcome too.

    Raises:
        BagError: The record does not hold what is needed, or its map or its files do not have their hashes.
        InputError: A record without files names one that does not exist here.
    """
    request = request_of(record)
    with TemporaryDirectory(prefix="siren-replay-") as scratch:
        compiled = _recorded_map(record, request, Path(scratch))
        own = OwnDemand.of_json(record.description.parameters.get(DEMAND_PARAMETER))
        setup = set_up_episode(request, record.description.files, compiled, own)
        difference = _description_difference(record.description, setup.description)
        if difference is not None:
            return difference
        answers = answers_in(record)
        # The limit on the residual can only end an episode; it changes no earlier step.
        last = max((state.step for state in record.states), default=-1)
        loop = closed_loop(setup, last + 1, residual_limit_m=math.inf)
        steps = [step for step, _ in driven(loop, lambda step: answers.get(step.states.step, {}))]
        return first_difference(record, steps) or _outcome_difference(record, setup, steps)


def answers_in(record: EpisodeRecord) -> dict[int, Controls]:
    """Recorded answers of external drivers, by the step that they answered; the AV's and others'."""
    answers: dict[int, Controls] = {}
    for source, commands in record.commands.items():
        for command in commands:
            if controls := controls_in(command):
                # The AV's answers are recorded at the step that they answer, others at the step to which they drive.
                step = command.step if source == AV_SOURCE else command.step - 1
                answers[step] = {**answers.get(step, {}), **controls}
    return answers


def _recorded_map(record: EpisodeRecord, request: EpisodeRequest, scratch: Path) -> CompiledMap:
    """The record's own map as a file; the request's map if the record has none."""
    described = record.description
    source = map_of(request, load_template(request.template, described.files))
    if record.map_xml:
        net_path = scratch / "recorded.net.xml"
        net_path.write_bytes(record.map_xml)
        source_sha256 = described.parameters.get(MAP_SOURCE_PARAMETER, "")
        net_sha256 = sha256(record.map_xml).hexdigest()
        of_source = SourceKind.SUMO, str(source_sha256), str(described.site.get("map_variant", ""))
        compiled = CompiledMap(name_of_map(source), net_path, net_sha256, *of_source)
    else:
        compiled = compile_map(source)
    if compiled.sha256 != described.map_sha256:
        raise BagError(described.map_name, f"the map that the episode was made on (SHA-256 {described.map_sha256})")
    return compiled


def _description_difference(recorded: EpisodeDescription, repeated: EpisodeDescription) -> Difference | None:
    """The first field that differs; versions are ignored, because they describe the program, not the episode."""
    sides = [_plain(replace(side, versions={})) for side in (recorded, repeated)]
    for added in (FILES_PARAMETER, MAP_SOURCE_PARAMETER):
        if added not in recorded.parameters:
            sides[1].parameters.pop(added, None)  # type: ignore[attr-defined] # a dict, made by _plain
    return _difference(EPISODE.name, first_mismatch(*sides))


def _plain(description: EpisodeDescription) -> EpisodeDescription:
    """The description with the JSON types of a record."""
    return replace(
        description,
        parameters=json_object(json_text(dict(description.parameters))),
        site=json_object(json_text(dict(description.site))),
    )


def first_difference(record: EpisodeRecord, repeated: Sequence[LoopStep]) -> Difference | None:
    """Find the first step, actor and field of the simulation that differ in any bit.

    In a record that has lost steps, messages that are missing are not compared; ``record.lost_steps`` tells.

    Args:
        record: The record.
        repeated: The steps of the repetition.
    """
    traffic = {state.step: state for state in record.traffic}
    states = {state.step: state for state in record.states}
    commands = {(source, item.step): item for source, items in record.commands.items() for item in items}
    events: dict[int, list[Event]] = {}
    for event in record.events:
        events.setdefault(event.step, []).append(event)
    for again in repeated:
        step = again.states.step
        pairs: list[tuple[str, Any, Any]] = [(TRAFFIC.name, traffic.get(step, MISSING), again.traffic)]
        pairs += [
            (f"commands of {command.source}", commands.get((command.source, step), MISSING), command)
            for command in again.commands
            if command.source != AV_SOURCE
        ]
        pairs.append((ACTORS.name, states.get(step, MISSING), again.states))
        here = again.state_hash
        pairs.append((EVENTS.name, {"state_hash": record.state_hashes.get(step, MISSING)}, {"state_hash": here}))
        pairs.append((EVENTS.name, _events_json(events.get(step, ())), _events_json(again.events)))
        if record.lost_steps:
            absent = EVENTS.name if step not in record.state_hashes else ""
            pairs = [pair for pair in pairs if pair[1] is not MISSING and pair[0] != absent]
        for topic, before, after in pairs:
            difference = _difference(topic, first_mismatch(before, after), step, before)
            if difference is not None:
                return difference
    return None


def _events_json(events: Sequence[Event]) -> dict[str, Any]:
    entries = [{**vars(event), "kind": event.kind.value, "detail": dict(event.detail)} for event in events]
    return json_object(json_text({"events": entries}))


def _outcome_difference(record: EpisodeRecord, setup: EpisodeSetup, steps: list[LoopStep]) -> Difference | None:
    if not record.complete or record.outcome is None:
        return None
    recorded = record.outcome
    closing = EpisodeClosing(record.steps, recorded.end, recorded.reason)
    repeated = outcome_of(record_of(setup, steps), closing)
    sides = [replace(side, measures=json_object(json_text(dict(side.measures)))) for side in (recorded, repeated)]
    return _difference(OUTCOME.name, first_mismatch(*sides))


def _difference(
    topic: str, mismatch: Mismatch | None, step: int | None = None, rows: object = None
) -> Difference | None:
    """Convert a mismatch; if the last part of its path is a row of a structure of arrays, it gives the actor."""
    if mismatch is None:
        return None
    ids = getattr(rows, "actor_id", None)
    name, actor_id = mismatch.name, 0
    if ids is not None and len(mismatch.path) == 2:
        column, row = mismatch.path
        if isinstance(row, int) and row < len(ids) == len(getattr(rows, str(column))) and column != "actor_id":
            name, actor_id = str(column), int(ids[row])
    return Difference(topic, name or "message", mismatch.recorded, mismatch.repeated, step, actor_id)


def notes_on(record: EpisodeRecord) -> Iterator[str]:
    """Changes outside the record: versions of packages, and files that were replaced by recorded ones."""
    described = record.description
    for package, version in sorted(described.versions.items()):
        here = present_versions().get(package, MISSING)
        if here != version:
            yield f"{package} was {version} and is {here} here"
    for file in files_from_json(described.parameters.get(FILES_PARAMETER, [])):
        try:
            same = FILES_ON_DISK.read(file.folder, file.folder, file.name) == file
        except SirenError:
            yield f"{file.name} ({file.folder}) cannot be read here; its recorded text was used"
            continue
        if not same:
            yield f"{file.name} ({file.folder}) has changed; its recorded text was used"
    stored, request = described.parameters.get(MAP_SOURCE_PARAMETER), request_of(record)
    if own := OwnDemand.of_json(described.parameters.get(DEMAND_PARAMETER)):
        found = ""
        with suppress(SirenError):
            found = sha256_of_demand(Path(request.demand))
        yield from () if found == own.sha256 else (f"{request.demand} is not as it was; the recorded traffic was used",)
    if not record.map_xml or stored is None:
        return
    try:
        same = source_sha256_of(map_of(request, load_template(request.template, described.files))) == stored
    except SirenError:
        yield f"the map {request.map} cannot be read here; the recorded net was used"
        return
    if not same:
        yield f"the map {request.map or described.map_name} has changed; the recorded net was used"


_SOURCES: Final = (EMV_SOURCE, YIELD_SOURCE)


@dataclass(frozen=True)
class Decision:
    """Why an EMV or a yielding civilian acted as it did at a step."""

    mode: Mode
    target_mps: float
    """Target speed of its mode; NaN if SUMO drives."""
    limits: Mapping[str, SpeedLimit]
    """Speed limits by mechanism (``MECHANISMS``), without those that limit nothing; empty if SUMO drives."""
    guards: tuple[GuardState, ...]


def decisions_of(record: EpisodeRecord) -> Iterator[tuple[int, Mapping[int, Decision]]]:
    """Each step with its decisions by actor.

    Raises:
        EpisodeError: The record does not hold its template's values, or the present code decides otherwise than the
            record says: another version made the episode.
    """
    if not record.description.template_values:
        raise EpisodeError("the record does not hold the values of its template")
    world = behaviour_world(record.description, record.map_xml)
    recorded = {
        source: {commands.step: commands for commands in record.commands.get(source, ())} for source in _SOURCES
    }
    emvs, civilians = EmvState(), YieldState()
    for traffic in record.traffic:
        emvs, emv_commands = step_emv(emvs, traffic, world)
        civilians, yield_commands = step_yield(civilians, traffic, world)
        modes: dict[int, tuple[Mode, Owner]] = {}
        for commands in (emv_commands, yield_commands):
            _check(commands, recorded[commands.source])
            rows = zip(commands.actor_id.tolist(), commands.mode.tolist(), commands.owner.tolist(), strict=True)
            modes |= {actor_id: (Mode(mode), Owner(owner)) for actor_id, mode, owner in rows}
        decided = {}
        for actor_id, (mode, owner) in modes.items():
            unit = emvs.units.get(actor_id)
            if unit is not None:
                navigator, guards = unit.navigator, emv_guards(unit, traffic.step, world)
            elif actor_id in civilians.units:
                civilian = civilians.units[actor_id]
                navigator, guards = civilian.navigator, civilian_guards(civilian, traffic.step, world)
            else:
                continue
            decided[actor_id] = _decision(mode, navigator if owner is Owner.ROS else NavigatorState(), guards)
        yield traffic.step, decided


def _decision(mode: Mode, navigator: NavigatorState, guards: tuple[GuardState, ...]) -> Decision:
    allowed = zip(MECHANISMS, navigator.limits, strict=False)
    limits = {mechanism.name: limit for mechanism, limit in allowed if limit.speed_mps < math.inf}
    return Decision(mode, navigator.target_mps if navigator.limits else math.nan, limits, guards)


def _check(decided: VehicleCommands, recorded: Mapping[int, VehicleCommands]) -> None:
    """Compare with the recorded commands of the step, if the bag has them."""
    before = recorded.get(decided.step)
    if before is None:
        return
    difference = first_mismatch(before, replace(decided, events=before.events))  # events have a topic of their own
    if difference is not None:
        raise EpisodeError(
            f"the present version decides otherwise at step {decided.step}: {difference.name} of {decided.source} "
            f"was {difference.recorded}, is {difference.repeated}"
        )
