from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from siren_ros.errors import InputError
from siren_ros.scoring.evaluation.prediction import predictors
from siren_ros.scoring.evaluation.prediction.baselines import ConstantVelocity
from siren_ros.scoring.evaluation.prediction.predictors import (
    PREDICTORS,
    Checkpoint,
    Hypotheses,
    Predictor,
    PredictorKind,
    checked,
    predictors_named,
)


def equal_hypotheses(samples: int = 21, modes: int = 3) -> Hypotheses:
    return Hypotheses.ranked(np.zeros((samples, modes, 25, 2)), np.ones((samples, modes)))


def with_probability(sample: int, *values: float) -> Hypotheses:
    probability = equal_hypotheses().probability.copy()
    probability[sample] = values
    return Hypotheses(equal_hypotheses().xy_m, probability)


def test_a_certain_path_has_probability_one() -> None:
    answer = Hypotheses.certain(np.zeros((4, 25, 2)))
    assert answer.xy_m.shape == (4, 1, 25, 2)
    assert answer.probability.tolist() == [[1.0]] * 4
    assert len(checked("mine", answer, 4)) == 4


def test_ranked_paths_go_with_their_probabilities() -> None:
    paths = np.arange(3.0)[None, :, None, None] * np.ones((1, 3, 25, 2))
    answer = Hypotheses.ranked(paths, np.array([[1.0, 6.0, 1.0]]))
    assert answer.xy_m[0, :, 0, 0].tolist() == [1.0, 0.0, 2.0], "equal ones keep their order"
    assert answer.probability[0].tolist() == [0.75, 0.125, 0.125]


@given(seed=st.integers(0, 1000), modes=st.integers(1, 8))
def test_whatever_is_ranked_can_be_scored(seed, modes) -> None:
    rng = np.random.default_rng(seed)
    answer = Hypotheses.ranked(rng.normal(size=(5, modes, 25, 2)), rng.uniform(1e-6, 5.0, (5, modes)))
    assert np.array_equal(checked("mine", answer, 5).xy_m, answer.xy_m)


@pytest.mark.parametrize("shape", [(21, 25, 2), (20, 1, 25, 2), (21, 0, 25, 2), (21, 1, 30, 2), (21, 1, 25, 3)])
def test_other_shapes_are_refused(shape) -> None:
    with pytest.raises(InputError, match=r"model mine.*\(21, k, 25, 2\)"):
        checked("mine", Hypotheses(np.zeros(shape), np.ones(shape[:2])), 21)


def test_probabilities_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match=r"model mine.*\(21, 3\)"):
        checked("mine", Hypotheses(equal_hypotheses().xy_m, np.ones((21, 2))), 21)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((0.5, 0.5, 0.5), "another sum"),
        ((0.2, 0.3, 0.5), "increase"),
        ((1.5, 0.0, -0.5), "negative"),
        ((np.nan, 0.5, 0.5), "not finite"),
    ],
)
def test_wrong_probabilities_are_refused_with_their_number_and_the_first(values, message) -> None:
    with pytest.raises(InputError, match=rf"{message}.* in 1 of 21 samples, first in 7"):
        checked("mine", with_probability(7, *values), 21)


def test_positions_that_are_not_finite_are_refused() -> None:
    paths = equal_hypotheses().xy_m.copy()
    paths[[3, 9], 1, 24, 0] = np.inf
    with pytest.raises(InputError, match="not finite in 2 of 21 samples, first in 3"):
        checked("mine", Hypotheses(paths, equal_hypotheses().probability), 21)


def test_single_precision_is_precise_enough() -> None:
    probability = np.full((2, 3), 1.0 / 3.0, dtype=np.float32)
    answer = checked("mine", Hypotheses(np.zeros((2, 3, 25, 2), dtype=np.float32), probability), 2)
    assert answer.xy_m.dtype == answer.probability.dtype == np.float64


def test_models_come_in_the_order_asked_for() -> None:
    assert list(predictors_named(["idm", "cv"])) == ["idm", "cv"]


@pytest.mark.parametrize("names", [[], ["cv", "lstm"], ["cv", "cv"], ["CV"]])
def test_wrong_names_are_refused_with_what_is_known(names) -> None:
    with pytest.raises(InputError, match="models") as caught:
        predictors_named(names)
    assert "each model once" in str(caught.value) or all(name in str(caught.value) for name in PREDICTORS)


GIVEN: list[Path | None] = []


def make(checkpoint: Path | None) -> Predictor:
    """A constructor as the table names them; remembers what it was given."""
    GIVEN.append(checkpoint)
    return ConstantVelocity()


def test_a_checkpoint_goes_to_its_model(monkeypatch) -> None:
    kind = PredictorKind("a net", f"{__name__}:make", Checkpoint.REQUIRED)
    monkeypatch.setattr(predictors, "PREDICTORS", {**PREDICTORS, "net": kind})
    GIVEN.clear()
    checkpoints = {"net:a": Path("a.pt"), "net:b": Path("b.pt")}
    assert list(predictors_named(["net:b", "cv", "net:a"], checkpoints)) == ["net:b", "cv", "net:a"]
    assert [Path("b.pt"), Path("a.pt")] == GIVEN
    with pytest.raises(InputError, match=r"net together with --checkpoint net=PATH"):
        predictors_named(["net"])


@pytest.mark.parametrize(
    ("name", "allowed"), [("cv", "a model that has weights"), ("idm", "a name among the models: cv")]
)
def test_a_checkpoint_that_fits_no_model_is_refused(name, allowed) -> None:
    with pytest.raises(InputError, match=rf"checkpoint: '{name}=x.pt' cannot be used; allowed: {allowed}"):
        predictors_named(["cv"], {name: Path("x.pt")})


def test_a_missing_package_is_named_with_the_command_that_brings_it() -> None:
    kind = PredictorKind("a net", "package_that_nobody_has:make", extra="models")
    with pytest.raises(InputError, match=r"package_that_nobody_has, as \./env --with models siren evaluate"):
        kind.make("net")
    with pytest.raises(ModuleNotFoundError):
        PredictorKind("a net", "package_that_nobody_has:make").make("net")
