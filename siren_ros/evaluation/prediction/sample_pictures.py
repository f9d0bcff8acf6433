"""Pictures of samples: the best, the median and the worst one of each model and template, drawn on the map."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from siren_ros.evaluation.prediction.charts import DPI, SMALL_PT, colour_of_model, draw_horizon, draw_reliability, save
from siren_ros.evaluation.prediction.predictors import Hypotheses
from siren_ros.evaluation.prediction.reports.score_table import GroupKind, ScoreTable
from siren_ros.evaluation.prediction.samples import ScoredSamples
from siren_ros.evaluation.prediction.score_bags import ScoringJob, answers_for
from siren_ros.numerics.arrays import Floats
from siren_ros.numerics.units import STEP_S
from siren_ros.pictures.palette import TEXT
from siren_ros.pictures.plot_parts import draw_roads, draw_scale_bar, draw_vehicles
from siren_ros.recording.episode_record import EpisodeRecord

MOVED_MIN_M: Final = 5.0
"""A vehicle that stands is predicted by anybody: only samples that move farther are drawn."""
RANKS: Final = ("best", "median", "worst")


@dataclass(frozen=True)
class ChosenSample:
    """One sample of one model."""

    model: str
    template: str
    rank: str
    episode: int
    """Position of its episode."""
    step: int
    actor_id: int
    ade_m: float


def chosen_samples(table: ScoreTable) -> Iterator[ChosenSample]:
    """Three samples for each template and model by ADE, among those that move; none where none moves."""
    for group in table.of_kind(GroupKind.TEMPLATE):
        for model in table.models:
            samples = table.samples[model]
            rows = np.flatnonzero(group.episodes[samples.episode] & (samples.moved_m >= MOVED_MIN_M))
            if not len(rows):
                continue
            ade = samples.values["ade_m"][rows]
            order = np.argsort(ade, kind="stable")
            for rank, place in zip(RANKS, (0, len(order) // 2, -1), strict=True):
                row = rows[order[place]]
                key = int(samples.key[row])
                yield ChosenSample(
                    model=model,
                    template=group.name,
                    rank=rank,
                    episode=int(samples.episode[row]),
                    step=key >> 32,
                    actor_id=key & 0xFFFFFFFF,
                    ade_m=float(samples.values["ade_m"][row]),
                )


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
    state = next(state for state in panel.record.states if state.step == panel.chosen.step)
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


_PANEL_IN: Final = 3.5
_HEAD_IN: Final = 0.55
_GAP_IN: Final = 0.05
_TITLE_IN: Final = 0.1
_LEGEND_IN: Final = 0.02
"""From the upper edge of the figure."""
_LEFT: Final = 0.03
_RIGHT: Final = 0.995
_BETWEEN: Final = {"wspace": 0.03, "hspace": 0.09}
_TITLE_PT: Final = 11
_MODEL_PT: Final = 10


def draw_template(template: str, panels: Sequence[SamplePanel], models: Sequence[str]) -> Figure:
    """A row for each model, a column for each rank.

    Args:
        template: Name, for the title.
        panels: Any number for each model, in the order of the ranks.
        models: All models of the report, which set the colours.
    """
    shown = [model for model in models if any(panel.chosen.model == model for panel in panels)]
    height_in = _PANEL_IN * len(shown) + _HEAD_IN
    figure = Figure(figsize=(_PANEL_IN * len(RANKS), height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        len(shown),
        len(RANKS),
        left=_LEFT,
        right=_RIGHT,
        top=1.0 - (_HEAD_IN + _GAP_IN) / height_in,
        bottom=_GAP_IN / height_in,
        **_BETWEEN,
    )
    for panel in panels:
        row, column = shown.index(panel.chosen.model), RANKS.index(panel.chosen.rank)
        axes = figure.add_subplot(grid[row, column])
        draw_sample(axes, panel, colour_of_model(models, panel.chosen.model))
        if column == 0:
            axes.set_ylabel(panel.chosen.model, fontsize=_MODEL_PT, color=TEXT)
    figure.suptitle(
        f"{template}: samples by ADE, of vehicles that move",
        x=_LEFT,
        y=1.0 - _TITLE_IN / height_in,
        ha="left",
        va="top",
        fontsize=_TITLE_PT,
        color=TEXT,
    )
    figure.legend(
        handles=[
            Line2D([], [], color=PAST, linewidth=PAST_PT, label="past"),
            Line2D([], [], color=TRUTH, linewidth=TRUTH_PT, marker="o", label="truth"),
            *(
                Line2D([], [], color=colour_of_model(models, model), linewidth=PATH_PT, marker="D", label=model)
                for model in shown
            ),
        ],
        loc="upper right",
        bbox_to_anchor=(_RIGHT, 1.0 - _LEGEND_IN / height_in),
        ncols=len(shown) + 2,
        frameon=False,
        fontsize=SMALL_PT,
    )  # fmt: skip
    return figure


HORIZON_FILE: Final = "horizon.png"
RELIABILITY_FILE: Final = "calibration.png"
SAMPLES_FILE: Final = "samples_{template}.png"


def write_charts(folder: Path, table: ScoreTable) -> None:
    """Error over the horizon, and calibration where a model states probabilities."""
    save(draw_horizon(table), folder / HORIZON_FILE)
    reliability = draw_reliability(table)
    if reliability is not None:
        save(reliability, folder / RELIABILITY_FILE)


def write_sample_pictures(folder: Path, table: ScoreTable, job: ScoringJob) -> None:
    """A picture for each template; reads the bags of the chosen samples again, each once."""
    by_episode: dict[int, list[ChosenSample]] = defaultdict(list)
    for sample in chosen_samples(table):
        by_episode[sample.episode].append(sample)
    panels: dict[str, list[SamplePanel]] = defaultdict(list)
    for episode, chosen in sorted(by_episode.items()):
        bag = Path(table.episodes[episode].name)
        record, answers_of_model = answers_for(job, bag, {sample.model for sample in chosen})
        for sample in chosen:
            answers = answers_of_model[sample.model]
            batch = answers.samples.batch
            row = np.flatnonzero((batch.sample_step == sample.step) & (batch.actor_id == sample.actor_id))
            panel = SamplePanel(sample, record, answers.samples.select(row), answers.hypotheses.select(row))
            panels[sample.template].append(panel)
    for template, drawn in sorted(panels.items()):
        drawn.sort(key=lambda panel: (table.models.index(panel.chosen.model), RANKS.index(panel.chosen.rank)))
        save(draw_template(template, drawn, table.models), folder / SAMPLES_FILE.format(template=template))
