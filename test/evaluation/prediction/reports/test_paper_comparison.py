"""On which maps our episodes are, next to the paper's."""

from dataclasses import replace

import numpy as np
import pytest
from made_scores import episode_scores, model_scores

from siren_ros.evaluation.prediction.reports.paper_comparison import maps_next_to_the_papers
from siren_ros.evaluation.prediction.reports.paper_results import PAPER_MAP


@pytest.mark.parametrize(
    ("maps", "text"),
    [
        (["town", "town"], "map: town (2); the paper's is Town10HD_Opt"),
        ([PAPER_MAP], "map: Town10HD_Opt, the paper's"),
        (["town", PAPER_MAP, "town"], "maps, pooled: Town10HD_Opt (1), town (2); the paper's is Town10HD_Opt"),
    ],
)
def test_the_maps_are_named_with_their_episodes(maps: list[str], text: str) -> None:
    one = episode_scores("S1", {"cv": model_scores(np.ones(2))})
    assert maps_next_to_the_papers([replace(one, map_name=name) for name in maps]) == text
