"""Tests of sealed episodes from their request to their bag: trying seeds gives nothing, evaluators read them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_episode import quick_template

from siren_ros.base.numerics.arrays import Points
from siren_ros.data.episode_source import bag_sha256, open_source
from siren_ros.data.interfaces import topics
from siren_ros.data.recording.bag_reader import read_episode
from siren_ros.reports.exam.grading import load_rulebook
from siren_ros.reports.exam.sitting import sit_in_bag
from siren_ros.running.generation.closed_loop import closed_loop, record_episode
from siren_ros.running.generation.episode_setup import behaviour_world, set_up_episode
from siren_ros.running.seat.drivers.drivers import driver_of
from siren_ros.running.seat.seated import answers_of
from siren_ros.scoring.evaluation.prediction.predictors import predictors_named
from siren_ros.scoring.evaluation.prediction.scoring import score_episode
from siren_ros.simulation.scenario.episode import EpisodeRequest

SEED = 3
DURATION_S = 9.0


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> EpisodeRequest:
    salt = tmp_path_factory.mktemp("sealed") / "salt"
    salt.write_text(bytes(range(16)).hex())
    return EpisodeRequest(quick_template("S2"), seed=SEED, sensors="none", duration_s=DURATION_S, salt=str(salt))


@pytest.fixture(scope="module")
def bag(asked: EpisodeRequest) -> Path:
    """The bag of a sealed episode."""
    folder = Path(asked.salt).parent / "bag"
    record_episode(set_up_episode(asked), folder)
    return folder


def first_places(seed: int) -> Points:
    """Where everybody is at the first step of the episode that this seed gives without a salt."""
    setup = set_up_episode(EpisodeRequest(quick_template("S2"), seed=seed, sensors="none", duration_s=0.05))
    (step,) = closed_loop(setup, 1)
    return np.stack((step.states.x_m, step.states.y_m), axis=-1)


def share_that_fits(seen: Points, simulated: Points) -> float:
    """Share of the seen vehicles that a simulated episode has within a decimetre."""
    away_m = np.hypot(*(seen[:, None] - simulated[None]).T)
    return float((away_m.min(axis=0) < 0.1).mean())


def test_whoever_tries_seeds_finds_an_open_episode_but_not_a_sealed_one(bag: Path) -> None:
    tried = [first_places(seed) for seed in (SEED - 1, SEED, SEED + 1)]
    assert [share_that_fits(tried[1], one) == 1.0 for one in tried] == [False, True, False]
    states = read_episode(bag).states[0]
    seen = np.stack((states.x_m, states.y_m), axis=-1)
    assert max(share_that_fits(seen, one) for one in tried) < 0.5


def test_a_sealed_bag_follows_from_its_salt_and_says_nothing(asked: EpisodeRequest, bag: Path, tmp_path: Path) -> None:
    record_episode(set_up_episode(asked), tmp_path / "again")
    assert bag_sha256(tmp_path / "again") == bag_sha256(bag)
    record = read_episode(bag)
    assert (record.description.template, record.description.map_name, record.description.seed) == (
        "sealed",
        "sealed",
        0,
    )
    assert not record.description.asked
    assert set(record.description.parameters) == {"sealed"}
    assert record.outcome is not None
    assert (record.outcome.predicate_holds, set(record.outcome.measures)) == (None, {"predicate"})
    assert all(int(actor.name, 16) for actor in record.actors.values())
    spawned = [actor.actor_id for traffic in record.traffic for actor in traffic.spawned if not actor.is_emv]
    assert spawned != list(range(spawned[0], spawned[0] + len(spawned)))


def test_a_driver_sits_a_sealed_exam_and_is_told_map_and_route_alone(asked: EpisodeRequest, tmp_path: Path) -> None:
    setup = set_up_episode(replace(asked, av="civilian", duration_s=2.0))
    record_episode(setup, tmp_path / "exam1", answers_of(setup, driver_of("idm")))
    with open_source(tmp_path / "exam1") as source:
        told = {topic: source.has(topic) for topic in (topics.MAP, topics.AV_ROUTE)}
        description = source.description
    assert all(told.values())
    assert description.parameters["av"] == {"actor_id": 2, "name": "", "sensors": "none"}
    assert (description.template, description.level, description.seed, description.site) == ("sealed", 0, 0, {})
    sitting = sit_in_bag(tmp_path / "exam1", None, load_rulebook("california"))
    assert sitting.episode == "exam1"
    assert sitting.marks


def test_predictions_are_scored_on_a_sealed_bag(bag: Path) -> None:
    scores = score_episode("sealed", read_episode(bag), predictors_named(["cv"]))
    assert len(scores.models["cv"]) > 0
    assert scores.template == "sealed"


def test_plan_and_drivers_have_the_same_draw_of_a_preset(asked: EpisodeRequest) -> None:
    for seed in range(4):
        setup = set_up_episode(replace(asked, preset="observed", seed=seed))
        drivers = behaviour_world(setup.description, setup.compiled_map.read_bytes()).preset
        assert drivers.drivers == setup.preset.drivers
        assert drivers.compliance.complies == setup.preset.compliance.complies
