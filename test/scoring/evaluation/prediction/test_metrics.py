"""Metrics of trajectory prediction, by cases worked out by hand, by loops over everything, and by Argoverse 2's own."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_records import moving, record_with
from made_scores import scored
from reader_environments import read_with
from shapely import Polygon

from siren_ros.base.numerics.geometry import footprint_corners
from siren_ros.scoring.evaluation.prediction.metrics import (
    ACCELERATION_MAX_MPS2,
    METRIC_OF,
    METRICS,
    RADIUS_MIN_M,
    Metric,
    brier_min_fde_6,
    brier_score,
    calibration_error,
    colliding,
    infeasible,
    missed_6,
    off_road,
    reliability_of,
    road_raster,
    world_min_ade_6,
    world_min_fde_6,
    wrong_way,
)
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, future_times_s, samples_of
from siren_ros.simulation.roads.road_network import Junction, JunctionKind


def test_a_hypothesis_within_two_metres_is_no_miss() -> None:
    paths = np.zeros((4, 7, 25, 2))
    paths[..., 0] = 10.0
    paths[1, 5, -1] = (0.0, 2.0)
    paths[2, 5, -1] = (0.0, 2.0 + 1e-9)
    paths[3, 6, -1] = (0.0, 0.0)
    hypotheses = Hypotheses.ranked(paths, np.ones((4, 7)))
    assert missed_6(hypotheses, np.zeros((4, 25, 2))).tolist() == [1.0, 0.0, 1.0, 1.0], "the seventh does not count"


ONE_TRUTH = np.zeros((1, 25, 2))


def ending(*ends_m: float, probability: tuple[float, ...]) -> Hypotheses:
    """Hypotheses of one sample that end at given distances."""
    paths = np.zeros((1, len(ends_m), 25, 2))
    paths[0, :, -1, 0] = ends_m
    return Hypotheses(paths, np.array([probability]))


@pytest.mark.parametrize(
    ("ends_m", "probability", "brier_min_fde_m", "score"),
    [
        ((3.0, 1.0), (0.75, 0.25), 1.0 + 0.75**2, 2.0 * 0.75**2),
        ((0.5, 9.0), (1.0, 0.0), 0.5, 0.0),
        (range(1, 9), (0.125,) * 8, 1.0 + (5.0 / 6.0) ** 2, (5.0 / 6.0) ** 2 + 5.0 / 36.0),
        ((2.0,), (1.0,), 2.0, np.nan),
    ],
    ids=["by hand", "sure and right", "six are scaled to the sum one", "a single hypothesis states nothing"],
)
def test_brier_scores(ends_m, probability, brier_min_fde_m, score) -> None:
    hypotheses = ending(*ends_m, probability=probability)
    assert brier_min_fde_6(hypotheses, ONE_TRUTH)[0] == pytest.approx(brier_min_fde_m)
    assert brier_score(hypotheses, ONE_TRUTH)[0] == pytest.approx(score, nan_ok=True)


def two_modes(samples: int, first_best: int, probability: float) -> tuple[Hypotheses, np.ndarray]:
    """Samples with two hypotheses; in the first ones of them the more probable is the best."""
    paths = np.zeros((samples, 2, 25, 2))
    paths[:first_best, 1] = 5.0
    paths[first_best:, 0] = 5.0
    stated = np.broadcast_to([probability, 1.0 - probability], (samples, 2)).copy()
    return Hypotheses(paths, stated), np.zeros((samples, 25, 2))


@pytest.mark.parametrize(("first_best", "probability", "error"), [(75, 0.75, 0.0), (60, 0.95, 0.35), (100, 1.0, 0.0)])
def test_calibration_is_of_all_counts(first_best, probability, error) -> None:
    """Of 100 samples; counts of two parts add up."""
    whole = reliability_of(*two_modes(100, first_best, probability))
    assert calibration_error(whole) == (pytest.approx(error), 200 if probability < 1.0 else 100)
    parts = [reliability_of(*two_modes(50, best, probability)) for best in (50, first_best - 50)]
    assert parts[0] + parts[1] == pytest.approx(whole)


def test_probabilities_are_counted_in_tenths() -> None:
    """Four samples of two hypotheses with 0.75 and 0.25; in three of them the more probable is the best."""
    count, probability, best = reliability_of(*two_modes(4, 3, 0.75))
    assert count.tolist() == [0, 0, 4, 0, 0, 0, 0, 4, 0, 0]
    assert best.tolist() == [0, 0, 1, 0, 0, 0, 0, 3, 0, 0]
    assert probability[[2, 7]] == pytest.approx([1.0, 3.0])
    certain, single = two_modes(4, 4, 1.0), (Hypotheses.certain(np.zeros((3, 25, 2))), np.zeros((3, 25, 2)))
    assert reliability_of(*certain)[0].tolist() == [0.0] * 9 + [4.0], "those of probability 0 are not counted"
    assert calibration_error(reliability_of(*single)) == (None, 0), "they state nothing"


TIME = 0.2 * np.arange(1, 26)


def straight(x_m: float, y_m: float, vx_mps: float, vy_mps: float) -> np.ndarray:
    """A path of constant velocity from a place."""
    return np.stack((x_m + vx_mps * TIME, y_m + vy_mps * TIME), axis=-1)


def hits(paths, yaw_rad, frame=None, starts=None) -> list[float]:
    """Which vehicles collide; all in one frame, and each starts a step before its path, unless that is said."""
    xy_m = np.array(paths)
    start = 2.0 * xy_m[:, 0] - xy_m[:, 1] if starts is None else np.array(starts)
    samples = scored(xy_m, [0] * len(xy_m) if frame is None else list(frame), start, np.array(yaw_rad))
    return colliding(Hypotheses.certain(xy_m), samples.batch).tolist()


def test_crossing_paths_collide_only_at_the_same_time() -> None:
    """Both are at the origin after 2 s; the third, a frame later, would be, too."""
    paths = [straight(-20.0, 0.0, 10.0, 0.0), straight(0.0, -20.0, 0.0, 10.0), straight(0.0, 20.0, 0.0, -10.0)]
    yaw = [0.0, np.pi / 2, -np.pi / 2]
    hit = hits(paths, yaw, [0, 0, 1])
    assert hit[:2] == [1.0, 1.0]
    assert np.isnan(hit[2]), "alone in its frame"
    assert hits([paths[0], straight(0.0, -50.0, 0.0, 10.0)], yaw[:2]) == [0.0, 0.0]
    stands = straight(0.0, 0.0, 0.0, 0.0)
    for x_m in (-1.0, -103.0):  # 3 m away at the first point alone, or at the last
        assert hits([stands, straight(x_m, 0.0, 20.0, 0.0)], [0.0, 0.0]) == [1.0, 1.0]


@pytest.mark.parametrize(("apart_m", "expected"), [(2.1, 0.0), (1.9, 1.0)])
def test_footprints_are_as_wide_as_vehicles(apart_m, expected) -> None:
    """2 m wide, side by side."""
    assert hits([straight(0.0, 0.0, 8.0, 0.0), straight(0.0, apart_m, 8.0, 0.0)], [0.0, 0.0]) == [expected] * 2


def test_a_standing_vehicle_keeps_its_heading() -> None:
    """4 m long, across the way: 1.5 m beyond its centre line it is hit, along the way it is not."""
    paths = [straight(0.0, 0.0, 0.0, 0.0), straight(-20.0, 2.5, 10.0, 0.0)]
    assert hits(paths, [np.pi / 2, 0.0]) == [1.0, 1.0]
    assert hits(paths, [0.0, 0.0]) == [0.0, 0.0]


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 300))
def test_as_polygons_say(seed) -> None:
    rng = np.random.default_rng(seed)
    count = 5
    starts, velocity = rng.uniform(-15.0, 15.0, (count, 2)), rng.uniform(-6.0, 6.0, (count, 2))
    yaw = np.arctan2(velocity[:, 1], velocity[:, 0])
    paths = np.array([straight(*start, *speed) for start, speed in zip(starts, velocity, strict=True)])
    size = np.full(count, 4.0), np.full(count, 2.0)
    boxes = [[*map(Polygon, footprint_corners(*at.T, yaw, *size))] for at in np.moveaxis(paths, 1, 0)]
    expected = [
        float(any(at[a].intersection(at[b]).area > 1e-9 for at in boxes for b in range(count) if b != a))
        for a in range(count)
    ]
    assert hits(list(paths), list(yaw)) == expected


@pytest.mark.parametrize(("leg_m", "expected"), [(0.09, 1.0), (0.11, 0.0)])
def test_a_leg_of_a_decimetre_turns_the_vehicle(leg_m, expected) -> None:
    """It heads north and creeps east: as long as it heads north it reaches 2 m to the north, and then 1 m."""
    creeping = np.stack((leg_m * np.arange(1, 26), np.zeros(25)), axis=-1)
    assert hits([creeping, straight(0.0, 2.5, 0.0, 0.0)], [np.pi / 2.0, 0.0]) == [expected, expected]


def test_a_vehicle_that_turned_keeps_the_heading_of_its_last_leg() -> None:
    """From north to east within the first leg, then it stands; the other comes past 2.5 m to the north."""
    stops, starts = np.tile([5.0, 0.0], (25, 1)), [(0.0, 0.0), (-20.0, 2.5)]
    passing = straight(-20.0, 2.5, 8.0, 0.0)
    assert hits([stops, passing], [np.pi / 2.0, 0.0], starts=starts) == [0.0, 0.0]
    assert hits([stops[:, ::-1], passing], [0.0, 0.0], starts=starts) == [1.0, 1.0]


def test_samples_without_a_statement_do_not_count_and_the_root_is_that_of_the_mean() -> None:
    plain = Metric("x", "x", lambda *_: np.zeros(0))
    assert plain.value(np.array([1.0, np.nan, 3.0])) == (2.0, 2)
    assert plain.value(np.full(3, np.nan)) == (None, 0)
    assert replace(plain, of_mean=np.sqrt).value(np.array([1.0, 7.0])).value == pytest.approx(2.0)


def random_hypotheses(seed: int, samples: int, modes: int) -> tuple[Hypotheses, np.ndarray]:
    """Hypotheses around a truth near the origin, some within 2 m of its end."""
    rng = np.random.default_rng(seed)
    truth = rng.normal(scale=3.0, size=(samples, 25, 2))
    paths = truth[:, None] + rng.normal(scale=2.0, size=(samples, modes, 25, 2))
    return Hypotheses.ranked(paths, rng.dirichlet(np.ones(modes), samples)), truth


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)
def test_without_samples_there_is_no_value(metric) -> None:
    nobody = np.zeros((0, 25, 2))
    assert metric.value(metric.of_samples(Hypotheses.certain(nobody), scored(nobody))) == (None, 0)


@pytest.mark.parametrize("metric", METRICS, ids=lambda metric: metric.name)
def test_a_sample_counts_alone(metric) -> None:
    """Values of some samples do not depend on the others, collisions of other frames included."""
    hypotheses, truth = random_hypotheses(3, 12, 6)
    whole = metric.of_samples(hypotheses, scored(truth))
    part = metric.of_samples(hypotheses.select(np.arange(4, 8)), scored(truth[4:8]))
    assert np.array_equal(whole[4:8], part, equal_nan=True)


SAMPLES, MODES, TIMES = 12, 8, 25


def test_every_sample_has_the_value_of_its_loops() -> None:
    rng = np.random.default_rng(4)
    truth = np.cumsum(rng.normal(0.5, 0.4, (SAMPLES, TIMES, 2)), axis=1) + rng.uniform(-50, 50, (SAMPLES, 1, 2))
    missing = np.cumsum(rng.normal(0.0, 0.8, (SAMPLES, MODES, TIMES, 2)), axis=2)
    hypotheses = Hypotheses.ranked(truth[:, None] + missing, rng.dirichlet(np.ones(MODES), SAMPLES))
    values = {name: METRIC_OF[name].of_samples(hypotheses, scored(truth)) for name in METRIC_OF}
    for sample in range(SAMPLES):
        apart = [[*map(math.dist, path, truth[sample])] for path in hypotheses.xy_m[sample, :6]]
        ends, means = [path[-1] for path in apart], [sum(path) / TIMES for path in apart]
        best, stated = ends.index(min(ends)), hypotheses.probability[sample, :6].tolist()
        share = [one / sum(stated) for one in stated]
        expected = {
            "ade_m": means[0],
            "fde_m": ends[0],
            "min_ade_6_m": min(means),
            "min_fde_6_m": ends[best],
            "rmse_5s_m": ends[0] ** 2,
            "miss_rate_6": float(ends[best] > 2.0),
            "brier_min_fde_6_m": ends[best] + (1.0 - share[best]) ** 2,
            "brier_score": sum((share[mode] - (mode == best)) ** 2 for mode in range(6)),
        }
        assert {name: float(values[name][sample]) for name in expected} == pytest.approx(expected)
    assert set(values["miss_rate_6"]) == {0.0, 1.0}, "both kinds are there"
    rooted = METRIC_OF["rmse_5s_m"].value(values["rmse_5s_m"]).value
    assert rooted == pytest.approx(np.sqrt((values["fde_m"] ** 2).mean()))


def test_every_sample_has_the_value_of_argoverse_2(tmp_path) -> None:
    """Six hypotheses of unequal probability around each of 300 truths; about half of the samples are misses."""
    rng = np.random.default_rng(11)
    truth = np.cumsum(rng.normal(scale=1.0, size=(300, 25, 2)), axis=1) + rng.uniform(-500, 500, (300, 1, 2))
    noise = np.cumsum(rng.normal(scale=0.6, size=(300, 6, 25, 2)), axis=2)
    hypotheses = Hypotheses.ranked(truth[:, None] + noise, rng.dirichlet(np.ones(6), 300))
    path = tmp_path / "given.npz"
    np.savez(path, paths=hypotheses.xy_m, truth=truth, probability=hypotheses.probability)
    told = {name: np.array(values) for name, values in read_with("av2", "read_argoverse2_metrics.py", path).items()}
    missed = told["missed"].min(axis=1)
    expected = {
        "ade_m": told["ade"][:, 0],
        "fde_m": told["fde"][:, 0],
        "min_ade_6_m": told["ade"].min(axis=1),
        "min_fde_6_m": told["fde"].min(axis=1),
        "miss_rate_6": missed,
        "brier_min_fde_6_m": told["brier_fde"][np.arange(len(truth)), told["fde"].argmin(axis=1)],
    }
    for name, values in expected.items():
        assert np.abs(METRIC_OF[name].of_samples(hypotheses, scored(truth)) - values).max() < 1e-9, name
    assert 0.2 < missed.mean() < 0.8, "both kinds are there"


TIMES_S = future_times_s()


def speed_change(acceleration: float):
    """The way of a vehicle at 10 m/s that brakes to a standstill, or speeds up."""
    until = np.minimum(TIMES_S, 10.0 / -acceleration) if acceleration < 0.0 else TIMES_S
    return 10.0 * until + 0.5 * acceleration * until**2, 0.0 * TIMES_S


def bend(speed_mps: float, radius_m: float):
    angle = speed_mps * TIMES_S / radius_m
    return radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle))


@pytest.mark.parametrize(
    ("speed_mps", "way", "expected"),
    [
        *((10.0, speed_change(acceleration), 0.0) for acceleration in (0.0, -8.0, 5.0)),
        *((10.0, speed_change(acceleration), 1.0) for acceleration in (-10.0, 9.5)),
        (10.0, bend(10.0, 1.05 * 100.0 / ACCELERATION_MAX_MPS2), 0.0),
        (10.0, bend(10.0, 10.0), 1.0),
        (3.0, bend(3.0, 1.1 * RADIUS_MIN_M), 0.0),
        (3.0, bend(3.0, 0.8 * RADIUS_MIN_M), 1.0),
        (10.0, (11.2 * TIMES_S, 0.0 * TIMES_S), 1.0),
        (10.0, (10.2 * TIMES_S, 0.0 * TIMES_S), 0.0),
    ],
)
def test_tyres_and_steering_carry_so_much(straight_road, speed_mps, way, expected) -> None:
    """At 10 m/s the smallest circle has 11.3 m; a slow car turns no tighter than its steering."""
    record = record_with({1: moving(0.0, -5.25, speed_mps, steps=161)}, straight_road)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    path = samples.batch.xy_m[:, None] + np.stack(way, axis=-1)[None]
    assert infeasible(Hypotheses.certain(path), samples).tolist() == [expected]


def world(errors_m: list[list[float]], frame: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Joint errors of samples whose hypotheses are off by some metres at all times."""
    off = np.array(errors_m)
    truth = np.cumsum(np.ones((len(off), 25, 2)), axis=1)
    paths = truth[:, None] + np.stack((off, np.zeros_like(off)), axis=-1)[:, :, None]
    hypotheses = Hypotheses(paths, np.full(off.shape, 1.0 / off.shape[1]))
    samples = scored(truth, frame)
    return world_min_ade_6(hypotheses, samples), world_min_fde_6(hypotheses, samples)


