import json

import numpy as np
import pytest

from siren_ros.evaluation.prediction.metrics.displacement import METRICS, MetricValue
from siren_ros.evaluation.prediction.protocol.samples import Population
from siren_ros.evaluation.prediction.reports.paper_results import PAPER, TEMPLATES
from siren_ros.evaluation.prediction.reports.summary import as_json, summarise
from siren_ros.evaluation.prediction.scoring import EpisodeScores
from siren_ros.scenario.levels import EmergencyLevel


def scores(template: str, ade_m: float, samples: int = 100, seed: int = 0) -> EpisodeScores:
    values = {metric.name: MetricValue(ade_m if samples else 0.0, samples) for metric in METRICS}
    return EpisodeScores(
        f"{template}_{seed}", template, EmergencyLevel.L2, seed, "town", Population.ALL, {"cv": values}
    )


def test_the_papers_own_values_agree_with_the_paper() -> None:
    values = PAPER["cv", "ade_m"].by_template
    summary = summarise([scores(template, values[template]) for template in TEMPLATES])["cv"]["ade_m"]
    assert summary.mean == pytest.approx(1.44, abs=0.005)
    assert summary.deviation == pytest.approx(0.0, abs=0.003)
    assert summary.spearman == pytest.approx(1.0)
    assert summary.paper_mean == summary.paper_mean_same_templates == 1.44


def test_templates_count_once_whatever_their_number_of_episodes() -> None:
    episodes = [
        scores("S1", 1.0),
        scores("S1", 3.0, seed=1),
        scores("S2", 5.0),
        scores("mine", 9.0),
        scores("S3", 0.0, 0),
    ]
    summary = summarise(episodes)["cv"]["ade_m"]
    assert summary.by_template == {"S1": 2.0, "S2": 5.0, "mine": 9.0}
    assert summary.mean == pytest.approx(16.0 / 3.0)
    assert summary.paper_by_template == {"S1": 1.63, "S2": 1.17}
    assert summary.paper_mean_same_templates == pytest.approx(1.40)
    assert summary.deviation_same_templates == pytest.approx(3.5 / 1.4 - 1.0)
    assert summary.deviation == pytest.approx(16.0 / 3.0 / 1.44 - 1.0)
    assert summary.spearman is None, "two templates in common are no ranking"


def test_without_any_sample_nothing_is_said() -> None:
    summary = summarise([scores("S1", 0.0, 0)])["cv"]["ade_m"]
    assert (summary.mean, summary.deviation, summary.deviation_same_templates, summary.spearman) == (None,) * 4


def test_json_says_all_and_is_strict() -> None:
    episodes = [scores("S1", 1.5), scores("mine", 0.0, 0)]
    text = json.dumps(as_json(episodes, summarise(episodes)), allow_nan=False)
    read = json.loads(text)
    first, second = (episode["models"]["cv"] for episode in read["episodes"])
    assert (first["samples"], first["ade_m"], first["paper"]["ade_m"]) == (100, 1.5, 1.63)
    assert (second["samples"], second["ade_m"], second["paper"]) == (0, None, {})
    assert read["summary"]["cv"]["ade_m"]["mean"] == 1.5
    assert np.isclose(read["summary"]["cv"]["ade_m"]["deviation"], 1.5 / 1.44 - 1.0)
