"""A predictor that looks at later frames is caught, whatever it does with them; one that looks back is not."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from made_records import moving, record_with

from siren_ros.errors import SirenError
from siren_ros.scoring.evaluation.prediction.causality import CHECKED_FRAMES, CausalityError, causal_answer
from siren_ros.scoring.evaluation.prediction.predictors import PREDICTORS, Checkpoint, Hypotheses, predictors_named
from siren_ros.scoring.evaluation.prediction.samples import (
    HistoryWindow,
    Population,
    SampleBatch,
    future_offsets,
    samples_of,
)
from siren_ros.scoring.evaluation.prediction.scoring import score_episode


@pytest.fixture(scope="module")
def record(straight_road):
    tracks = {1: moving(0.0, -5.25, 5.0, 0.4, steps=299), 2: moving(30.0, -5.25, 8.0, -0.3, steps=299)}
    return record_with({**tracks, 3: moving(5.0, -1.75, 9.0, is_emv=True, steps=299)}, straight_road)


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
    """Looks back: the velocity of a vehicle is the mean over all frames up to the present."""

    window: HistoryWindow = field(default_factory=HistoryWindow)

    def predict(self, batch: SampleBatch) -> Hypotheses:
        frame, actor = batch.actors.frame, batch.actors.actor_id
        means = [
            batch.actors.velocity_mps[(actor == actor[row]) & (frame <= frame[row]), -1].mean(axis=0)
            for row in batch.target
        ]
        return Hypotheses.certain(batch.xy_m[:, None] + 0.2 * np.arange(1, 26)[:, None] * np.array(means)[:, None])


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


def test_later_frames_would_pay(record) -> None:
    samples = samples_of(record, HistoryWindow(), Population.ALL)
    miss_m = [
        np.hypot(*np.moveaxis(model.predict(samples.batch).xy_m[:, 0] - samples.future_xy_m, -1, 0)).mean()
        for model in (Cheat(), predictors_named(["cv"])["cv"])
    ]
    assert miss_m[0] < 0.6 * miss_m[1]


def test_a_predictor_may_look_back(record) -> None:
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    answer, frames = causal_answer("memory", Memory(), batch)
    assert frames == CHECKED_FRAMES
    assert (answer.xy_m == Memory().predict(batch).xy_m).all()


@pytest.mark.parametrize("model", PREDICTORS)
def test_every_predictor_of_the_project_passes(model, record, tmp_path) -> None:
    checkpoints = {}
    if PREDICTORS[model].checkpoint is Checkpoint.REQUIRED:
        pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")
        from plain_networks import drawn_weights

        checkpoints = drawn_weights(model, tmp_path)
    predictor = predictors_named([model], checkpoints)[model]
    assert (
        causal_answer(model, predictor, samples_of(record, predictor.window, Population.ALL).batch)[1] == CHECKED_FRAMES
    )


def test_equally_probable_hypotheses_may_change_places(record) -> None:
    @dataclass(frozen=True)
    class Fork:
        window: HistoryWindow = field(default_factory=HistoryWindow)

        def predict(self, batch: SampleBatch) -> Hypotheses:
            ways = batch.xy_m[:, None, None] + np.array([-1.0, 1.0])[None, :, None, None] * np.ones(
                (len(batch), 2, 25, 2)
            )
            return Hypotheses(ways[:, ::-1] if len(batch.step) > 1 else ways, np.full((len(batch), 2), 0.5))

    assert causal_answer("fork", Fork(), samples_of(record, HistoryWindow(), Population.ALL).batch)[1] == CHECKED_FRAMES


def test_a_part_of_a_batch_has_memory_of_its_own_and_the_same_samples(record) -> None:
    batch = samples_of(record, HistoryWindow(), Population.ALL).batch
    part = batch.between(4, 7)
    rows = np.isin(batch.actors.frame[batch.target], [4, 5, 6])
    assert part.sample_step.tolist() == batch.sample_step[rows].tolist()
    assert part.actor_id.tolist() == batch.actor_id[rows].tolist()
    assert (part.xy_m == batch.xy_m[rows]).all()
    assert part.actors.xy_m.base is None
    assert replace(part).between(0, 3).sample_step.tolist() == part.sample_step.tolist()


def test_without_later_frames_nothing_can_be_checked(straight_road) -> None:
    batch = samples_of(
        record_with({1: moving(0.0, -5.25, 5.0, steps=161)}, straight_road), HistoryWindow(), Population.ALL
    ).batch
    assert causal_answer("cheat", Cheat(), batch)[1] == 0
