from pathlib import Path

import pytest

from siren_ros.errors import InputError
from siren_ros.evaluation.prediction import predictors
from siren_ros.evaluation.prediction.baselines.constant_velocity import ConstantVelocity
from siren_ros.evaluation.prediction.predictors import PREDICTORS, Checkpoint, PredictorKind, predictors_named
from siren_ros.evaluation.prediction.protocol.predictor import Predictor, PredictorOptions


def test_models_come_in_the_order_asked_for() -> None:
    assert list(predictors_named(["idm", "cv"])) == ["idm", "cv"]


@pytest.mark.parametrize("names", [[], ["cv", "lstm"], ["cv", "cv"], ["CV"]])
def test_wrong_names_are_refused_with_what_is_known(names: list[str]) -> None:
    with pytest.raises(InputError, match="models") as caught:
        predictors_named(names)
    assert "each model once" in str(caught.value) or all(name in str(caught.value) for name in PREDICTORS)


GIVEN: list[Path | None] = []


def make(options: PredictorOptions) -> Predictor:
    """A constructor as the table names them; remembers what it was given."""
    GIVEN.append(options.checkpoint)
    return ConstantVelocity()


def test_a_checkpoint_goes_to_its_model(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = PredictorKind("a net", f"{__name__}:make", Checkpoint.REQUIRED)
    monkeypatch.setattr(predictors, "PREDICTORS", {**PREDICTORS, "net": kind})
    GIVEN.clear()
    checkpoints = {"net:a": Path("a.pt"), "net:b": Path("b.pt")}
    assert list(predictors_named(["net:b", "cv", "net:a"], checkpoints)) == ["net:b", "cv", "net:a"]
    assert [Path("b.pt"), Path("a.pt")] == GIVEN
    with pytest.raises(InputError, match=r"net together with --checkpoint net=PATH"):
        predictors_named(["net"])


@pytest.mark.parametrize(("name", "told"), [("cv", "a model that has weights"), ("idm", "a name among the models: cv")])
def test_a_checkpoint_that_fits_no_model_is_refused(name: str, told: str) -> None:
    with pytest.raises(InputError, match=rf"checkpoint: '{name}=x.pt' cannot be used; allowed: {told}"):
        predictors_named(["cv"], {name: Path("x.pt")})


def test_a_missing_package_is_told_with_the_command_that_brings_it() -> None:
    kind = PredictorKind("a net", "package_that_nobody_has:make", extra="models")
    with pytest.raises(InputError, match=r"package_that_nobody_has, as \./env --with models siren evaluate"):
        kind.make("net", PredictorOptions())
    with pytest.raises(ModuleNotFoundError):
        PredictorKind("a net", "package_that_nobody_has:make").make("net", PredictorOptions())
