"""How traffic made way, what levels change, and how episodes differ, from the command line."""

import json

import pyarrow.parquet as pq
import pytest

from siren_ros.base.tables import Measure
from siren_ros.cli.evaluation import yielding
from siren_ros.cli.main import main
from siren_ros.scoring.evaluation.yielding.metrics import EPISODE_METRICS
from siren_ros.scoring.evaluation.yielding.scoring import ScoredEpisode, YieldScores


def test_a_folder_of_bags_is_scored(write_bag, tmp_path, siren) -> None:
    for number in range(2):
        write_bag(tmp_path / "study" / "group" / f"bag{number}", duration_s=12.0 + number)
    out, drivers = tmp_path / "episodes.json", tmp_path / "drivers.parquet"
    options = ["--out", str(out), "--drivers", str(drivers), "--workers", "1"]
    table = siren(["evaluate", "yield", str(tmp_path / "study"), *options]).out
    caption, head, *_ = table.splitlines()
    assert (caption, head.split()) == ("Yield metrics of S2", ["metric", "L2", "meaning"])
    assert "emv_delay_s" in table
    rows = json.loads(out.read_text(encoding="utf-8"))
    assert [row["bag"] for row in rows] == [str(tmp_path / "study" / "group" / f"bag{number}") for number in range(2)]
    assert all(row["emv_delay_s"] is not None for row in rows)
    assert set(pq.read_table(drivers)["template"].to_pylist()) == {"S2"}
    (tmp_path / "empty").mkdir()
    assert str(tmp_path / "empty") in siren(["evaluate", "yield", str(tmp_path / "empty")], 2).err
    assert main(["evaluate", "yield", str(tmp_path / "study"), "--out", "x.csv"]) == 2


@pytest.mark.parametrize(("task", "shown"), [("yield", "emv_delay_s"), ("diversity", "S2 ")])
def test_a_bag_that_cannot_be_read_leaves_the_others(write_bag, tmp_path, siren, task, shown) -> None:
    write_bag(tmp_path / "good", duration_s=12.0)
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "bad_0.mcap").write_bytes(b"nothing")
    printed = siren(["evaluate", task, str(tmp_path), "--workers", "1"], 2)
    assert shown in printed.out
    assert "bad" in printed.err


def scored(level: str, seed: int) -> ScoredEpisode:
    metrics = {metric.name: Measure(20.0 + seed - (2.0 + 0.5 * seed) * (level == "L1")) for metric in EPISODE_METRICS}
    return ScoredEpisode(f"{level}{seed}", "S3", level, seed, "town", "", str(seed), YieldScores(metrics, ()))


def test_effects_are_printed_and_written(tmp_path, monkeypatch, siren) -> None:
    episodes = [scored(level, seed) for level in ("L0", "L1") for seed in range(5)]
    monkeypatch.setattr(yielding, "scored_episodes", lambda *_: (episodes, 0))
    out = tmp_path / "effects.json"
    lines = siren(["evaluate", "counterfactual", "x", "--out", str(out), "--outcomes", "site_time_s"]).out.splitlines()
    assert lines[0] == "Effects on site_time_s"
    assert lines[2].split()[:6] == ["L1", "−", "L0", "S3", "-3.00", "[-3.98,"]
    assert len(lines) == 3
    written = json.loads(out.read_text(encoding="utf-8"))["differences"]
    assert {effect["metric"] for effect in written} > {"site_time_s", "collisions"}
    assert written[0]["value"] == pytest.approx(-3.0)


def test_what_more_seeds_add_is_printed_and_written(write_bag, tmp_path, siren) -> None:
    write_bag(tmp_path / "one", duration_s=4.0)
    write_bag(tmp_path / "two", duration_s=6.0, seed=1)
    out = tmp_path / "diversity.json"
    lines = siren(["evaluate", "diversity", str(tmp_path), "--workers", "1", "--out", str(out)]).out.splitlines()
    assert lines[2].split()[:4] == ["S2", "L2", "straight", "2"]
    (written,) = json.loads(out.read_text(encoding="utf-8"))
    assert written["episodes"] == 2
    assert written["ways_m"]["mean"] == pytest.approx(0.0), "the same ways, as long as both last"
    assert written["events"]["mean"] > 0.0
    assert main(["evaluate", "diversity", str(tmp_path), "--workers", "0"]) == 2
    assert main(["evaluate", "counterfactual", str(tmp_path), "--workers", "1"]) == 1, "there is no pair"