def test_a_world_is_right_for_all_vehicles_or_for_none() -> None:
    """Each vehicle has an exact path, but of another rank: no world is exact."""
    for values in world([[0.0, 4.0], [6.0, 0.0]], [0, 0]):
        assert values[0] == pytest.approx(2.0), "the second world: 4 m and 0 m"
        assert np.isnan(values[1]), "a frame counts once"


def test_one_vehicle_is_a_world_of_its_own_of_which_six_count() -> None:
    for values in world([[3.0, 1.0], [0.5, 2.0]], [0, 1]):
        assert values.tolist() == pytest.approx([1.0, 0.5])
    assert world([[9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 0.0]], [0])[0].tolist() == pytest.approx([4.0])
    path = np.zeros((1, 1, 25, 2))
    path[..., 0] = np.arange(1, 26)
    hypotheses, samples = Hypotheses(path, np.ones((1, 1))), scored(np.zeros((1, 25, 2)), [0])
    assert world_min_ade_6(hypotheses, samples).tolist() == [13.0]
    assert world_min_fde_6(hypotheses, samples).tolist() == [25.0]


def rates(straight_road, y_m, aside_mps=0.0, along_mps=5.0, yaw_rad=0.0):
    record = record_with({1: moving(60.0, y_m, along_mps, 0.0, yaw_rad, steps=161)}, straight_road)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    velocity = np.array([along_mps * np.cos(yaw_rad), aside_mps + along_mps * np.sin(yaw_rad)])
    hypotheses = Hypotheses.certain(samples.batch.xy_m[:, None] + TIMES_S[:, None] * velocity)
    return float(off_road(hypotheses, samples)[0]), float(wrong_way(hypotheses, samples)[0])


