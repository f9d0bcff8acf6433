"""The samples of Argoverse 2's models are the scenarios that the export writes: neither knows the other."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from siren_ros.datasets.argoverse2 import OBSERVED, STEPS, scenario_id
from siren_ros.evaluation.prediction.prediction_file import read_prediction_file
from siren_ros.evaluation.prediction.samples import ARGOVERSE_WINDOW, Population, samples_of
from siren_ros.evaluation.prediction.submission import submission
from siren_ros.record.tracks import tracks_of, whole_windows
from siren_ros.recording.episode_record import EpisodeRecord


@pytest.fixture(scope="module")
def record(record_of: Callable[..., EpisodeRecord]) -> EpisodeRecord:
    return record_of(duration_s=14.0, civilians=6)


@pytest.mark.parametrize("population", Population)
def test_every_scenario_is_a_sample_and_every_sample_a_scenario(
    population: Population, record: EpisodeRecord, tmp_path: Path
) -> None:
    """A submission as av2 writes it, for every scenario: scored as a whole, the truth found again at every time."""
    rows = []
    for track in tracks_of(record):
        actor = track.actor.actor_id
        for first in whole_windows(track, STEPS, population.value).tolist():
            whole = track.window(first, STEPS)
            name = scenario_id("S2_L2_seed0_town", actor, first + OBSERVED - 1)
            own = "AV" if track.actor.is_emv else str(actor)
            rows.append((name, own, 1.0, whole.x_m[OBSERVED:], whole.y_m[OBSERVED:]))
    names = ("scenario_id", "track_id", "probability", "predicted_trajectory_x", "predicted_trajectory_y")
    table = pa.table({name: list(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)})
    pq.write_table(table, tmp_path / "submission.parquet")
    samples = samples_of(record, ARGOVERSE_WINDOW, population)
    part = submission(read_prediction_file(tmp_path / "submission.parquet")).of_episode(["S2-L2-seed0-town"])
    found, hypotheses = part.meet(samples.batch)
    assert len(found) == len(samples) == len(rows) > 30
    assert np.array_equal(hypotheses.xy_m[:, 0], samples.future_xy_m)
