"""Draws charts of scores in a common style, and pictures of samples on the map.

A picture of a template shows its best, median and worst sample of each model.
"""

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

from siren_ros.base.numerics.arrays import Floats
from siren_ros.base.numerics.units import STEP_S
from siren_ros.data.recording.episode_record import EpisodeRecord
from siren_ros.errors import whole_file, writing
from siren_ros.scoring.evaluation.prediction.metrics import calibration_error
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.reports.score_table import GroupKind, ScoreTable
from siren_ros.scoring.evaluation.prediction.samples import ScoredSamples, future_times_s
from siren_ros.scoring.evaluation.prediction.scoring import ScoringJob, answers_for
from siren_ros.scoring.pictures.plot_parts import FAINT_TEXT, TEXT, draw_roads, draw_scale_bar, draw_vehicles

DPI: Final = 150
SMALL_PT: Final = 8
"""Size of the text in legends, ticks and titles of panels."""
TITLE_PT: Final = 9
_COLOURS: Final = ("#e08e1b", "#1a86b8", "#12855f", "#c2358f", "#6b4fc0", "#7a5230", "#4fb3bf", "#9aa51c", "#5c6b73")
"""Colours of models, distinct from each other, from the roads and from the EMV's red."""


def colour_of_model(models: Sequence[str], model: str) -> str:
    """Colour of a model, the same in all charts of a report."""
    return _COLOURS[list(models).index(model) % len(_COLOURS)]


def new_figure(width_in: float, height_in: float) -> Figure:
    """An empty figure."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def quiet(axes: Axes) -> None:
    """Style axes with thin lines and without a box."""
    axes.grid(color="#e3e5e8", linewidth=0.7)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(colors=FAINT_TEXT, labelsize=SMALL_PT)
    axes.xaxis.label.set_color(TEXT)
    axes.yaxis.label.set_color(TEXT)


def legend(axes: Axes) -> None:
    """Draw a small legend without a box."""
    axes.legend(frameon=False, fontsize=SMALL_PT)


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG.

    Raises:
        InputError: The file cannot be written.
    """
    with writing(path), whole_file(path) as file:
        figure.savefig(file)


def draw_horizon(table: ScoreTable) -> Figure:
    """Mean distance of the most probable paths from the truth over time; one line per model with samples."""
    figure = new_figure(6.4, 4.0)
    axes = figure.add_subplot()
    quiet(axes)
    times = np.concatenate(([0.0], future_times_s()))
    for model, samples in table.samples.items():
        if len(samples):
            distance = np.concatenate(([0.0], samples.distance_sum_m / len(samples)))
            axes.plot(times, distance, color=colour_of_model(table.models, model), linewidth=1.8, label=model)
    axes.set_xlim(0.0, times[-1])
    axes.set_ylim(0.0)
    axes.set_xlabel("time after the present, s")
    axes.set_ylabel("mean distance, m")
    title = f"error over the horizon, all samples of {len(table.episodes)} episodes"
    axes.set_title(title, fontsize=TITLE_PT, loc="left")
    if axes.lines:
        legend(axes)
    return figure


def draw_reliability(table: ScoreTable) -> Figure | None:
    """Reliability diagram of the models that give probabilities; None if no model does."""
    stating = [model for model, samples in table.samples.items() if samples.reliability[0].any()]
    if not stating:
        return None
    figure = new_figure(4.8, 4.6)
    axes = figure.add_subplot()
    quiet(axes)
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#9aa0a6", linewidth=1.0, linestyle="--")
    for model in stating:
        reliability = table.samples[model].reliability
        count, probability, best = reliability[:, reliability[0] > 0]
        colour = colour_of_model(table.models, model)
        label = f"{model} (error {calibration_error(reliability).value:.2f})"
        axes.plot(probability / count, best / count, color=colour, linewidth=1.5, label=label)
        # The area of a dot, in pt², is proportional to its share of the hypotheses.
        axes.scatter(probability / count, best / count, s=8.0 + 90.0 * np.sqrt(count / count.sum()), color=colour)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_aspect("equal")
    axes.set_xlabel("stated probability of a hypothesis")
    axes.set_ylabel("share that was the best")
    legend(axes)
    return figure


MOVED_MIN_M: Final = 5.0
"""Only samples that move at least this far are drawn: every model predicts a standing vehicle well."""
RANKS: Final = ("best", "median", "worst")


@dataclass(frozen=True)
class ChosenSample:
    """One sample of one model that is drawn."""

    model: str
    template: str
    rank: str
    episode: int
    """Position of its episode in the table."""
    step: int
    actor_id: int
    ade_m: float


