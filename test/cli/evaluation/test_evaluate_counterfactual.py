import json
from collections.abc import Callable
from pathlib import Path

import pytest

from siren_ros.cli.evaluation import evaluate_counterfactual
from siren_ros.cli.main import main
from siren_ros.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.evaluation.yielding.scoring import ScoredEpisode, YieldScores
from siren_ros.evaluation.yielding.thresholds import Measure


def scored(level: str, seed: int) -> ScoredEpisode:
    metrics = {metric.name: Measure(20.0 + seed - (2.0 + 0.5 * seed) * (level == "L1")) for metric in EPISODE_METRICS}
    return ScoredEpisode(f"{level}{seed}", "S3", level, seed, "town", "", str(seed), YieldScores(metrics, ()))


def test_effects_are_printed_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    episodes = [scored(level, seed) for level in ("L0", "L1") for seed in range(5)]
    monkeypatch.setattr(evaluate_counterfactual, "scored_episodes", lambda *_: (episodes, 0))
    out = tmp_path / "effects.json"
    assert main(["evaluate", "counterfactual", "x", "--out", str(out), "--outcomes", "site_time_s"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Effects on site_time_s"
    assert lines[2].split()[:6] == ["L1", "−", "L0", "S3", "-3.00", "[-3.98,"]
    assert len(lines) == 3
    written = json.loads(out.read_text(encoding="utf-8"))
    assert {one["outcome"] for one in written} > {"site_time_s", "collisions"}
    assert written[0]["difference"] == pytest.approx(-3.0)


def test_no_pair_fails_the_command(write_bag: Callable[..., Path], tmp_path: Path) -> None:
    write_bag(tmp_path / "bag", duration_s=8.0)
    assert main(["evaluate", "counterfactual", str(tmp_path), "--jobs", "1"]) == 1