@pytest.mark.parametrize(
    ("y_m", "aside_mps", "yaw_rad", "leaves", "against"),
    [
        (-5.25, 0.0, 0.0, 0.0, 0.0),
        (-1.75, 0.0, 0.0, 0.0, 0.0),
        (-5.25, 30.0, 0.0, 1.0, 0.0),
        (-5.25, -0.2, 0.0, 0.0, 0.0),
        (-60.0, 0.0, 0.0, np.nan, 0.0),
        (-5.25, 0.0, np.pi, 0.0, np.nan),
    ],
    ids=["right lane", "left lane", "beyond the edge", "1 m aside", "off the road", "against its lane"],
)
def test_paths_off_the_road_and_the_wrong_way(straight_road, y_m, aside_mps, yaw_rad, leaves, against) -> None:
    """Who is off the road, or against its lane, at the present says nothing."""
    found = rates(straight_road, y_m, aside_mps, yaw_rad=yaw_rad)
    assert found == pytest.approx((leaves, against), nan_ok=True)


def test_a_path_back_along_the_lane_is_the_wrong_way(straight_road) -> None:
    record = record_with({1: moving(60.0, -5.25, 5.0, steps=161)}, straight_road)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    back = Hypotheses.certain(samples.batch.xy_m[:, None] - TIMES_S[:, None] * np.array([5.0, 0.0]))
    assert wrong_way(back, samples).tolist() == [1.0]
    stands = Hypotheses.certain(np.repeat(samples.batch.xy_m[:, None], 25, axis=1))
    assert wrong_way(stands, samples).tolist() == [0.0]


def test_without_a_map_there_is_no_value() -> None:
    samples = scored(np.zeros((3, 25, 2)))
    for rate in (off_road, wrong_way):
        assert np.isnan(rate(Hypotheses.certain(samples.future_xy_m), samples)).all()


def test_a_junction_has_no_wrong_way(straight_road) -> None:
    outline = np.array([[50.0, -9.0], [60.0, -9.0], [60.0, 9.0], [50.0, 9.0]])
    junction = Junction("j", JunctionKind.SIGNAL, outline, 55.0, 0.0)
    raster = road_raster(replace(straight_road, junctions={"j": junction}))
    assert raster is not None
    inside, outside = (raster.cells(np.array([x_m, -5.25])) for x_m in (55.0, 70.0))
    assert raster.road[inside]
    assert (raster.directions[inside], raster.directions[outside]) == (255, 0b11000111)
    assert raster.road[raster.cells(np.array([55.0, 8.0]))], "where no lane is"
