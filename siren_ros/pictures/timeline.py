"""Modes of the vehicles as bars over time, and their speeds."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from siren_ros.numerics.units import STEP_S
from siren_ros.pictures.palette import EMV_MODE_COLOURS, EVENT_STYLES, FAINT_TEXT, TEXT, colour_of
from siren_ros.pictures.vehicles import KMH
from siren_ros.recording.episode_record import EpisodeRecord, StateRows
from siren_ros.world.actors import Mode
from siren_ros.world.events import EventKind


def yielding_actors(record: EpisodeRecord) -> tuple[int, ...]:
    """The civilians that yield, in the order in which they begin."""
    rows = record.rows
    mode = rows.mode
    yielding = (mode >= Mode.YIELD_REACTING) & (mode <= Mode.YIELD_HOLD)
    first: dict[int, int] = {}
    for actor_id, step in zip(rows.actor_id[yielding].tolist(), rows.step[yielding].tolist(), strict=True):
        first.setdefault(actor_id, step)
    return tuple(sorted(first, key=lambda actor_id: (first[actor_id], actor_id)))


def mode_runs(track: StateRows) -> list[tuple[int, int, Mode]]:
    """First and last step of every stretch of equal mode."""
    if len(track) == 0:
        return []
    edges = np.flatnonzero(np.diff(track.mode.astype(np.int64)) != 0)
    starts, ends = np.concatenate(([0], edges + 1)), np.concatenate((edges, [len(track) - 1]))
    return [
        (int(track.step[first]), int(track.step[last]), Mode(int(track.mode[first])))
        for first, last in zip(starts, ends, strict=True)
    ]


def draw_states(axes: Axes, record: EpisodeRecord, actors: Sequence[int], moments: Sequence[int]) -> None:
    """One bar per vehicle with its mode over time; markers for events, lines for the snapshots.

    Args:
        axes: Where to draw.
        record: The episode.
        actors: Rows from top to bottom, EMVs among them.
        moments: Steps of the snapshots.
    """
    for row, actor_id in enumerate(actors):
        is_emv = record.actors[actor_id].is_emv
        for first, last, mode in mode_runs(record.track(actor_id)):
            colour = EMV_MODE_COLOURS.get(mode, "#b9bec4") if is_emv else colour_of(mode, False)
            nominal = not is_emv and mode is Mode.NOMINAL
            axes.barh(
                row,
                (last + 1 - first) * STEP_S,
                left=first * STEP_S,
                height=0.24 if nominal else 0.62,
                color="#d5d8dc" if nominal else colour,
                linewidth=0.0,
            )
    position = {actor_id: row for row, actor_id in enumerate(actors)}
    for event in record.events:
        style = EVENT_STYLES.get(event.kind)
        if style is not None and event.actor_id in position:
            at = (event.step * STEP_S, position[event.actor_id])
            axes.plot(
                *at, marker=style[0], color=style[1], markersize=4.5, markeredgecolor="white", markeredgewidth=0.5
            )
    for number, step in enumerate(moments, start=1):
        axes.axvline(step * STEP_S, color=FAINT_TEXT, linewidth=0.7, linestyle=":", zorder=0)
        axes.annotate(
            str(number), (step * STEP_S, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=7
        )
    axes.set_yticks(range(len(actors)), [_name(record, actor_id) for actor_id in actors], fontsize=7)
    axes.set_ylim(len(actors) - 0.45, -0.55)
    _plain(axes)


def _name(record: EpisodeRecord, actor_id: int) -> str:
    actor = record.actors[actor_id]
    return "EMV" if actor.is_emv else f"#{actor_id} {actor.actor_class.name.lower()}"


def draw_speeds(axes: Axes, record: EpisodeRecord, actors: Sequence[int]) -> None:
    """Speeds over time, the EMV's in red and prominent, and collisions as crosses."""
    for actor_id in actors:
        track, is_emv = record.track(actor_id), record.actors[actor_id].is_emv
        axes.plot(
            track.time_s,
            track.speed_mps * KMH,
            color="#d41a1f" if is_emv else "#7d838b",
            linewidth=1.8 if is_emv else 0.8,
            alpha=1.0 if is_emv else 0.7,
            zorder=3 if is_emv else 2,
        )
    for event in record.events_of(EventKind.COLLISION):
        axes.axvline(event.step * STEP_S, color="#d40000", linewidth=1.0)
    axes.set_ylabel("speed, km/h", fontsize=7.5, color=TEXT)
    axes.set_xlabel("simulated time, s", fontsize=7.5, color=TEXT)
    axes.set_ylim(bottom=0.0)
    axes.grid(axis="y", linewidth=0.4, color="#dcdfe3")
    _plain(axes)


def _plain(axes: Axes) -> None:
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#9aa0a7")
    axes.tick_params(labelsize=7, colors=TEXT, length=2.5)
