import hashlib
from pathlib import Path

import pytest

onnx = pytest.importorskip("onnx", reason="the extra models is not installed")

import numpy as np
from seen_on_crossing import sight_at

from siren_ros.base.params.plain_files import write_network
from siren_ros.errors import InputError
from siren_ros.running.seat.drivers import learned
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.drivers.learned import INPUT, OUTPUT, LearnedState
from siren_ros.running.seat.policy import EMV, OWN, VECTOR_SIZE, Manoeuvre
from siren_ros.running.seat.sight import Sight

HERE, BEHIND = (len(OWN) + [feature.name for feature in EMV].index(name) for name in ("emv_here", "emv_behind"))
TASK = {"observation": "vector", "action": "manoeuvre", "decision_s": 0.5}


def written(
    path: Path,
    size: int = VECTOR_SIZE,
    outputs: int = len(Manoeuvre),
    weight: float = 1.0,
    rows: tuple[int, ...] = (BEHIND,),
    **task: object,
) -> Path:
    """A network that pulls over while an EMV comes from behind, and keeps its lane else."""
    weights = np.zeros((size, outputs), np.float32)
    weights[np.minimum(rows, size - 1), min(Manoeuvre.PULL_OVER, outputs - 1)] = weight
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        [helper.make_node("MatMul", [INPUT, "w"], [OUTPUT])],
        "pulls_over",
        [helper.make_tensor_value_info(INPUT, kind, ["n", size])],
        [helper.make_tensor_value_info(OUTPUT, kind, ["n", outputs])],
        [onnx.numpy_helper.from_array(weights, "w")],
    )
    opsets = [onnx.helper.make_opsetid("", 17)]
    return with_card(path, onnx.helper.make_model(graph, opset_imports=opsets, ir_version=9), {**TASK, **task})


def with_card(path: Path, model: onnx.ModelProto, task: object) -> Path:
    content = model.SerializeToString()
    write_network(path, content, {"sha256": hashlib.sha256(content).hexdigest(), "task": task})
    return path


LOGITS = f"float[1, {len(Manoeuvre)}]"
ENDLESS = f"""<ir_version: 9, opset_import: ["" : 17]>
endless (float[1, {VECTOR_SIZE}] {INPUT}) => ({LOGITS} {OUTPUT}) {{
  shape = Constant <value_ints = [1, {len(Manoeuvre)}]> ()
  first = ConstantOfShape (shape)
  times = Constant <value_int = {1 << 62}> ()
  yes = Constant <value = bool {{1}}> ()
  {OUTPUT} = Loop (times, yes, first) <body = step (int64 i, bool go_in, {LOGITS} sum_in) => (bool go, {LOGITS} sum) {{
    go = Identity (go_in)
    sum = Add (sum_in, sum_in)
  }}>
}}"""
"""A network that adds zero to itself 2^62 times before it answers, as ONNX's text."""


def at(step: int, **known: float) -> Sight:
    sight = sight_at(**known)
    return Sight(**{**vars(sight), "step": step})


def test_the_rule_and_the_greatest_output_of_a_network_choose_the_manoeuvre(tmp_path: Path) -> None:
    for name in (str(written(tmp_path / "driver.onnx")), "pulls-over"):
        driver = driver_of(name)
        for emv_m, manoeuvre in ((20.0, Manoeuvre.PULL_OVER), (80.0, Manoeuvre.KEEP)):
            state, _ = driver.step(driver.start, at(7, emv_m=emv_m))
            assert (state.aim.manoeuvre, state.decided) == (manoeuvre, 7)


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
        with pytest.raises(InputError, match=f"{VECTOR_SIZE} numbers"):
            driver_of(str(written(tmp_path / f"{name}.onnx", **wrong)))


def test_outputs_that_become_infinite_later_are_refused_at_that_step(tmp_path: Path) -> None:
    driver = driver_of(str(written(tmp_path / "driver.onnx", weight=3e38, rows=(HERE, BEHIND))))
    with pytest.raises(InputError, match="finite numbers"):
        driver.step(driver.start, at(7, emv_m=20.0))


@pytest.mark.parametrize(
    "wrong", [{"outputs": len(Manoeuvre) - 1}, {"outputs": len(Manoeuvre) + 1}, {"weight": float("nan")}]
)
def test_another_number_of_outputs_and_weights_that_are_no_numbers_are_refused(tmp_path: Path, wrong) -> None:
    """The greatest of outputs that are NaN is the first one: such a driver kept its lane and passed."""
    with pytest.raises(InputError, match=f"{len(Manoeuvre)} finite numbers"):
        driver_of(str(written(tmp_path / "driver.onnx", **wrong)))


@pytest.mark.parametrize("decision_s", [float("nan"), "often", None, [0.5], 0.0, 61.0])
def test_a_card_without_a_usable_time_is_refused(tmp_path: Path, decision_s: object) -> None:
    with pytest.raises(InputError, match=r"task\.decision_s from 0\.05 to 60 s"):
        driver_of(str(written(tmp_path / "driver.onnx", decision_s=decision_s)))


@pytest.mark.parametrize("task", [[], None])
def test_a_card_whose_task_is_no_mapping_is_refused(tmp_path: Path, task: object) -> None:
    path = written(tmp_path / "driver.onnx")
    content = path.read_bytes()
    write_network(path, content, {"sha256": hashlib.sha256(content).hexdigest(), "task": task})
    with pytest.raises(InputError, match=f"{VECTOR_SIZE} numbers"):
        driver_of(str(path))


def test_a_network_that_does_not_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learned, "DECISION_LIMIT_S", 0.2)
    with pytest.raises(InputError, match=r"did not end within 0\.2 s"):
        driver_of(str(with_card(tmp_path / "driver.onnx", onnx.parser.parse_model(ENDLESS), TASK)))
