"""A study next to reality, and models of civilians, from the command line."""

import json

import numpy as np

from siren_ros.cli.main import main
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.scoring.evaluation.realism.sim_agent_scenes import SIM_AGENTS, constant_velocity, scenes_of


def test_a_folder_of_bags_is_held_against_the_ledger_and_tracks(write_bag, tmp_path, siren) -> None:
    write_bag(tmp_path / "study" / "bag", duration_s=12.0)
    tracks = tmp_path / "tracks.csv"
    head = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
    rows = (f"{car},{k},{100 * k},Car,{6.3 * car},0,0,0,0,4.5,1.8" for car in range(3) for k in range(40))
    tracks.write_text("\n".join([head, *rows]) + "\n")
    page, out = tmp_path / "page.html", tmp_path / "realism.json"
    words = ["evaluate", "realism", str(tmp_path / "study"), "--tracks", str(tracks), "--workers", "1"]
    printed = siren([*words, "--html", str(page), "--out", str(out)]).out
    assert "lines" in printed
    assert "standing_gap_m" in printed
    content = json.loads(out.read_text())
    assert content["task"] == "realism"
    real = next(one["real"] for one in content["distributions"] if one["quantity"] == "standing_gap_m")
    assert real["samples"] == 2
    assert abs(real["p50"] - 1.8) < 1e-6
    html = page.read_text()
    assert "Published figures" in html
    assert "Ordinary traffic" in html
    assert "html" in siren([*words, "--html", str(tmp_path / "page.txt")], 2).err
    assert "missing" in siren([*words, "--tracks", str(tmp_path / "missing")], 2).err


def test_models_of_civilians_are_scored_in_their_order(write_bag, tmp_path, siren) -> None:
    bag = tmp_path / "bag"
    write_bag(bag, duration_s=12.0)
    scenes = list(scenes_of(read_episode(bag)))
    assert scenes
    folder = tmp_path / "rollouts" / "bag"
    folder.mkdir(parents=True)
    for scene in scenes:
        np.save(folder / f"{scene.first_frame}.npy", constant_velocity(scene, np.random.default_rng(0)))
    out = tmp_path / "scores.json"
    words = ["evaluate", "sim-agents", str(bag), "--rollouts", str(folder.parent), "--out", str(out), "--workers", "1"]
    siren(words)
    (episode,) = json.loads(out.read_text())["episodes"]
    scores = {name: means["score"] for name, means in episode["models"].items()}
    assert scores["random"] < scores["constant_velocity"] < scores["log_resampled"]
    assert scores["rollouts"] == scores["constant_velocity"]
    assert set(scores) == {*SIM_AGENTS, "rollouts"}
    (folder / "0.npy").write_bytes(b"none")
    assert main(words) == 2, "of another shape"
    (folder / "0.npy").unlink()
    assert main(words) == 2, "missing"
