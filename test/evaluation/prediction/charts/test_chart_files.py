"""Pictures of a bag: which files there are, and what the panels show."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from PIL import Image

from siren_ros.cli.main import main
from siren_ros.evaluation.prediction.charts.chart import colour_of_model, new_figure
from siren_ros.evaluation.prediction.charts.sample_choice import ChosenSample
from siren_ros.evaluation.prediction.charts.sample_panel import TRUTH, SamplePanel, draw_sample
from siren_ros.evaluation.prediction.protocol.hypotheses import Hypotheses
from siren_ros.evaluation.prediction.protocol.samples import Population, samples_of
from siren_ros.evaluation.prediction.protocol.window import HistoryWindow
from siren_ros.recording.episode_record import EpisodeRecord


def test_a_report_has_its_pictures(
    tmp_path: Path, write_bag: Callable[..., Path], capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "S2_L2_seed0", duration_s=9.0)
    words = ["evaluate", "prediction", str(bag), "--models=cv,idm", "--population=all"]
    assert main([*words, "--pictures", "--out", str(tmp_path / "out")]) == 0
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {"horizon.png", "samples_S2.png"}
    picture = np.asarray(Image.open(tmp_path / "out" / "samples_S2.png").convert("RGB"))
    for model in ("cv", "idm"):
        colour = np.array([int(colour_of_model(["cv", "idm"], model)[at : at + 2], 16) for at in (1, 3, 5)])
        assert (np.abs(picture.astype(int) - colour).max(axis=-1) < 12).sum() > 300, "its paths are there"
    capsys.readouterr()
    assert main([*words, "--pictures"]) == 2
    assert "together with --out DIR" in capsys.readouterr().err


def test_a_panel_shows_the_truth_and_every_hypothesis(record_of: Callable[..., EpisodeRecord]) -> None:
    record = record_of(duration_s=9.0)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([3]))
    batch = samples.batch
    truth = samples.future_xy_m
    paths = np.stack((truth, truth + 1.0, truth - 2.0), axis=1)
    hypotheses = Hypotheses.ranked(paths, np.array([[0.2, 0.7, 0.1]]))
    step = int(batch.step[batch.actors.frame[batch.target[0]]])
    chosen = ChosenSample("net", "S2", "best", 0, step, int(batch.actors.actor_id[batch.target[0]]), 1.0)
    axes = new_figure(4.0, 4.0).add_subplot()
    draw_sample(axes, SamplePanel(chosen, record, samples, hypotheses), "#1a86b8")
    (true,) = [line for line in axes.lines if to_hex(line.get_color()) == TRUTH]
    assert np.allclose(true.get_xydata()[1:], truth[0])
    assert np.allclose(true.get_xydata()[0], batch.xy_m[0])
    drawn = [line for line in axes.lines if to_hex(line.get_color()) == "#1a86b8"]
    assert [round(line.get_alpha(), 3) for line in drawn] == [0.15, 0.286, 1.0], "the most probable on top"
    assert np.allclose(drawn[-1].get_xydata()[1:], truth[0] + 1.0)
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    assert (np.vstack((truth[0], batch.xy_m)) > low).all()
    assert (np.vstack((truth[0], batch.xy_m)) < high).all()
