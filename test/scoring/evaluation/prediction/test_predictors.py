"""The table of predictors and what they may answer.

A predictor that looks at later frames is caught, whatever it does with them; one that looks back is not.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_records import moving, record_with

from siren_ros.errors import InputError, SirenError
from siren_ros.scoring.evaluation.prediction import predictors
from siren_ros.scoring.evaluation.prediction.baselines import ConstantVelocity
from siren_ros.scoring.evaluation.prediction.predictors import (
    CHECKED_FRAMES,
    PREDICTORS,
    CausalityError,
    Checkpoint,
    Hypotheses,
    Predictor,
    PredictorKind,
    causal_answer,
    checked,
    predictors_named,
)
from siren_ros.scoring.evaluation.prediction.samples import (
    HistoryWindow,
    Population,
    SampleBatch,
    future_offsets,
    samples_of,
)
from siren_ros.scoring.evaluation.prediction.scoring import score_episode


def equal_hypotheses(samples: int = 21, modes: int = 3) -> Hypotheses:
    return Hypotheses.ranked(np.zeros((samples, modes, 25, 2)), np.ones((samples, modes)))


def with_probability(sample: int, *values: float) -> Hypotheses:
    probability = equal_hypotheses().probability.copy()
    probability[sample] = values
    return Hypotheses(equal_hypotheses().xy_m, probability)


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
    paths = equal_hypotheses().xy_m
    with pytest.raises(InputError, match=r"model mine.*\(21, 3\)"):
        checked("mine", Hypotheses(paths, np.ones((21, 2))), 21)
    paths[[3, 9], 1, 24, 0] = np.inf
    with pytest.raises(InputError, match="not finite in 2 of 21 samples, first in 3"):
        checked("mine", Hypotheses(paths, equal_hypotheses().probability), 21)


def test_single_precision_is_precise_enough() -> None:
    probability = np.full((2, 3), 1.0 / 3.0, dtype=np.float32)
    answer = checked("mine", Hypotheses(np.zeros((2, 3, 25, 2), dtype=np.float32), probability), 2)
    assert answer.xy_m.dtype == answer.probability.dtype == np.float64


@pytest.mark.parametrize("names", [[], ["cv", "lstm"], ["cv", "cv"], ["CV"]])
def test_wrong_names_are_refused_with_what_is_known(names) -> None:
    with pytest.raises(InputError, match="models") as caught:
        predictors_named(names)
    assert "each model once" in str(caught.value) or all(name in str(caught.value) for name in PREDICTORS)


GIVEN: list[Path | None] = []
TOLD: list[int] = []


def make(checkpoint: Path | None) -> Predictor:
    """A constructor as the table names them; remembers what it was given."""
    GIVEN.append(checkpoint)
    return ConstantVelocity()


def test_a_checkpoint_goes_to_its_model(monkeypatch) -> None:
    kind = PredictorKind("a net", f"{__name__}:make", Checkpoint.REQUIRED)
    monkeypatch.setattr(predictors, "PREDICTORS", {**PREDICTORS, "net": kind})
    GIVEN.clear()
    checkpoints = {"net:a": Path("a.pt"), "net:b": Path("b.pt")}
    assert list(predictors_named(["net:b", "cv", "net:a"], checkpoints)) == ["net:b", "cv", "net:a"], "as asked for"
    assert [Path("b.pt"), Path("a.pt")] == GIVEN
    with pytest.raises(InputError, match=r"net together with --checkpoint net=PATH"):
        predictors_named(["net"])
    for name, allowed in (("cv", "a model that has weights"), ("idm", "a name among the models: cv")):
        with pytest.raises(InputError, match=rf"checkpoint: '{name}=x.pt' cannot be used; allowed: {allowed}"):
            predictors_named(["cv"], {name: Path("x.pt")})


def test_a_missing_package_is_named_with_the_command_that_brings_it() -> None:
    kind = PredictorKind("a net", "package_that_nobody_has:make", extra="models")
    with pytest.raises(InputError, match=r"package_that_nobody_has, as \./env --with models siren evaluate"):
        kind.make("net")
    with pytest.raises(ModuleNotFoundError):
        PredictorKind("a net", "package_that_nobody_has:make").make("net")


@pytest.fixture(scope="module")
def record(straight_road):
    tracks = {1: moving(0.0, -5.25, 5.0, 0.4, steps=239), 2: moving(30.0, -5.25, 8.0, -0.3, steps=239)}
    return record_with({**tracks, 3: moving(5.0, -1.75, 9.0, is_emv=True, steps=239)}, straight_road)


@dataclass(frozen=True)
class Cheat:
    """Copies later frames of the same vehicle where there are some, else keeps the velocity."""

    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        actors = batch.actors
        place = {
            (int(batch.step[f]), int(a)): row
            for row, (f, a) in enumerate(zip(actors.frame, actors.actor_id, strict=True))
        }
        xy_m = predictors_named(["cv"])["cv"].predict(batch).xy_m[:, 0].copy()
        for number, (step, actor) in enumerate(zip(batch.sample_step, batch.actor_id, strict=True)):
            for point, offset in enumerate(future_offsets().tolist()):
                row = place.get((int(step) + 2 * offset, int(actor)))
                if row is not None:
                    xy_m[number, point] = actors.xy_m[row, -1]
        return Hypotheses.certain(xy_m)


@dataclass(frozen=True)
class Memory:
    """Looks back: the velocity of a vehicle is the mean over all frames up to the present. Tells single frames."""

    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        frame, actor = batch.actors.frame, batch.actors.actor_id
        if len(batch.step) == 1:
            TOLD.append(int(batch.step[0]))
        means = [
            batch.actors.velocity_mps[(actor == actor[row]) & (frame <= frame[row]), -1].mean(axis=0)
            for row in batch.target
        ]
        return Hypotheses.certain(batch.xy_m[:, None] + 0.2 * np.arange(1, 26)[:, None] * np.array(means)[:, None])


def test_a_predictor_may_look_back_and_frames_are_drawn_anew_in_each_run(record) -> None:
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    runs = []
    for _ in range(4):
        TOLD.clear()
        answer, frames = causal_answer("memory", Memory(), batch)
        assert frames == CHECKED_FRAMES == len(TOLD)
        assert (answer.xy_m == Memory().predict(batch).xy_m).all()
        assert sorted(TOLD) == TOLD
        runs.append(tuple(TOLD))
    assert len(set(runs)) > 1


@dataclass
class Dice:
    """Another answer each time."""

    window: HistoryWindow = field(default_factory=HistoryWindow)
    random: np.random.Generator = field(default_factory=lambda: np.random.default_rng(1))

    def predict(self, batch: SampleBatch) -> Hypotheses:
        return Hypotheses.certain(batch.xy_m[:, None] + self.random.normal(size=(len(batch), 25, 2)))


@pytest.mark.parametrize("cheat", [Cheat(), Dice()])
def test_a_predictor_that_sees_later_frames_or_throws_dice_fails(cheat, record) -> None:
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    with pytest.raises(CausalityError, match="model cheat") as caught:
        causal_answer("cheat", cheat, batch)
    assert isinstance(caught.value, SirenError)
    assert caught.value.exit_code == 2
    with pytest.raises(CausalityError):
        score_episode("an episode", record, {"cheat": cheat}, Population.ALL)


@dataclass
class Remembers:
    """A cheat that answers honestly where it has been asked about one frame before, and looks ahead elsewhere."""

    window: HistoryWindow = field(default_factory=HistoryWindow)
    asked: set[int] = field(default_factory=set)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        honest, ahead = predictors_named(["cv"])["cv"].predict(batch), Cheat().predict(batch)
        if len(batch.step) == 1:
            self.asked.add(int(batch.step[0]))
            return honest
        known = np.isin(batch.sample_step, list(self.asked))
        return Hypotheses(np.where(known[:, None, None, None], honest.xy_m, ahead.xy_m), ahead.probability)


def test_a_cheat_with_a_memory_fails_too(record) -> None:
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    for seed in range(5):
        with pytest.raises(CausalityError):
            causal_answer("memory", Remembers(), batch, np.random.default_rng(seed))


@pytest.mark.parametrize("model", PREDICTORS)
def test_every_predictor_of_the_project_passes(model, record, tmp_path) -> None:
    checkpoints = {}
    if PREDICTORS[model].checkpoint is Checkpoint.REQUIRED:
        pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")
        from plain_networks import drawn_weights

        checkpoints = drawn_weights(model, tmp_path)
    predictor = predictors_named([model], checkpoints)[model]
    batch = samples_of(record, predictor.window, Population.ALL).batch
    assert causal_answer(model, predictor, batch)[1] == CHECKED_FRAMES


def test_equally_probable_hypotheses_may_change_places(record) -> None:
    @dataclass(frozen=True)
    class Fork:
        window: HistoryWindow = field(default_factory=HistoryWindow)

        def predict(self, batch: SampleBatch) -> Hypotheses:
            ways = batch.xy_m[:, None, None] + np.array([-1.0, 1.0])[:, None, None] * np.ones((2, 25, 2))
            return Hypotheses(ways[:, ::-1] if len(batch.step) > 1 else ways, np.full((len(batch), 2), 0.5))

    assert causal_answer("fork", Fork(), samples_of(record, HistoryWindow(), Population.ALL).batch)[1] == CHECKED_FRAMES


def test_without_later_frames_nothing_can_be_checked(straight_road) -> None:
    batch = samples_of(
        record_with({1: moving(0.0, -5.25, 5.0, steps=161)}, straight_road), HistoryWindow(), Population.ALL
    ).batch
    assert causal_answer("cheat", Cheat(), batch)[1] == 0
