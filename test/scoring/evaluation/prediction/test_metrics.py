"""Metrics of trajectory prediction, by cases worked out by hand, by loops over everything, and by Argoverse 2's own."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
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
    ade,
    brier_min_fde_6,
    brier_score,
    calibration_error,
    colliding,
    fde,
    infeasible,
    min_ade_6,
    min_fde_6,
    missed_6,
    off_road,
    reliability_of,
    road_raster,
    squared_fde,
    world_min_ade_6,
    world_min_fde_6,
    wrong_way,
)
from siren_ros.scoring.evaluation.prediction.predictors import Hypotheses
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, future_times_s, samples_of
from siren_ros.simulation.roads.road_network import Junction, JunctionKind

TRUTH = np.zeros((2, 4, 2))


def sure(xy_m: np.ndarray) -> Hypotheses:
    """Hypotheses of equal probability, in the given order."""
    return Hypotheses.ranked(xy_m, np.ones(xy_m.shape[:2]))


def means(paths: np.ndarray, *metrics: Callable[[Hypotheses, np.ndarray], np.ndarray]) -> list[float]:
    """Of metrics over both samples, whose hypotheses are equally probable."""
    return [float(metric(sure(paths), TRUTH).mean()) for metric in metrics]


def shifted(*offsets_m: float) -> np.ndarray:
    """One hypothesis for each offset in y, for both samples."""
    hypotheses = np.zeros((2, len(offsets_m), 4, 2))
    hypotheses[..., 1] = np.array(offsets_m)[None, :, None]
    return hypotheses


def test_distances_are_euclidean() -> None:
    hypotheses = np.zeros((2, 1, 4, 2))
    hypotheses[0] = (3.0, 4.0)
    assert means(hypotheses, ade, fde) == pytest.approx([2.5, 2.5])
    assert squared_fde(sure(hypotheses), TRUTH).tolist() == [25.0, 0.0]


def test_ade_takes_all_times_and_fde_the_last() -> None:
    hypotheses = np.zeros((2, 1, 4, 2))
    hypotheses[:, 0, :, 0] = (1.0, 2.0, 3.0, 6.0)
    assert means(hypotheses, ade, fde) == pytest.approx([3.0, 6.0])


def test_the_first_hypothesis_counts_and_for_the_best_of_six_the_first_six() -> None:
    hypotheses = shifted(7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0)
    assert means(hypotheses, ade, fde, squared_fde) == pytest.approx([7.0, 7.0, 49.0])
    assert means(hypotheses, min_ade_6, min_fde_6) == pytest.approx([2.0, 2.0])


def test_each_best_of_six_chooses_for_itself() -> None:
    hypotheses = shifted(2.0, 1.0)
    hypotheses[:, 0, -1] = 0.0
    assert means(hypotheses, min_ade_6, min_fde_6) == pytest.approx([1.0, 0.0])


@given(seed=st.integers(0, 1000), k=st.integers(1, 8))
def test_order_of_the_metrics(seed, k) -> None:
    rng = np.random.default_rng(seed)
    hypotheses, truth = sure(rng.normal(size=(5, k, 25, 2))), rng.normal(size=(5, 25, 2))
    assert (min_ade_6(hypotheses, truth) <= ade(hypotheses, truth) + 1e-12).all()
    assert (min_fde_6(hypotheses, truth) <= fde(hypotheses, truth) + 1e-12).all()
    if k == 1:
        assert np.array_equal(min_ade_6(hypotheses, truth), ade(hypotheses, truth))
        assert np.array_equal(min_fde_6(hypotheses, truth), fde(hypotheses, truth))


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


def test_a_calibrated_model_has_no_error() -> None:
    assert calibration_error(reliability_of(*two_modes(100, 75, 0.75))).value == pytest.approx(0.0)


def test_the_error_of_a_model_that_is_too_sure() -> None:
    error, hypotheses = calibration_error(reliability_of(*two_modes(100, 60, 0.95)))
    assert (error, hypotheses) == (pytest.approx(0.35), 200)


def test_counts_add_up() -> None:
    parts = [reliability_of(*two_modes(10, best, 0.75)) for best in (5, 10)]
    assert calibration_error(parts[0] + parts[1]).value == pytest.approx(0.0)
    assert calibration_error(parts[0]).value == pytest.approx(0.25)


def test_a_certain_hypothesis_falls_into_the_last_bin() -> None:
    reliability = reliability_of(*two_modes(4, 4, 1.0))
    assert reliability[0].tolist() == [0.0] * 9 + [4.0], "those of probability 0 are not counted"
    assert calibration_error(reliability).value == 0.0


def test_single_hypotheses_state_nothing() -> None:
    none = reliability_of(Hypotheses.certain(np.zeros((3, 25, 2))), np.zeros((3, 25, 2)))
    assert calibration_error(none) == (None, 0)


def test_probabilities_are_counted_in_tenths() -> None:
    """Four samples of two hypotheses with 0.75 and 0.25; in three of them the more probable is the best."""
    count, probability, best = reliability_of(*two_modes(4, 3, 0.75))
    assert count.tolist() == [0, 0, 4, 0, 0, 0, 0, 4, 0, 0]
    assert best.tolist() == [0, 0, 1, 0, 0, 0, 0, 3, 0, 0]
    assert probability[[2, 7]] == pytest.approx([1.0, 3.0])


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


@pytest.mark.parametrize(("apart_m", "expected"), [(2.1, 0.0), (1.9, 1.0)])
def test_footprints_are_as_wide_as_vehicles(apart_m, expected) -> None:
    """2 m wide, side by side."""
    assert hits([straight(0.0, 0.0, 8.0, 0.0), straight(0.0, apart_m, 8.0, 0.0)], [0.0, 0.0]) == [expected] * 2


def test_a_standing_vehicle_keeps_its_heading() -> None:
    """4 m long, across the way: 1.5 m beyond its centre line it is hit, along the way it is not."""
    paths = [straight(0.0, 0.0, 0.0, 0.0), straight(-20.0, 2.5, 10.0, 0.0)]
    assert hits(paths, [np.pi / 2, 0.0]) == [1.0, 1.0]
    assert hits(paths, [0.0, 0.0]) == [0.0, 0.0]


@given(seed=st.integers(0, 300))
def test_as_polygons_say(seed) -> None:
    rng = np.random.default_rng(seed)
    count = 5
    starts, velocity = rng.uniform(-15.0, 15.0, (count, 2)), rng.uniform(-6.0, 6.0, (count, 2))
    yaw = np.arctan2(velocity[:, 1], velocity[:, 0])
    paths = np.array([straight(*start, *speed) for start, speed in zip(starts, velocity, strict=True)])
    size = np.full(count, 4.0), np.full(count, 2.0)
    boxes = [
        [Polygon(corners) for corners in footprint_corners(paths[:, t, 0], paths[:, t, 1], yaw, *size)]
        for t in range(25)
    ]
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


PLAIN = Metric("x", "x", lambda *_: np.zeros(0))


def test_samples_without_a_statement_do_not_count() -> None:
    assert PLAIN.value(np.array([1.0, np.nan, 3.0])) == (2.0, 2)
    assert PLAIN.value(np.full(3, np.nan)) == (None, 0)


def test_the_root_is_that_of_the_mean() -> None:
    rooted = Metric("x", "x", PLAIN.of_samples, np.sqrt)
    assert rooted.value(np.array([1.0, 7.0])).value == pytest.approx(2.0)


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


@given(seed=st.integers(0, 1000), modes=st.integers(1, 9))
def test_the_mean_of_squares_is_rooted_at_the_end(seed, modes) -> None:
    hypotheses, truth = random_hypotheses(seed, 9, modes)
    metrics = (METRIC_OF["rmse_5s_m"], METRIC_OF["fde_m"])
    rmse, fde_m = (metric.value(metric.of_samples(hypotheses, scored(truth))).value for metric in metrics)
    assert rmse >= fde_m - 1e-12
    assert rmse == pytest.approx(np.sqrt((fde(hypotheses, truth) ** 2).mean()))


SAMPLES, MODES, TIMES = 12, 8, 25


def test_every_sample_has_the_value_of_its_loops() -> None:
    rng = np.random.default_rng(4)
    truth = np.cumsum(rng.normal(0.5, 0.4, (SAMPLES, TIMES, 2)), axis=1) + rng.uniform(-50, 50, (SAMPLES, 1, 2))
    missing = np.cumsum(rng.normal(0.0, 0.8, (SAMPLES, MODES, TIMES, 2)), axis=2)
    hypotheses = Hypotheses.ranked(truth[:, None] + missing, rng.dirichlet(np.ones(MODES), SAMPLES))
    values = {name: METRIC_OF[name].of_samples(hypotheses, scored(truth)) for name in METRIC_OF}
    for sample in range(SAMPLES):
        apart = [
            [float(np.hypot(*(hypotheses.xy_m[sample, mode, time] - truth[sample, time]))) for time in range(TIMES)]
            for mode in range(MODES)
        ]
        six = range(6)
        ends = [apart[mode][TIMES - 1] for mode in six]
        best = ends.index(min(ends))
        whole = sum(float(hypotheses.probability[sample, mode]) for mode in six)
        share = [float(hypotheses.probability[sample, mode]) / whole for mode in six]
        expected = {
            "ade_m": sum(apart[0]) / TIMES,
            "fde_m": ends[0],
            "min_ade_6_m": min(sum(apart[mode]) / TIMES for mode in six),
            "min_fde_6_m": ends[best],
            "rmse_5s_m": ends[0] ** 2,
            "miss_rate_6": float(ends[best] > 2.0),
            "brier_min_fde_6_m": ends[best] + (1.0 - share[best]) ** 2,
            "brier_score": sum((share[mode] - (mode == best)) ** 2 for mode in six),
        }
        assert {name: float(values[name][sample]) for name in expected} == pytest.approx(expected)
    assert set(values["miss_rate_6"]) == {0.0, 1.0}, "both kinds are there"


@pytest.fixture(scope="module")
def six_paths() -> tuple[Hypotheses, np.ndarray]:
    """Six hypotheses of unequal probability around each of 300 truths; about half of the samples are misses."""
    rng = np.random.default_rng(11)
    truth = np.cumsum(rng.normal(scale=1.0, size=(300, 25, 2)), axis=1) + rng.uniform(-500, 500, (300, 1, 2))
    noise = np.cumsum(rng.normal(scale=0.6, size=(300, 6, 25, 2)), axis=2)
    return Hypotheses.ranked(truth[:, None] + noise, rng.dirichlet(np.ones(6), 300)), truth


@pytest.fixture(scope="module")
def argoverse2(six_paths, tmp_path_factory) -> dict[str, np.ndarray]:
    """The answers of Argoverse 2's own functions, by hypothesis."""
    hypotheses, truth = six_paths
    path = tmp_path_factory.mktemp("metrics") / "given.npz"
    np.savez(path, paths=hypotheses.xy_m, truth=truth, probability=hypotheses.probability)
    return {name: np.array(values) for name, values in read_with("av2", "read_argoverse2_metrics.py", path).items()}


