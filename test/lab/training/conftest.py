"""Small data for the tests of the training."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from datasets.made_bag import BagSpec, write_made_bag
from evaluation.made_video_sets import draw_films, small_video_set
from made_training_data import made_record
from rosbags.typesys.store import Typestore

from siren_ros.cli.main import main
from siren_ros.lab.training.prediction.samples import features_of_record, write_features
from siren_ros.scoring.evaluation.risk.video_set import write_set
from siren_ros.simulation.scenario.episode import Split

# CUDA builds of torch import triton with the first optimizer. Its LLVM crashes where Mesa's is loaded already, as by
# the tests of the cameras in the same process; nothing here runs on a GPU.
sys.modules.setdefault("triton", None)  # type: ignore[arg-type] # such a module cannot be imported


@pytest.fixture(scope="session")
def episode_files(tmp_path_factory):
    """Files of six training episodes and two that judge."""
    folder = tmp_path_factory.mktemp("features")
    files = {
        split: [folder / f"{split}_{seed}.npz" for seed in seeds]
        for split, seeds in ((Split.TRAIN, range(6)), (Split.TEST_SEED, range(10, 12)))
    }
    for split, paths in files.items():
        for seed, path in enumerate(paths, 10 if split is Split.TEST_SEED else 0):
            write_features(path, features_of_record(made_record(seed, f"S{1 + seed % 2}"), split))
    return files


@pytest.fixture(scope="session")
def drives(tmp_path_factory: pytest.TempPathFactory, typestore: Typestore) -> list[Path]:
    """Two drives of 13.1 s without sensors, one for training and one for validation (``params/splits.yaml``)."""
    folder = tmp_path_factory.mktemp("drives")
    return [
        write_made_bag(folder / f"{seed}", typestore, BagSpec(steps=262, sensed=False, seed=seed)) for seed in (0, 23)
    ]


@pytest.fixture(scope="session")
def video_set_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six videos with pictures."""
    folder = tmp_path_factory.mktemp("set")
    videos = small_video_set(folder)
    on_town = {key: replace(item, request={**item.request, "map": ""}) for key, item in videos.videos.items()}
    folder.joinpath("videos").mkdir()
    write_set(replace(videos, videos=on_town))
    draw_films(folder)
    return folder


@pytest.fixture(scope="session")
def packed(
    tmp_path_factory: pytest.TempPathFactory, typestore: Typestore, drives: list[Path], video_set_folder: Path
) -> Callable[[str], Path]:
    """The folder that the command packs for a task; once for all tests."""
    folder = tmp_path_factory.mktemp("packed")
    sources = {
        "prediction": lambda: drives,
        "detection": lambda: [
            write_made_bag(folder / f"seed{seed}", typestore, BagSpec(steps=42, seed=seed)) for seed in (0, 1)
        ],
        "risk": lambda: [video_set_folder],
    }

    def pack(task: str) -> Path:
        out = folder / task
        if not out.exists():
            options = ["--workers", "1"] if task != "risk" else []
            assert main(["pack", task, *map(str, sources[task]()), "--out", str(out), *options]) == 0
            assert json.loads((out / "dataset.json").read_text())["counts"]["samples"] > 0
        return out

    return pack
