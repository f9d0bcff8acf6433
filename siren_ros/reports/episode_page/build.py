"""Builds the page of an episode from its record or bag, with the reasons of drivers' decisions if they are known."""

import base64
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from siren_ros.base.numerics.units import STEP_S
from siren_ros.base.tables import render_page
from siren_ros.data.episode_source import recording_command
from siren_ros.data.interfaces.boxes import MODE_COLOURS
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import SirenError, shown_text
from siren_ros.reports.episode_page.columns import (
    MEDIUM,
    QUICK,
    SMALL,
    ColumnFile,
    Decisions,
    add_parts,
    add_reasons,
    add_shapes,
    title_of,
)
from siren_ros.reports.episode_page.sensed import NOTHING, Sensed, add_sensed
from siren_ros.running.generation.replay_check import Decision, decisions_of
from siren_ros.scoring.judging.outcome import PARAMETER, evaluate_predicate
from siren_ros.scoring.judging.verdict import Part, Verdict
from siren_ros.scoring.pictures.birdseye import interaction_steps
from siren_ros.scoring.pictures.plot_parts import EMV_EVENTS, EMV_MODE_COLOURS, EVENT_STYLES, MODE_NAMES
from siren_ros.sensing.meshes.mesh import StaticScene
from siren_ros.simulation.world.actors import NO_ACTOR, ActorClass, Event, EventKind, Mode, Owner

_UNITS: Final = {"m": "m", "s": "s", "mps": "m/s"}
FORMAT: Final = 3
"""Version of the embedded data; the script refuses other versions."""
NO_DECISIONS: Final = "SIREN decided for no vehicle in this episode."
NOT_YET: Final = "not yet"
"""End of an episode that is still running."""
_MARKS: Final = {kind: colour for kind, (_, colour, _) in EVENT_STYLES.items()} | {EventKind.YIELD_RELEASED: "#7d8894"}
_JUDGED: Final = {True: "#b7791f", False: "#d40000"}
"""Colours of the predicate's moments, by whether the condition holds."""


def episode_data(
    record: EpisodeRecord,
    decisions: Decisions | str = (),
    against: Sequence[EpisodeRecord] = (),
    sensed: Sensed = NOTHING,
    *,
    live: StaticScene | None = None,
) -> bytes:
    """Compressed data of an episode's page.

    Args:
        record: The episode.
        decisions: Why its actors drive as they do (``decisions_of``), or a text: why that is not known.
        against: Other episodes that it is compared with.
        sensed: What its sensors measured.
        live: The scene of an episode under way, which has no verdict yet and where actors of any class may come.

    Raises:
        InputError: Too many others, or a record without states or with states that are no numbers or of unknown actors.
    """
    file = ColumnFile()
    verdict = None if live else _verdict_of(record)
    parts = add_parts(file, record, against, live)
    classes = {actor.actor_class for each in (record, *against) for actor in each.actors.values()}
    add_shapes(file, ActorClass if live else sorted(classes))
    head: dict[str, Any] = {
        "format": FORMAT,
        **_description(record, sensed),
        "verdict": _told(verdict) if verdict else None,
        **parts,
        "modes": _modes(),
        "events": events_of(record, verdict),
        **add_reasons(file, () if isinstance(decisions, str) else decisions),
        "no_why": shown_text(decisions) if isinstance(decisions, str) and decisions else NO_DECISIONS,
        **add_sensed(file, sensed),
    }
    if live:
        first_s = record.states[0].step * STEP_S
        seen = [["seen", f"from {first_s:.2f} s on; events before are not known"]] if first_s else []
        facts = [fact for fact in head["facts"] if fact[0] != "duration"] + seen
        head |= {"ended": NOT_YET, "facts": facts}
    return file.packed(head, QUICK if live else MEDIUM if sensed.sweeps else SMALL)


def episode_page(
    record: EpisodeRecord,
    decisions: Decisions | str = (),
    against: Sequence[EpisodeRecord] = (),
    sensed: Sensed = NOTHING,
) -> str:
    """The complete page as one file; arguments and errors as of ``episode_data``.

    Its security policy allows this script and these styles alone, by their hashes. The data is base64, so nothing in it
    can end its element.
    """
    data = base64.b64encode(episode_data(record, decisions, against, sensed)).decode()
    return _page(title_of(record), data, live=False)


def live_page() -> str:
    """The page for running episodes, without data: its script requests the stream from its server."""
    return _page("SIREN live", "", live=True)


def _page(title: str, data: str, *, live: bool) -> str:
    return render_page("episode", title=title, data=data, live=live)