@pytest.mark.parametrize("name", ["ade_m", "fde_m", "min_ade_6_m", "min_fde_6_m", "miss_rate_6", "brier_min_fde_6_m"])
def test_every_sample_has_the_value_of_argoverse_2(name, six_paths, argoverse2) -> None:
    hypotheses, truth = six_paths
    best = np.arange(len(truth)), argoverse2["fde"].argmin(axis=1)
    missed = argoverse2["missed"].min(axis=1)
    expected = {
        "ade_m": argoverse2["ade"][:, 0],
        "fde_m": argoverse2["fde"][:, 0],
        "min_ade_6_m": argoverse2["ade"].min(axis=1),
        "min_fde_6_m": argoverse2["fde"].min(axis=1),
        "miss_rate_6": missed,
        "brier_min_fde_6_m": argoverse2["brier_fde"][best],
    }
    assert np.abs(METRIC_OF[name].of_samples(hypotheses, scored(truth)) - expected[name]).max() < 1e-9
    assert 0.2 < missed.mean() < 0.8, "both kinds are there"


TIMES_S = future_times_s()


@pytest.fixture(scope="module")
def samples(straight_road):
    """A vehicle at (30, −5.25) that drives 10 m/s along x."""
    one = samples_of(
        record_with({1: moving(0.0, -5.25, 10.0, steps=161)}, straight_road), HistoryWindow(), Population.ALL
    )
    return one.select(np.array([0]))


