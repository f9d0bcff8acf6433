"""Small data for the tests of the training."""

import sys

import pytest
from hand_made import made_record

from siren_ros.scenario.splits import Split
from siren_ros.training.prediction.samples import features_of_record, write_features

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
