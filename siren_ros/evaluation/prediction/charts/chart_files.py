"""Writes the charts and pictures of a report."""

from collections import defaultdict
from pathlib import Path
from typing import Final

import numpy as np

from siren_ros.evaluation.prediction.charts.chart import save
from siren_ros.evaluation.prediction.charts.horizon import draw_horizon
from siren_ros.evaluation.prediction.charts.reliability import draw_reliability
from siren_ros.evaluation.prediction.charts.sample_choice import RANKS, ChosenSample, chosen_samples
from siren_ros.evaluation.prediction.charts.sample_panel import SamplePanel
from siren_ros.evaluation.prediction.charts.template_picture import draw_template
from siren_ros.evaluation.prediction.reports.score_table import ScoreTable
from siren_ros.evaluation.prediction.scoring.score_bags import ScoringJob, answers_for
from siren_ros.evaluation.prediction.scoring.score_episode import Answers
from siren_ros.recording.episode_record import EpisodeRecord

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
    for one in chosen_samples(table):
        by_episode[one.episode].append(one)
    panels: dict[str, list[SamplePanel]] = defaultdict(list)
    for episode, wanted in sorted(by_episode.items()):
        bag = Path(table.episodes[episode].name)
        record, answers = answers_for(job, bag, {one.model for one in wanted})
        for one in wanted:
            panels[one.template].append(_panel(one, record, answers[one.model]))
    for template, found in sorted(panels.items()):
        found.sort(key=lambda panel: (table.models.index(panel.chosen.model), RANKS.index(panel.chosen.rank)))
        save(draw_template(template, found, table.models), folder / SAMPLES_FILE.format(template=template))


def _panel(chosen: ChosenSample, record: EpisodeRecord, answers: Answers) -> SamplePanel:
    batch = answers.samples.batch
    step, actor = batch.step[batch.actors.frame[batch.target]], batch.actors.actor_id[batch.target]
    row = np.flatnonzero((step == chosen.step) & (actor == chosen.actor_id))
    return SamplePanel(chosen, record, answers.samples.select(row), answers.hypotheses.select(row))
