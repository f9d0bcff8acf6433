"""The program that lets OpenPCDet read the nuScenes export, on a file with the lines that it looks for."""

import json
import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from repository import REPOSITORY

PROGRAM = REPOSITORY / "examples" / "openpcdet_version.py"
CODE = """
def ended(self):
    if self.VERSION == 'v1.0-test':
        return True
    return False

def scenes(version, data_path):
    data_path = data_path / version
    assert version in ['v1.0-trainval', 'v1.0-test', 'v1.0-mini']
    if version == 'v1.0-mini':
        train_scenes, val_scenes = ['a'], ['b']
    else:
        raise NotImplementedError
    return train_scenes, val_scenes
"""


def run(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, str(PROGRAM)], cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    file = tmp_path / "pcdet" / "datasets" / "nuscenes" / "nuscenes_dataset.py"
    file.parent.mkdir(parents=True)
    file.write_text(CODE)
    return file


def test_the_changed_code_reads_the_splits_of_the_export(checkout: Path, tmp_path: Path) -> None:
    assert run(tmp_path).returncode == 0
    once = checkout.read_text()
    assert run(tmp_path).returncode == 0, "a second run changes nothing"
    assert checkout.read_text() == once
    tables = tmp_path / "v1.0-siren" / "v1.0-siren"
    tables.mkdir(parents=True)
    (tables / "splits.json").write_text(json.dumps({"siren_train": ["t"], "siren_val": ["v"], "siren_test": []}))
    code = runpy.run_path(str(checkout))
    assert code["scenes"]("v1.0-siren", tmp_path) == (["t"], ["v"])
    assert code["scenes"]("v1.0-mini", tmp_path) == (["a"], ["b"])
    for version, over in (("v1.0-siren", True), ("v1.0-test", True), ("v1.0-mini", False)):
        assert code["ended"](SimpleNamespace(VERSION=version)) is over


def test_another_state_of_the_code_is_left_alone(checkout: Path, tmp_path: Path) -> None:
    checkout.write_text(CODE.replace("NotImplementedError", "KeyError"))
    answer = run(tmp_path)
    assert answer.returncode == 1
    assert "change it by hand" in answer.stderr
    assert "v1.0-siren" not in checkout.read_text()
    checkout.unlink()
    assert run(tmp_path).returncode == 1
