"""Which networks are taken for detectors, and what becomes of what they answer."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.detection.pillars import network_file
from siren_ros.evaluation.detection.pillars.detector import SHIPPED, detector_file
from siren_ros.evaluation.detection.pillars.grid import PillarGrid, class_of
from siren_ros.evaluation.detection.pillars.network_file import BOX_COLUMNS, DetectorNetwork, load_detector
from siren_ros.evaluation.detection.pillars.pillars import FEATURES, Pillars
from siren_ros.params.resources import params_dir
from siren_ros.world.actors import ActorClass

GRID = PillarGrid(half_width_m=8.0, cells=16, points=4, pillars=50)
CARD = {"form_version": 1, "grid": GRID.to_json(), "class_names": ["car", "police"]}


def loaded(monkeypatch: pytest.MonkeyPatch, card: dict[str, Any], *inputs: tuple[str, list[Any]]) -> DetectorNetwork:
    """A network of a card and of inputs with their shapes."""
    asked = inputs or (("points", ["P", 4, len(FEATURES)]), ("cell", ["P"]))
    session = SimpleNamespace(get_inputs=lambda: [SimpleNamespace(name=name, shape=shape) for name, shape in asked])
    monkeypatch.setattr(network_file, "open_network", lambda _: SimpleNamespace(card=card, session=session))
    return load_detector(Path("a.onnx"))


def test_a_detector_has_the_grid_and_the_names_of_its_card(monkeypatch: pytest.MonkeyPatch) -> None:
    found = loaded(monkeypatch, CARD)
    assert (found.grid, found.class_names) == (GRID, ("car", "police"))


@pytest.mark.parametrize("change", [{"form_version": 2}, {"form_version": None}, {"grid": None}, {"grid": [8.0]}])
def test_another_form_is_refused(monkeypatch: pytest.MonkeyPatch, change: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="a detector of form 1"):
        loaded(monkeypatch, {**CARD, **change})


@pytest.mark.parametrize(
    "inputs",
    [
        (("points", ["P", 5, 10]), ("cell", ["P"])),
        (("points", ["P", 4, 9]), ("cell", ["P"])),
        (("cell", ["P"]), ("points", ["P", 4, 10])),
        (("points", ["P", 4, 10]),),
    ],
)
def test_inputs_of_another_grid_are_refused(monkeypatch: pytest.MonkeyPatch, inputs: Any) -> None:
    with pytest.raises(InputError, match="inputs points, cell"):
        loaded(monkeypatch, CARD, *inputs)


@pytest.mark.parametrize(
    "change", [{"cells": 0}, {"half_width_m": -1.0}, {"points": 0}, {"low_m": 3.0}, {"high_m": -5.0}, {"more": 1}]
)
def test_grids_of_no_use_are_refused(change: dict[str, Any]) -> None:
    assert PillarGrid.from_json(GRID.to_json()) == GRID
    assert GRID.cell_m == 1.0
    with pytest.raises(InputError, match="card"):
        PillarGrid.from_json({**GRID.to_json(), **change})


def test_answers_are_in_double_precision_and_nothing_is_asked_of_nothing() -> None:
    asked: list[dict[str, Any]] = []

    def run(outputs: tuple[str, ...], given: dict[str, Any]) -> tuple[np.ndarray, ...]:
        asked.append(given)
        values = {"box": np.ones((2, 10)), "score": np.array([0.9, 0.1]), "class_share": np.ones((2, 2))}
        return tuple(values[name].astype(np.float32) for name in outputs)

    network = DetectorNetwork(SimpleNamespace(run=run), CARD, GRID, ("car", "police"))
    nothing = Pillars(np.zeros((0, 4, 10), dtype=np.float32), np.zeros(0, dtype=np.int64))
    assert [part.shape for part in network.run(nothing)] == [(0, len(BOX_COLUMNS)), (0,), (0, 2)]
    assert asked == []
    given = Pillars(np.ones((3, 4, 10), dtype=np.float32), np.array([5, 6, 9]))
    box, score, share = network.run(given)
    assert (box.shape, score.tolist(), share.shape) == ((2, 10), pytest.approx([0.9, 0.1]), (2, 2))
    assert {part.dtype for part in (box, score, share)} == {np.dtype(np.float64)}
    assert asked[0]["points"] is given.points
    assert asked[0]["cell"] is given.cell


def test_a_detector_is_one_that_ships_or_a_file() -> None:
    assert detector_file("pillars") == params_dir() / SHIPPED
    assert detector_file("pillars").is_file()
    assert detector_file("mine/pillars.onnx") == Path("mine/pillars.onnx")


def test_classes_without_a_name_of_their_own_are_cars() -> None:
    names = ["car", "ambulance", "fire_truck", "police"]
    assert [names[class_of(member)] for member in (ActorClass.SEDAN, ActorClass.BUS, ActorClass.AMBULANCE)] == [
        "car", "car", "ambulance"
    ]  # fmt: skip
    assert names[class_of(ActorClass.POLICE)] == "police"