def chosen_samples(table: ScoreTable) -> Iterator[ChosenSample]:
    """Best, median and worst moving sample for each template and model, by ADE."""
    for group in table.of_kind(GroupKind.TEMPLATE):
        for model, samples in table.samples.items():
            rows = np.flatnonzero(group.episodes[samples.episode] & (samples.moved_m >= MOVED_MIN_M))
            if not len(rows):
                continue
            ade_m = samples.values["ade_m"]
            order = rows[np.argsort(ade_m[rows], kind="stable")]
            for rank, row in zip(RANKS, order[[0, len(order) // 2, -1]], strict=True):
                place = int(samples.episode[row]), int(samples.step[row]), int(samples.actor_id[row])
                yield ChosenSample(model, group.name, rank, *place, float(ade_m[row]))


TRUTH: Final = "#111418"
TRUTH_PT: Final = 3.4
PAST: Final = "#6b7178"
PAST_PT: Final = 1.4
PATH_PT: Final = 1.6
_PAST_LAYER: Final = 7.0
_TRUTH_LAYERS: Final = (7.2, 7.3)
_PATH_LAYERS: Final = (7.4, 7.5)
"""Drawing layers above the roads and the vehicles: of a line, and of the mark at its end."""
_FAINTEST: Final = 0.15
_MARGIN_M: Final = 8.0
_SIDE_MIN_M: Final = 40.0


@dataclass(frozen=True)
class SamplePanel:
    """A sample with everything that is drawn of it."""

    chosen: ChosenSample
    record: EpisodeRecord
    samples: ScoredSamples
    """This one sample."""
    hypotheses: Hypotheses


def draw_sample(axes: Axes, panel: SamplePanel, colour: str) -> None:
    """Draw the map around the sample; a hypothesis's opacity is its probability relative to the first one's."""
    chosen, batch, truth = panel.chosen, panel.samples.batch, panel.samples.future_xy_m[0]
    here = batch.xy_m[0]
    past = batch.actors.xy_m[batch.target[0]][batch.actors.observed[batch.target[0]]]
    paths, probability = panel.hypotheses.xy_m[0], panel.hypotheses.probability[0]
    _frame(axes, np.concatenate((past, truth, paths[0])))
    draw_roads(axes, panel.record.network, line_width=0.7)
    state = next(state for state in panel.record.states if state.step == chosen.step)
    draw_vehicles(axes, state, panel.record.actors, line_width=0.4)
    axes.plot(*past.T, color=PAST, linewidth=PAST_PT, zorder=_PAST_LAYER)
    line, end = _TRUTH_LAYERS
    axes.plot(*np.vstack((here, truth)).T, color=TRUTH, linewidth=TRUTH_PT, zorder=line)
    axes.scatter(truth[-1:, 0], truth[-1:, 1], s=34, color=TRUTH, zorder=end)
    line, end = _PATH_LAYERS
    for path, share in zip(paths[::-1], probability[::-1], strict=True):
        alpha = max(float(share / probability[0]), _FAINTEST)
        axes.plot(*np.vstack((here, path)).T, color=colour, linewidth=PATH_PT, alpha=alpha, zorder=line)
        axes.scatter(path[-1:, 0], path[-1:, 1], s=18, color=colour, alpha=alpha, marker="D", zorder=end)
    kind = "EMV" if panel.record.actors[chosen.actor_id].is_emv else f"vehicle {chosen.actor_id}"
    title = f"{chosen.rank}: ADE {chosen.ade_m:.2f} m, {kind} at {chosen.step * STEP_S:.1f} s"
    axes.set_title(title, fontsize=SMALL_PT, color=TEXT, loc="left")
    draw_scale_bar(axes)


def _frame(axes: Axes, points: Floats) -> None:
    """Set the axes to a square around the points, with equal scales."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = max(float((high - low).max()) / 2.0 + _MARGIN_M, _SIDE_MIN_M / 2.0)
    x, y = (low + high) / 2.0
    axes.set_xlim(x - half, x + half)
    axes.set_ylim(y - half, y + half)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color("#c4c8cd")


_PANEL_IN: Final = 3.5
_HEAD_IN: Final = 0.55
_GAP_IN: Final = 0.05
_LEFT: Final = 0.03
_RIGHT: Final = 0.995


def draw_template(template: str, panels: Sequence[SamplePanel], models: Sequence[str]) -> Figure:
    """Draw the panels of a template: a row per model, a column per rank.

    All models of the report decide the colours.
    """
    shown = [model for model in models if any(panel.chosen.model == model for panel in panels)]
    height_in = _PANEL_IN * len(shown) + _HEAD_IN
    figure = Figure(figsize=(_PANEL_IN * len(RANKS), height_in), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    top, bottom = 1.0 - (_HEAD_IN + _GAP_IN) / height_in, _GAP_IN / height_in
    sides = {"left": _LEFT, "right": _RIGHT, "top": top, "bottom": bottom}
    grid = figure.add_gridspec(len(shown), len(RANKS), **sides, wspace=0.03, hspace=0.09)
    for panel in panels:
        row, column = shown.index(panel.chosen.model), RANKS.index(panel.chosen.rank)
        axes = figure.add_subplot(grid[row, column])
        draw_sample(axes, panel, colour_of_model(models, panel.chosen.model))
        if column == 0:
            axes.set_ylabel(panel.chosen.model, fontsize=10, color=TEXT)
    title, title_y = f"{template}: samples by ADE, of vehicles that move", 1.0 - 0.1 / height_in
    figure.suptitle(title, x=_LEFT, y=title_y, ha="left", va="top", fontsize=11, color=TEXT)
    lines = [
        Line2D([], [], color=PAST, linewidth=PAST_PT, label="past"),
        Line2D([], [], color=TRUTH, linewidth=TRUTH_PT, marker="o", label="truth"),
    ]
    for model in shown:
        colour = colour_of_model(models, model)
        lines.append(Line2D([], [], color=colour, linewidth=PATH_PT, marker="D", label=model))
    corner = _RIGHT, 1.0 - 0.02 / height_in
    figure.legend(
        handles=lines, loc="upper right", bbox_to_anchor=corner, ncols=len(lines), frameon=False, fontsize=SMALL_PT
    )
    return figure


def write_charts(folder: Path, table: ScoreTable) -> None:
    """Write the charts: error over time, and calibration if a model gives probabilities."""
    save(draw_horizon(table), folder / "horizon.png")
    reliability = draw_reliability(table)
    if reliability is not None:
        save(reliability, folder / "calibration.png")


def write_sample_pictures(folder: Path, table: ScoreTable, job: ScoringJob) -> None:
    """Write a picture for each template; it reads the bags of the drawn samples again, each once."""
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
        save(draw_template(template, drawn, table.models), folder / f"samples_{template}.png")
