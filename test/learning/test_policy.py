import hashlib
from dataclasses import asdict
from pathlib import Path

import pytest

pytest.importorskip("gymnasium", reason="the extra learn is not installed")
onnx = pytest.importorskip("onnx", reason="the extra models is not installed")

import numpy as np
from made_moment import moment_of

from siren_ros.errors import InputError
from siren_ros.evaluation.network_file import write_network
from siren_ros.learning.features import SIZE
from siren_ros.learning.policy import INPUT, OUTPUT, open_policy
from siren_ros.learning.task import Task


def written(path: Path, size: int = SIZE, **task: object) -> Path:
    """A network whose outputs are the first five numbers of the observation."""
    weights = np.eye(size, 5, dtype=np.float32)
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        [helper.make_node("MatMul", [INPUT, "w"], [OUTPUT])],
        "first",
        [helper.make_tensor_value_info(INPUT, kind, ["n", size])],
        [helper.make_tensor_value_info(OUTPUT, kind, ["n", 5])],
        [onnx.numpy_helper.from_array(weights, "w")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    content = model.SerializeToString()
    card = {"sha256": hashlib.sha256(content).hexdigest(), "task": asdict(Task(**task))}
    write_network(path, content, card)
    return path


def test_a_policy_takes_the_greatest_of_its_outputs(tmp_path: Path) -> None:
    policy = open_policy(written(tmp_path / "driver.onnx", template="S3"))
    observation = np.zeros(SIZE, np.float32)
    for action in (3, 1):
        observation[:5] = 0.0
        observation[action] = 0.5
        assert policy(observation, moment_of()) == action
    assert policy.task == Task(template="S3")


def test_a_network_for_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="106 numbers"):
        open_policy(written(tmp_path / "small.onnx", size=40))
    with pytest.raises(InputError, match="for manoeuvres"):
        open_policy(written(tmp_path / "pedals.onnx", action="continuous"))
