import hashlib
from pathlib import Path

import pytest

onnx = pytest.importorskip("onnx", reason="the extra models is not installed")

import numpy as np
from seen_on_crossing import sight_at

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import write_network
from siren_ros.seat.drivers.drivers import driver_of
from siren_ros.seat.drivers.learned import INPUT, OUTPUT, LearnedState
from siren_ros.seat.features import EMV, OWN, SIZE
from siren_ros.seat.manoeuvres import Manoeuvre
from siren_ros.seat.sight import Sight

BEHIND = len(OWN) + [feature.name for feature in EMV].index("emv_behind")
TASK = {"observation": "vector", "action": "manoeuvre", "decision_s": 0.5}


def written(path: Path, size: int = SIZE, **task: object) -> Path:
    """A network that pulls over while an EMV comes from behind, and keeps its lane else."""
    weights = np.zeros((size, len(Manoeuvre)), np.float32)
    weights[min(BEHIND, size - 1), Manoeuvre.PULL_OVER] = 1.0
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        [helper.make_node("MatMul", [INPUT, "w"], [OUTPUT])],
        "pulls_over",
        [helper.make_tensor_value_info(INPUT, kind, ["n", size])],
        [helper.make_tensor_value_info(OUTPUT, kind, ["n", len(Manoeuvre)])],
        [onnx.numpy_helper.from_array(weights, "w")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    content = model.SerializeToString()
    write_network(path, content, {"sha256": hashlib.sha256(content).hexdigest(), "task": {**TASK, **task}})
    return path


def at(step: int, **known: float) -> Sight:
    sight = sight_at(**known)
    return Sight(**{**vars(sight), "step": step})


def test_it_chooses_the_manoeuvre_with_the_greatest_output(tmp_path: Path) -> None:
    driver = driver_of(str(written(tmp_path / "driver.onnx")))
    for emv_m, manoeuvre in ((20.0, Manoeuvre.PULL_OVER), (80.0, Manoeuvre.KEEP)):
        state, _ = driver.step(driver.start, at(7, emv_m=emv_m))
        assert state.aim.manoeuvre is manoeuvre
        assert state.decided == 7


def test_it_decides_as_often_as_it_did_when_it_learned(tmp_path: Path) -> None:
    driver = driver_of(str(written(tmp_path / "driver.onnx")))
    state, _ = driver.step(driver.start, at(3))
    kept: LearnedState = state
    for step in range(4, 13):
        kept, _ = driver.step(kept, at(step, emv_m=80.0))
        assert kept == state
    kept, _ = driver.step(kept, at(13, emv_m=80.0))
    assert kept.aim.manoeuvre is Manoeuvre.KEEP


def test_a_network_for_something_else_is_refused(tmp_path: Path) -> None:
    for name, wrong in (
        ("small", {"size": 40}),
        ("pedals", {"action": "continuous"}),
        ("raster", {"observation": "raster"}),
    ):
        with pytest.raises(InputError, match=f"{SIZE} numbers"):
            driver_of(str(written(tmp_path / f"{name}.onnx", **wrong)))