def _description(record: EpisodeRecord, sensed: Sensed) -> dict[str, Any]:
    episode, outcome = record.description, record.outcome
    return {
        "step_s": STEP_S,
        "begin_s": interaction_steps(record)[0] * STEP_S,
        "ended": "cut off" if outcome is None else outcome.end.value,
        "command": recording_command(episode, episode.sensor_suite),
        "facts": [
            [name, shown_text(text)]
            for name, text in (
                ("template", episode.template),
                ("level", episode.level.name),
                ("seed", str(episode.seed)),
                ("map", f"{episode.map_name} ({episode.map_sha256[:12]}…)"),
                ("preset", episode.preset),
                ("sensors", episode.sensor_suite),
                ("duration", f"{record.duration_s:.2f} s"),
                *([("pinned", episode.pinned)] if episode.pinned else []),
                *sensed.notes,
            )
        ],
    }


def _verdict_of(record: EpisodeRecord) -> Verdict | None:
    """Verdict of the episode's predicate; None if it cannot be judged."""
    try:
        return evaluate_predicate(record)
    except SirenError:
        return None


def _told(verdict: Verdict) -> dict[str, Any]:
    """A verdict as JSON types; each condition has step and actor of its decisive moment, if there is one."""
    moments = [part.decisive for part in verdict.parts]
    parts = [
        {"holds": part.holds, "text": str(part), "at": [moment.step, moment.actor_id] if moment else None}
        for part, moment in zip(verdict.parts, moments, strict=True)
    ]
    return {"holds": verdict.holds, "text": verdict.text, "parts": parts}


def _modes() -> list[dict[str, Any]]:
    """Name and colour of each mode, by its number; the colour is empty if a civilian has no special colour in it."""
    return [
        {
            "name": MODE_NAMES[mode],
            "code": mode.name.lower(),
            "colour": _hex(MODE_COLOURS[mode]) if mode in MODE_COLOURS else "",
            "emv_colour": EMV_MODE_COLOURS.get(mode, ""),
        }
        for mode in Mode
    ]


def _hex(colour: tuple[float, float, float, float]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour[:3])


def events_of(record: EpisodeRecord, verdict: Verdict | None = None) -> list[list[Any]]:
    """Events as step, kind, actor, other actor, details, and colour of the mark (empty without a mark).

    The predicate's moments are among them, by time.
    """
    happened = [
        [event.step, event.kind.value, event.actor_id, event.other_id, _details(event), _mark(record, event)]
        for event in record.events
    ]
    judged = [moment for part in verdict.parts for moment in _moments(part)] if verdict else []
    return sorted([*happened, *judged], key=lambda event: int(event[0]))


def _moments(part: Part) -> Iterator[list[Any]]:
    counts = part.value == len(part.moments)
    for number, moment in enumerate(part.moments, 1):
        found = f"{number if counts else part.value:.4g} (needs {part.relation} {part.threshold:.4g})"
        details = f"{found}, {moment.note}" if moment.note else found
        yield [moment.step, f"{PARAMETER}.{part.name}", moment.actor_id, NO_ACTOR, details, _JUDGED[part.holds]]


def _details(event: Event) -> str:
    return shown_text(", ".join(_detail(name, value) for name, value in event.detail.items() if value != ""))


def _detail(name: str, value: float | str) -> str:
    """A detail as text: ``way_m`` 21.96 becomes ``distance 22 m``."""
    if name == "owner":
        return "to the behaviour model" if value == Owner.ROS.name else f"to {value}"
    head, _, unit = name.replace("way_m", "distance_m").rpartition("_")
    words, unit = (head, f" {_UNITS[unit]}") if head and unit in _UNITS else (name, "")
    return f"{words.replace('_', ' ')} {f'{value:.3g}' if isinstance(value, float) else value}{unit}"


def _mark(record: EpisodeRecord, event: Event) -> str:
    shown = event.kind not in EMV_EVENTS or event.actor_id in record.emv_ids
    return _MARKS.get(event.kind, "") if shown else ""


def page_of_bag(
    bag: Path,
    against: Sequence[Path] = (),
    complain: Callable[[str], None] = lambda _: None,
    sensed: Sensed = NOTHING,
) -> str:
    """Page of a bag with sensor data, compared with others; ``complain`` gets a line if decisions are unknown.

    Raises:
        SirenError: A bag cannot be read, or as ``episode_page``.
    """
    others = [read_episode(other) for other in against]
    record = read_episode(bag)
    decisions: list[tuple[int, Mapping[int, Decision]]] | str
    try:
        decisions = list(decisions_of(record))
    except SirenError as error:
        complain(f"the page does not say why vehicles drive as they do: {error}")
        decisions = f"Not known: {error}."
    return episode_page(record, decisions, others, sensed)
