"""One sample on the map: past, truth, hypotheses, and who else is there."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes

from siren_ros.evaluation.prediction.charts.chart import SMALL_PT
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
TRUTH_PT: Final = 3.4
PAST_PT: Final = 1.4
PATH_PT: Final = 1.6
_ROAD_PT: Final = 0.7
_VEHICLE_PT: Final = 0.4
_TRUTH_END_PT2: Final = 34
_PATH_END_PT2: Final = 18
_PAST_LAYER: Final = 7.0
_TRUTH_LAYERS: Final = (7.2, 7.3)
_PATH_LAYERS: Final = (7.4, 7.5)
"""Above the roads and the vehicles; of a line, and of the mark at its end."""
_FAINTEST: Final = 0.15
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
    draw_roads(axes, panel.record.network, line_width=_ROAD_PT)
    state = next(one for one in panel.record.states if one.step == panel.chosen.step)
    draw_vehicles(axes, state, panel.record.actors, line_width=_VEHICLE_PT)
    axes.plot(*past.T, color=PAST, linewidth=PAST_PT, zorder=_PAST_LAYER)
    line, end = _TRUTH_LAYERS
    axes.plot(*np.vstack((here, truth)).T, color=TRUTH, linewidth=TRUTH_PT, zorder=line)
    axes.scatter(truth[-1:, 0], truth[-1:, 1], s=_TRUTH_END_PT2, color=TRUTH, zorder=end)
    line, end = _PATH_LAYERS
    for path, share in zip(paths[::-1], probability[::-1], strict=True):
        alpha = max(float(share / probability[0]), _FAINTEST)
        axes.plot(*np.vstack((here, path)).T, color=colour, linewidth=PATH_PT, alpha=alpha, zorder=line)
        axes.scatter(path[-1:, 0], path[-1:, 1], s=_PATH_END_PT2, color=colour, alpha=alpha, marker="D", zorder=end)
    actor = panel.record.actors[panel.chosen.actor_id]
    kind = "EMV" if actor.is_emv else f"vehicle {panel.chosen.actor_id}"
    axes.set_title(
        f"{panel.chosen.rank}: ADE {panel.chosen.ade_m:.2f} m, {kind} at {panel.chosen.step * STEP_S:.1f} s",
        fontsize=SMALL_PT,
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