def value(samples, x_m, y_m) -> float:
    path = samples.batch.xy_m[:, None] + np.stack((x_m, y_m), axis=-1)[None]
    return float(infeasible(Hypotheses.certain(path), samples)[0])


def speed_change(acceleration: float):
    """The way of a vehicle that brakes to a standstill, or speeds up."""
    until = np.minimum(TIMES_S, 10.0 / -acceleration) if acceleration < 0.0 else TIMES_S
    return 10.0 * until + 0.5 * acceleration * until**2


@pytest.mark.parametrize(("acceleration", "expected"), [(0.0, 0.0), (-8.0, 0.0), (5.0, 0.0), (-10.0, 1.0), (9.5, 1.0)])
def test_tyres_carry_so_much(samples, acceleration, expected) -> None:
    assert value(samples, speed_change(acceleration), 0.0 * TIMES_S) == expected


@pytest.mark.parametrize(("radius", "expected"), [(1.05 * 100.0 / ACCELERATION_MAX_MPS2, 0.0), (10.0, 1.0)])
def test_a_bend_at_speed_needs_acceleration_too(samples, radius, expected) -> None:
    """At 10 m/s the smallest circle has 11.3 m."""
    angle = 10.0 * TIMES_S / radius
    assert value(samples, radius * np.sin(angle), radius * (1.0 - np.cos(angle))) == expected


