"""One sample on the map: past, truth, hypotheses, and who else is there."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from siren_ros.evaluation.prediction.charts.sample_choice import ChosenSample
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.samples import ScoredSamples
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S
from siren_ros.pictures.annotations import draw_scale_bar
from siren_ros.pictures.palette import TEXT
from siren_ros.pictures.roads import draw_roads
from siren_ros.pictures.vehicles import draw_vehicles
from siren_ros.recording.episode_record import EpisodeRecord

TRUTH: Final = "#111418"
PAST: Final = "#6b7178"
_MARGIN_M: Final = 8.0
_LEAST_M: Final = 40.0


@dataclass(frozen=True)
class SamplePanel:
    """A sample with everything that is drawn of it."""

    chosen: ChosenSample
    record: EpisodeRecord
    samples: ScoredSamples
    """This one sample."""
    hypotheses: Hypotheses


def draw_sample(axes: Axes, panel: SamplePanel, colour: str) -> None:
    """Draws the map around the sample; the opacity of a hypothesis is its probability relative to the first."""
    batch, truth = panel.samples.batch, panel.samples.future_xy_m[0]
    here = batch.xy_m[0]
    past = batch.actors.xy_m[batch.target[0]][batch.actors.observed[batch.target[0]]]
    paths, probability = panel.hypotheses.xy_m[0], panel.hypotheses.probability[0]
    _frame(axes, np.concatenate((past, truth, paths[0])))
    draw_roads(axes, panel.record.network, line_width=0.7)
    state = next(one for one in panel.record.states if one.step == panel.chosen.step)
    draw_vehicles(axes, state, panel.record.actors, line_width=0.4)
    axes.plot(*past.T, color=PAST, linewidth=1.4, zorder=7)
    axes.plot(*np.vstack((here, truth)).T, color=TRUTH, linewidth=3.4, zorder=7.2)
    axes.scatter(truth[-1:, 0], truth[-1:, 1], s=34, color=TRUTH, zorder=7.3)
    for path, share in zip(paths[::-1], probability[::-1], strict=True):
        alpha = float(np.clip(share / probability[0], 0.15, 1.0))
        axes.plot(*np.vstack((here, path)).T, color=colour, linewidth=1.6, alpha=alpha, zorder=7.4)
        axes.scatter(path[-1:, 0], path[-1:, 1], s=18, color=colour, alpha=alpha, marker="D", zorder=7.5)
    actor = panel.record.actors[panel.chosen.actor_id]
    kind = "EMV" if actor.is_emv else f"vehicle {panel.chosen.actor_id}"
    axes.set_title(
        f"{panel.chosen.rank}: ADE {panel.chosen.ade_m:.2f} m, {kind} at {panel.chosen.step * STEP_S:.1f} s",
        fontsize=8,
        color=TEXT,
        loc="left",
    )
    draw_scale_bar(axes)


def _frame(axes: Axes, points: Floats) -> None:
    """A square around the points, with equal scales."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = max(float((high - low).max()) / 2.0 + _MARGIN_M, _LEAST_M / 2.0)
    middle = (low + high) / 2.0
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color("#c4c8cd")
