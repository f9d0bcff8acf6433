"""Samples and scores made of formulas, for the tests of metrics and reports."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from siren_ros.base.numerics.arrays import Floats
from siren_ros.scoring.evaluation.prediction.metrics import BINS, METRICS
from siren_ros.scoring.evaluation.prediction.samples import (
    HistoryWindow,
    ObservedActors,
    Population,
    SampleBatch,
    ScoredSamples,
)
from siren_ros.scoring.evaluation.prediction.scoring import Category, EpisodeScores, ModelScores
from siren_ros.simulation.roads.road_network import NO_LANE, RoadNetwork
from siren_ros.simulation.scenario.paper import EmergencyLevel
from siren_ros.simulation.world.actors import ActorClass


def scored(
    future_xy_m: Floats, frame: list[int] | None = None, xy_m: Floats | None = None, yaw_rad: Floats | None = None
) -> ScoredSamples:
    """Samples of 4 m by 2 m with a given future; each in a frame of its own, at the origin, unless said otherwise."""
    count = len(future_xy_m)
    frames = np.arange(count) if frame is None else np.array(frame)
    window, points = HistoryWindow(), HistoryWindow().points
    present = np.zeros((count, 2)) if xy_m is None else xy_m
    heading = np.zeros(count) if yaw_rad is None else yaw_rad
    network = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")
    steps = 2 * np.arange(int(frames.max()) + 1 if count else 0)
    actors = ObservedActors(
        frame=frames,
        actor_id=np.arange(1, count + 1, dtype=np.uint32),
        actor_class=np.full(count, ActorClass.SEDAN, dtype=np.uint8),
        is_emv=np.zeros(count, dtype=np.bool_),
        length_m=np.full(count, 4.0),
        width_m=np.full(count, 2.0),
        lights=np.zeros(count, dtype=np.uint8),
        observed=np.ones((count, points), dtype=np.bool_),
        xy_m=np.repeat(present[:, None], points, axis=1),
        velocity_mps=np.zeros((count, points, 2)),
        yaw_rad=np.repeat(heading[:, None], points, axis=1),
        accel_mps2=np.zeros((count, points)),
        past_sumo_lane=np.full((count, points), NO_LANE, dtype=np.int32),
    )
    offset = np.searchsorted(frames, np.arange(len(steps) + 1))
    batch = SampleBatch(network, window, steps, offset, actors, np.arange(count))
    return ScoredSamples(batch, future_xy_m)


def model_scores(
    values: Mapping[str, Floats] | Floats, category: int = Category.OTHER, population_size: int | None = None
) -> ModelScores:
    """Samples at steps 0, 2, 4 … of actor 1, with the same values for all metrics unless they are given by name."""
    by_metric = values if isinstance(values, Mapping) else {metric.name: values for metric in METRICS}
    count = len(next(iter(by_metric.values())))
    nothing = np.full(count, np.nan)
    return ModelScores(
        step=2 * np.arange(count, dtype=np.int64),
        actor_id=np.ones(count, dtype=np.uint32),
        category=np.full(count, category, dtype=np.uint8),
        traits=np.zeros(count, dtype=np.uint8),
        moved_m=np.full(count, 10.0),
        values={metric.name: np.asarray(by_metric.get(metric.name, nothing)) for metric in METRICS},
        distance_sum_m=np.full(25, float(np.nansum(by_metric.get("ade_m", np.zeros(1))))),
        reliability=np.zeros((3, BINS)),
        population_size=count if population_size is None else population_size,
    )


def episode_scores(
    template: str, models: Mapping[str, ModelScores], seed: int = 0, level=EmergencyLevel.L2, **parameters: float
) -> EpisodeScores:
    """An episode of a template."""
    name = f"{template}_seed{seed}"
    return EpisodeScores(name, template, level, seed, "town", Population.REGION, parameters, models)


def reported_scores() -> list[EpisodeScores]:
    """Two models over four episodes of S1 at L3, S2 at L2 and a template of our own at L2, for whole reports.

    FDE is three times ADE, the minima are half of both, the error at 5 s is four times ADE; more than 1.5 m of ADE is a
    miss; Brier scores and collisions are unknown. The first sample is an EMV's, the next one another's, and so on. The
    model ``net:v_1`` is twice as bad as ``cv`` and has no answer to the last sample of each episode; of its hypotheses
    four were stated with 0.25 and four with 0.75, and half of each were the best.
    """
    return [
        _reported("S1", EmergencyLevel.L3, 0, (1.0, 2.0)),
        _reported("S1", EmergencyLevel.L3, 1, (1.5, 2.5, 3.5)),
        _reported("S2", EmergencyLevel.L2, 0, (2.0, 4.0, 6.0)),
        _reported("own", EmergencyLevel.L2, 0, (8.0, 8.0)),
    ]


def five_episodes() -> list[EpisodeScores]:
    """Of S1, with a sample each: ``cv`` is off by 1 to 5 m, ``net`` by twice that.

    The mean of 3 m has the standard error √(2.5 / 5), and Student's t of 4 degrees of freedom is 2.7764: ±1.9633 m.
    """
    return [
        episode_scores("S1", {"cv": model_scores(np.array([ade])), "net": model_scores(np.array([2.0 * ade]))}, seed)
        for seed, ade in enumerate((1.0, 2.0, 3.0, 4.0, 5.0))
    ]


def _reported(template: str, level: EmergencyLevel, seed: int, ade_m: Sequence[float]) -> EpisodeScores:
    def scores(ade: Floats, population_size: int) -> ModelScores:
        values = {
            "ade_m": ade,
            "fde_m": 3.0 * ade,
            "min_ade_6_m": 0.5 * ade,
            "min_fde_6_m": 1.5 * ade,
            "rmse_5s_m": (4.0 * ade) ** 2,
            "miss_rate_6": (ade > 1.5).astype(np.float64),
        }
        places = np.arange(len(ade)) % 2
        category = np.where(places == 0, Category.EMV, Category.OTHER).astype(np.uint8)
        grown = np.arange(25.0) * len(ade)
        return replace(model_scores(values, population_size=population_size), category=category, distance_sum_m=grown)

    ade = np.array(ade_m)
    stated = np.zeros((3, BINS))
    stated[:, [2, 7]] = (4.0, 4.0), (4.0 * 0.25, 4.0 * 0.75), (2.0, 2.0)
    net = replace(scores(2.0 * ade[:-1], len(ade)), reliability=stated)
    return episode_scores(template, {"cv": scores(ade, len(ade)), "net:v_1": net}, seed, level, speed_mps=8.0 + seed)