@pytest.mark.parametrize(("radius", "expected"), [(1.1 * RADIUS_MIN_M, 0.0), (0.8 * RADIUS_MIN_M, 1.0)])
def test_a_slow_car_turns_no_tighter_than_its_steering(straight_road, radius, expected) -> None:
    slow = samples_of(
        record_with({1: moving(0.0, -5.25, 3.0, steps=161)}, straight_road), HistoryWindow(), Population.ALL
    )
    angle = 3.0 * TIMES_S / radius
    assert value(slow.select(np.array([0])), radius * np.sin(angle), radius * (1.0 - np.cos(angle))) == expected


def test_a_path_that_begins_with_another_velocity_is_none(samples) -> None:
    assert value(samples, 14.0 * TIMES_S, 0.0 * TIMES_S) == 1.0
    assert value(samples, 10.2 * TIMES_S, 0.0 * TIMES_S) == 0.0


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


def test_one_vehicle_is_a_world_of_its_own() -> None:
    ade, fde = world([[3.0, 1.0], [0.5, 2.0]], [0, 1])
    assert ade.tolist() == pytest.approx([1.0, 0.5])
    assert fde.tolist() == pytest.approx([1.0, 0.5])


def test_only_six_worlds_count() -> None:
    assert world([[9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 0.0]], [0])[0].tolist() == pytest.approx([4.0])


