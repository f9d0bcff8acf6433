"""A predictor in the loop: its topic is recorded in lockstep and scored like a file."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from live_episodes import EXAMPLES, Domain, Run, finish

from siren_ros.cli.main import main
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.running.generation.closed_loop import record_episode
from siren_ros.running.generation.episode_setup import set_up_episode
from siren_ros.running.generation.replay_check import repeat_episode
from siren_ros.scoring.judging.verify import verify_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest

DOMAIN = Domain(subprocess.Popen)
PREDICTOR = str(EXAMPLES / "live_predictor.py")
STEPS = 190
JUDGED = ("predictor:=my_predictor", "sensors:=none", "bag:=bag")


def judge(folder: Path, *more: str) -> Run:
    """An episode with the example's predictor."""
    with (
        DOMAIN.episode(*JUDGED, f"duration_s:={STEPS / 20}", *more, cwd=folder) as episode,
        DOMAIN.running(PREDICTOR, cwd=folder) as predictor,
    ):
        run, said = finish(episode), finish(predictor)
    assert said.code == 0, said.err
    return run


@pytest.fixture(scope="module", name="folder")
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("judged")
    run = judge(folder)
    assert run.code == 0, run.err + run.out
    return folder


def test_the_record_is_sound_and_has_a_message_at_every_frame(folder: Path) -> None:
    record = read_episode(folder / "bag")
    assert record.topics["/predictions"].count == STEPS / 2
    assert [str(part) for part in verify_episode(record).checks if not part.holds] == []
    assert repeat_episode(record) is None


@pytest.mark.parametrize("population", ["region", "all"])
def test_it_is_scored_like_the_model_that_it_is(folder: Path, population: str, tmp_path: Path) -> None:
    words = ["evaluate", "prediction", str(folder / "bag"), "--models=cv", "--predictions=live=/predictions"]
    assert main([*words, f"--population={population}", "--out", str(tmp_path)]) == 0
    models: Any = json.loads((tmp_path / "scores.json").read_text(encoding="utf-8"))["episodes"][0]["models"]
    assert models["live"]["samples"] == models["cv"]["samples"] > 0
    for metric in ("ade_m", "fde_m", "rmse_5s_m"):
        assert models["live"][metric] == pytest.approx(models["cv"][metric], abs=1e-12)


def test_a_bag_without_the_topic_is_refused(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "prediction", str(folder / "bag"), "--predictions=a=/predictions",
                 "--predictions=b=/predictions"]) == 2  # fmt: skip
    assert "/predictions once" in capsys.readouterr().err
    record_episode(set_up_episode(EpisodeRequest("S2", duration_s=1.0, sensors="none")), tmp_path / "plain")
    assert main(["evaluate", "prediction", str(tmp_path / "plain"), "--predictions=a=/predictions"]) == 2
    assert "a bag with the topic /predictions" in capsys.readouterr().err