def test_the_end_and_the_mean_over_time_differ() -> None:
    truth = np.zeros((1, 25, 2))
    path = np.zeros((1, 1, 25, 2))
    path[..., 0] = np.arange(1, 26)
    hypotheses, samples = Hypotheses(path, np.ones((1, 1))), scored(truth, [0])
    assert world_min_ade_6(hypotheses, samples).tolist() == [13.0]
    assert world_min_fde_6(hypotheses, samples).tolist() == [25.0]


def test_without_samples_no_frame_has_a_value() -> None:
    hypotheses = Hypotheses(np.zeros((0, 1, 25, 2)), np.zeros((0, 1)))
    assert world_min_fde_6(hypotheses, scored(np.zeros((0, 25, 2)))).shape == (0,)


def rates(straight_road, y_m, aside_mps=0.0, along_mps=5.0, yaw_rad=0.0):
    record = record_with({1: moving(60.0, y_m, along_mps, 0.0, yaw_rad, steps=161)}, straight_road)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    velocity = np.array([along_mps * np.cos(yaw_rad), aside_mps + along_mps * np.sin(yaw_rad)])
    hypotheses = Hypotheses.certain(samples.batch.xy_m[:, None] + TIMES_S[:, None] * velocity)
    return float(off_road(hypotheses, samples)[0]), float(wrong_way(hypotheses, samples)[0])


def test_a_vehicle_that_keeps_its_lane_is_on_the_road_and_the_right_way(straight_road) -> None:
    assert rates(straight_road, -5.25) == (0.0, 0.0)
    assert rates(straight_road, -1.75) == (0.0, 0.0)


def test_a_path_beyond_the_edge_is_off_the_road(straight_road) -> None:
    assert rates(straight_road, -5.25, aside_mps=-3.0)[0] == 1.0
    assert rates(straight_road, -5.25, aside_mps=-0.2)[0] == 0.0, "1 m to the side stays in the lane"


def test_a_vehicle_off_the_road_says_nothing(straight_road) -> None:
    assert np.isnan(rates(straight_road, -60.0)[0])


def test_a_path_back_along_the_lane_is_the_wrong_way(straight_road) -> None:
    record = record_with({1: moving(60.0, -5.25, 5.0, steps=161)}, straight_road)
    samples = samples_of(record, HistoryWindow(), Population.ALL).select(np.array([0]))
    back = Hypotheses.certain(samples.batch.xy_m[:, None] - TIMES_S[:, None] * np.array([5.0, 0.0]))
    assert wrong_way(back, samples).tolist() == [1.0]
    stands = Hypotheses.certain(np.repeat(samples.batch.xy_m[:, None], 25, axis=1))
    assert wrong_way(stands, samples).tolist() == [0.0]


def test_a_vehicle_that_is_against_its_lane_at_present_says_nothing(straight_road) -> None:
    assert np.isnan(rates(straight_road, -5.25, yaw_rad=np.pi)[1])


def test_the_truth_of_an_episode_keeps_to_the_road(straight_road) -> None:
    tracks = {number: moving(20.0 * number, -5.25, 6.0, 0.1, steps=181) for number in range(1, 4)}
    samples = samples_of(record_with(tracks, straight_road), HistoryWindow(), Population.ALL)
    truth = Hypotheses.certain(samples.future_xy_m)
    assert off_road(truth, samples).tolist() == [0.0] * len(samples)
    assert wrong_way(truth, samples).tolist() == [0.0] * len(samples)


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


def test_lanes_have_the_directions_within_90_degrees(straight_road) -> None:
    raster = road_raster(straight_road)
    assert raster is not None
    lane = straight_road.lanes[0]
    middle = lane.centre.at(0.5 * lane.length_m)
    assert lane.centre.heading_rad(1.0) == pytest.approx(0.0)
    assert raster.directions[raster.cells(middle)] == sum(1 << sector for sector in (6, 7, 0, 1, 2))
