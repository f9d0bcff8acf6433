"""CSP, STDAN and BAT as predictors: their inputs; on the map, and by the command; the order of modes and points."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

torch = pytest.importorskip("torch", reason="torch is not installed: ./env --with models pytest")

from busy_record import busy_record
from known_outputs import assert_known
from made_records import Track, moving, samples_in
from plain_networks import drawn, drawn_weights
from published_files import WEIGHTS, golden, golden_cells, weights

from siren_ros.cli.main import main
from siren_ros.data.datasets.trajectory_tables import FOOT_M
from siren_ros.scoring.evaluation.prediction.predictors import Predictor, checked, predictors_named
from siren_ros.scoring.evaluation.prediction.published import predictors
from siren_ros.scoring.evaluation.prediction.published.networks import (
    Bat,
    BatInput,
    Csp,
    Neighbours,
    NetworkInput,
    Stdan,
)
from siren_ros.scoring.evaluation.prediction.published.predictors import (
    NgsimView,
    PublishedPredictor,
    bat_features,
    behaviour_tensor,
    behaviours,
    closeness_centralities,
    csp_features,
    make_bat,
    make_csp,
    make_stdan,
    ngsim_view,
    polar,
    positions_ft,
    stdan_features,
)
from siren_ros.scoring.evaluation.prediction.samples import HistoryWindow, Population, SampleBatch, samples_of
from siren_ros.simulation.roads.road_network import RoadNetwork
from siren_ros.simulation.world.actors import ActorClass

RIGHT_LANE, LEFT_LANE, OPPOSITE_LANE = -5.25, -1.75, 1.75
OFF_THE_LANES = 500.0


def view_of(tracks: dict[int, Track], network: RoadNetwork) -> NgsimView:
    return ngsim_view(samples_in(tracks, network).batch)


def cells_of(view: NgsimView, target: int) -> dict[int, int]:
    """Cells of the neighbours of an actor in the first frame, by the neighbour's id."""
    first = (view.actors.actor_id[view.target] == target) & (view.actors.frame[view.target] == 0)
    pairs = np.isin(view.sample, np.flatnonzero(first))
    ids = view.actors.actor_id[view.neighbour[pairs]]
    return dict(zip(ids.tolist(), view.cell[pairs].tolist(), strict=True))


def standing(feet_ahead: float, lane_y_m: float = LEFT_LANE, yaw_rad: float = 0.0) -> Track:
    """A vehicle that stands some feet ahead of x = 100 m."""
    return moving(100.0 + feet_ahead * FOOT_M, lane_y_m, 0.0, yaw_rad=yaw_rad)


def test_neighbours_are_in_their_cells(straight_road) -> None:
    tracks = {
        1: standing(0.0),
        2: standing(30.0),
        3: standing(-46.0, RIGHT_LANE),
        4: standing(0.0, RIGHT_LANE),
        5: standing(91.0),
        6: standing(10.0, OPPOSITE_LANE, np.pi),
    }
    view = view_of(tracks, straight_road)
    assert cells_of(view, 1) == {2: 13 + 8, 3: 26 + 3, 4: 26 + 6}
    # Seen from the right lane, the left one is the first column.
    assert cells_of(view, 4) == {1: 6, 2: 8, 3: 13 + 3}
    # The vehicle that comes towards them has left and right the other way round, and nobody of its direction.
    assert cells_of(view, 6) == {}


def test_a_neighbour_without_a_whole_past_is_left_out_and_the_later_of_two_takes_the_cell(straight_road) -> None:
    late, gap = moving(120.0, LEFT_LANE, 0.0, first_step=2), moving(80.0, LEFT_LANE, 0.0, without=frozenset({20}))
    assert cells_of(view_of({1: standing(0.0), 2: late, 3: gap}, straight_road), 1) == {}
    two = {1: standing(29.0), 2: standing(0.0), 3: standing(31.0)}
    assert cells_of(view_of(two, straight_road), 2) == {3: 13 + 8}


def test_on_a_lane_ahead_is_along_the_lane_whatever_the_heading(straight_road) -> None:
    tracks = {1: moving(100.0, LEFT_LANE, 0.5, yaw_rad=0.3), 2: moving(110.0, LEFT_LANE, 0.0)}
    view = view_of(tracks, straight_road)
    row = np.flatnonzero((view.actors.actor_id[view.target] == 1) & (view.actors.frame[view.target] == 0))
    assert view.tangent_rad[row] == pytest.approx([0.0])
    past = view.right_ahead_m(view.target[row], row)[0]
    time = np.arange(-15, 1) * 0.2
    assert past == pytest.approx(np.stack((-0.5 * np.sin(0.3) * time, 0.5 * np.cos(0.3) * time), axis=1))


@settings(max_examples=20, deadline=None)
@given(yaw_rad=st.floats(-np.pi, np.pi), speed_mps=st.floats(1.0, 20.0))
def test_off_the_lanes_ahead_is_the_heading(yaw_rad, speed_mps, straight_road) -> None:
    across = np.array([-np.sin(yaw_rad), np.cos(yaw_rad)])
    left_x, left_y = 3.5 * across
    tracks = {
        1: moving(0.0, OFF_THE_LANES, speed_mps, yaw_rad=yaw_rad),
        2: moving(left_x, OFF_THE_LANES + left_y, speed_mps, yaw_rad=yaw_rad),
    }
    view = view_of(tracks, straight_road)
    assert cells_of(view, 1) == {2: 6}
    assert cells_of(view, 2) == {1: 26 + 6}
    past = view.right_ahead_m(view.target, np.arange(len(view)))
    straight = np.stack((np.zeros(16), speed_mps * np.arange(-15, 1) * 0.2), axis=-1)
    assert past == pytest.approx(np.broadcast_to(straight, past.shape), abs=1e-9)
    assert view.on_map(past) == pytest.approx(view.actors.xy_m[view.target]), "and back"
    alongside = view.right_ahead_m(view.neighbour, view.sample) - straight
    side = np.where(view.actors.actor_id[view.neighbour] == 2, -3.5, 3.5)
    assert alongside[..., 0] == pytest.approx(np.broadcast_to(side[:, None], alongside.shape[:2]), abs=1e-9)
    assert alongside[..., 1] == pytest.approx(0.0, abs=1e-9)


def test_parts_are_whole_frames_and_make_the_view(straight_road) -> None:
    tracks = {key: moving(40.0 + 9.0 * key, RIGHT_LANE, 3.0) for key in (1, 2, 3)}
    view = view_of(tracks, straight_road)
    assert view.scene.tolist() == np.repeat(np.arange(len(view) // 3), 3).tolist()
    parts = list(view.parts(4))
    assert [len(part) for part in parts] == [6] * (len(view) // 6) + [len(view) % 6] * (len(view) % 6 > 0)
    assert np.concatenate([part.target for part in parts]).tolist() == view.target.tolist()
    assert np.concatenate([part.neighbour for part in parts]).tolist() == view.neighbour.tolist()
    assert np.concatenate([part.cell for part in parts]).tolist() == view.cell.tolist()
    assert np.concatenate([part.target[part.sample] for part in parts]).tolist() == view.target[view.sample].tolist()
    assert all(part.scene[0] == 0 for part in parts)
    assert list(view_of({1: moving(0.0, RIGHT_LANE, 5.0, steps=20)}, straight_road).parts(8)) == []


TIMES_S = np.arange(-15, 1) * 0.2


@pytest.fixture
def pair(straight_road: RoadNetwork) -> NgsimView:
    """A car in the right lane, and a truck 6.096 m (20 feet) ahead in the left one, which accelerates."""
    truck = moving(26.096, -1.75, 3.048, accel_mps2=0.3048, actor_class=ActorClass.TRUCK)
    return view_of({1: moving(20.0, -5.25, 6.096), 2: truck}, straight_road)


def test_csp_gets_feet_to_the_right_and_ahead(pair) -> None:
    features, others = csp_features(pair)
    assert features.dtype == np.float32
    assert features.shape == (16, len(pair), 2)
    assert features[:, 0] == pytest.approx(np.stack((np.zeros(16), 20.0 * TIMES_S), axis=1), abs=1e-4)
    # At the first present, 3 s into the record: 20 + 10 * 3 + 0.5 * 3² − 20 * 3 feet ahead.
    assert others[-1, 0] == pytest.approx([-3.5 / FOOT_M, -5.5], abs=1e-4)


def test_stdan_gets_class_speed_and_acceleration_too(pair) -> None:
    features, others = stdan_features(pair)
    assert np.array_equal(features[..., :2], csp_features(pair)[0])
    assert features[:, 0, 2:] == pytest.approx(np.tile([2.0, 20.0, 0.0], (16, 1)))
    truck = np.stack((np.full(16, 3.0), 10.0 + 3.0 + TIMES_S, np.ones(16)), axis=1)
    assert others[:, 0, 2:] == pytest.approx(truck, abs=1e-5)


def test_bat_gets_polar_positions_displacements_and_lanes(pair) -> None:
    features, others = bat_features(pair)
    assert features[:, 0, 0] == pytest.approx(-20.0 * TIMES_S, abs=1e-4)
    assert features[:-1, 0, 1] == pytest.approx(-np.pi / 2, abs=1e-6)
    assert features[-1, 0, :2].tolist() == [0.0, 0.0]
    assert features[0, 0, 2:4].tolist() == [0.0, 0.0]
    assert features[1:, 0, 2:4] == pytest.approx(np.tile([0.0, 4.0], (15, 1)), abs=1e-4)
    assert np.array_equal(features[..., 4:7], stdan_features(pair)[0][..., 2:])
    # Lanes are counted from the left.
    assert (features[:, 0, 7] == 2.0).all()
    assert (others[:, 0, 7] == 1.0).all()


def test_lanes_of_the_past_are_those_of_then(straight_road) -> None:
    drift = moving(10.0, -5.25, 5.0)
    drift.states[:, 1] = np.where(np.arange(len(drift.states)) < 45, -5.25, -1.75)
    features, _ = bat_features(view_of({1: drift}, straight_road))
    # The first present is step 60: the points before step 45 are in the right lane.
    assert features[:, 0, 7].tolist() == [2.0] * 12 + [1.0] * 4


@given(yaw_rad=st.sampled_from([0.0, 0.7, 2.0, -2.0, np.pi, -np.pi / 2]))
def test_a_vehicle_that_stands_off_the_lanes_has_no_direction_and_no_lane(yaw_rad, straight_road) -> None:
    features, _ = bat_features(view_of({1: moving(3.0, 500.0, 0.0, yaw_rad=yaw_rad)}, straight_road))
    assert (features[..., [0, 1, 2, 3, 7]] == 0.0).all()


NEAR, FAR = 5.0, 100.0


@pytest.mark.parametrize(
    ("points", "closeness"),
    [
        ([(0.0, 0.0), (0.0, 0.1), (0.1, 0.0)], [1.0, 1.0, 1.0]),
        ([(0.0, NEAR * place) for place in range(4)], [3 / 6, 3 / 4, 3 / 4, 3 / 6]),
        # Each reaches one of three others, at one hop: 1/1, scaled by 1/3.
        ([(0.0, 0.0), (0.0, NEAR), (FAR, 0.0), (FAR, NEAR)], [1 / 3] * 4),
        ([(0.0, 0.0), (FAR, 0.0)], [0.0, 0.0]),
        # exp(−5.29) rounds to 0.01, and exp(−5.30) to 0.
        ([(0.0, 0.0), (5.29, 0.0)], [1.0, 1.0]),
        ([(0.0, 0.0), (5.30, 0.0)], [0.0, 0.0]),
    ],
)
def test_closeness_by_hand(points, closeness) -> None:
    assert closeness_centralities(np.array(points)[None, None])[0, 0] == pytest.approx(closeness)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), reach_ft=st.floats(1.0, 60.0))
def test_closeness_is_networkxs(seed, reach_ft) -> None:
    networkx = pytest.importorskip("networkx")
    points = np.random.default_rng(seed).uniform(0.0, reach_ft, (2, 2, 39, 2)).round(2)
    closeness = closeness_centralities(points)
    for sample, graph in np.ndindex(2, 2):
        apart = np.hypot(*np.moveaxis(points[sample, graph][:, None] - points[sample, graph], -1, 0))
        reference = networkx.closeness_centrality(networkx.from_numpy_array((-np.exp(-apart)).round(2)))
        assert closeness[sample, graph] == pytest.approx([reference[vertex] for vertex in range(39)])


def test_a_target_alone_that_stands_still_joins_all_empty_cells() -> None:
    nobody = np.empty(0, dtype=np.intp)
    tensor = behaviour_tensor(np.zeros((2, 16, 2)), np.empty((0, 16, 2)), nobody, nobody)
    assert tensor.shape == (16, 2, 39, 6)
    assert (tensor[..., :3] == 0.0).all()
    assert (tensor[..., 3:] == 1.0).all()


def with_neighbour(r_ft: float, phi_rad: float, cell: int) -> np.ndarray:
    """The tensor of a target that stands, with a neighbour that stands."""
    return behaviour_tensor(np.zeros((1, 16, 2)), np.full((1, 16, 2), (r_ft, phi_rad)), np.array([0]), np.array([cell]))


def test_the_target_hides_a_neighbour_in_cell_20_and_positions_are_rounded_to_hundredths_of_a_foot() -> None:
    """Vertices join up to 5.298 feet; 5.296 counts as 5.30 and 5.294 as 5.29."""
    for away_ft, phi_rad, cell, joined in (
        (FAR, FAR, 20, 1),
        (FAR, FAR, 21, 0),
        (5.294, 0.0, 3, 1),
        (5.296, 0.0, 3, 0),
    ):
        assert (with_neighbour(away_ft, phi_rad, cell)[..., 3:] == 1.0).all() == joined


def test_cells_and_points_are_listed_by_cell_and_read_by_point() -> None:
    """Of one neighbour in cell 5 the list holds 16 points from place 80 on: graph 2 has the places 78 to 116."""
    tensor = with_neighbour(FAR, FAR, cell=5)[:, 0, :, 3]
    apart = np.isclose(tensor, round(15 / 38, 2))
    assert np.argwhere(apart).tolist() == [[2, vertex] for vertex in range(2, 18)]
    # The others of that graph reach 22 of 38 at one hop, and nobody else's neighbours are missing.
    rest = np.isclose(tensor[2], round(22 / 38, 2))
    assert np.flatnonzero(rest).tolist() == [0, 1, *range(18, 39)]
    assert (np.delete(tensor, 2, axis=0) == 1.0).all()


def test_it_is_the_published_tensor_up_to_the_order_of_graphs() -> None:
    known = golden("bat")
    sample, cell = golden_cells(known)
    targets, others = (known[name].swapaxes(0, 1).astype(np.float64) for name in ("hist", "nbrs"))
    grid = np.zeros((len(targets), 39, 16, 2))
    grid[sample, cell] = others
    grid[:, 20] = targets
    closeness = closeness_centralities(np.round(grid, 2).reshape(-1, 16, 39, 2))
    published = known["behaviour"][..., 3].swapaxes(0, 1)
    # The published loader's threads have finished in some order: the row that each of its graphs is.
    apart = np.abs(np.round(closeness, 2)[:, None].astype(np.float32) - published[:, :, None]).max(axis=-1)
    in_that_order = np.take_along_axis(closeness, apart.argmin(axis=2)[..., None], axis=1)
    assert np.array_equal(behaviours(in_that_order), known["behaviour"])
    in_order = behaviour_tensor(targets, others, sample, cell)
    assert np.array_equal(np.sort(in_order[..., 3].sum(axis=-1), axis=0), np.sort(published.sum(axis=-1).T, axis=0))


def test_columns_of_made_centralities() -> None:
    """Closeness in hundredths stands in the last three, the mixed-up changes in the second, and nothing elsewhere."""
    closeness = np.random.default_rng(0).uniform(0.0, 1.0, (2, 16, 39))
    tensor = behaviours(closeness)
    assert tensor.shape == (16, 2, 39, 6)
    assert not tensor[..., [0, 2]].any()
    for sample, point, cell in ((0, 0, 0), (1, 3, 7), (1, 15, 38), (0, 9, 20), (1, 0, 15), (0, 0, 16)):
        expected = round(float(closeness[sample, point, cell]), 2)
        assert tensor[point, sample, cell, 3:] == pytest.approx([expected] * 3)
        vertex, graph = divmod(39 * point + cell, 16)
        along = closeness[sample, graph]
        change = 0.0 if vertex == 38 else float(along[vertex + 1] - along[vertex])
        assert tensor[point, sample, cell, 1] == pytest.approx(round(change, 2), abs=1e-6)


MODES = {"csp": 6, "stdan": 1, "bat": 9}


@pytest.fixture(params=WEIGHTS)
def model(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def predictor(model: str, tmp_path: Path) -> Predictor:
    return predictors_named([model], drawn_weights(model, tmp_path))[model]


def turned(places: np.ndarray, angle_rad: float) -> np.ndarray:
    """Places turned around (0, 500)."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = places[..., 0], places[..., 1] - 500.0
    return np.stack((cos * x - sin * y, sin * x + cos * y + 500.0), axis=-1)


def batch_of(tracks: dict[int, Track], network: RoadNetwork) -> SampleBatch:
    return samples_in(tracks, network).batch


def off_the_lanes(yaw_rad: float = 0.0) -> dict[int, Track]:
    """Three vehicles in a row at highway speed, and one in the lane to their left, all turned around (0, 500)."""
    places = turned(np.array([(0.0, 500.0), (26.0, 500.0), (52.0, 500.0), (12.0, 503.5)]), yaw_rad)
    vehicles = enumerate(zip(places, (22.0, 22.0, 21.0, 24.0), strict=True), start=1)
    return {key: moving(*place, speed, accel_mps2=0.1, yaw_rad=yaw_rad) for key, (place, speed) in vehicles}


def test_steady_traffic_is_predicted_to_go_on(model, straight_road) -> None:
    predictor = predictors_named([model], {model: weights(model)})[model]
    tracks = {key: moving(-25.0 + 25.0 * key, -5.25 + 3.5 * (key % 2), 15.0) for key in range(1, 7)}
    scored = samples_in(tracks, straight_road, predictor.window)
    hypotheses = checked(model, predictor.predict(scored.batch), len(scored))
    assert hypotheses.xy_m.shape == (len(scored), MODES[model], 25, 2)
    miss = np.linalg.norm(hypotheses.xy_m[:, 0] - scored.future_xy_m, axis=-1)
    # The vehicles go 75 m in that time; BAT is the worst of the three.
    assert miss.mean() < (4.0 if model == "bat" else 2.0)
    first = np.linalg.norm(hypotheses.xy_m[:, 0, 0] - scored.batch.xy_m, axis=-1)
    assert first == pytest.approx(3.0, abs=0.8)


def test_a_turned_world_is_predicted_turned(predictor, straight_road) -> None:
    angle_rad = -2.5
    straight = predictor.predict(batch_of(off_the_lanes(), straight_road))
    hypotheses = predictor.predict(batch_of(off_the_lanes(angle_rad), straight_road))
    assert np.abs(hypotheses.xy_m - turned(straight.xy_m, angle_rad)).max() < 0.02
    assert np.abs(hypotheses.probability - straight.probability).max() < 1e-3


def test_frames_are_predicted_one_by_one(predictor, straight_road, monkeypatch) -> None:
    batch = batch_of(off_the_lanes(), straight_road)
    whole = predictor.predict(batch)
    monkeypatch.setattr(predictors, "MOST_SAMPLES", 1)
    single = predictor.predict(batch)
    assert np.abs(whole.xy_m - single.xy_m).max() < 1e-3
    assert np.abs(whole.probability - single.probability).max() < 1e-5


@pytest.mark.parametrize("steps", [161, 20], ids=["one vehicle alone", "no sample"])
def test_few_vehicles_have_their_answers_too(model, predictor, straight_road, steps) -> None:
    batch = batch_of({1: moving(0.0, 500.0, 22.0, steps=steps)}, straight_road)
    assert len(checked(model, predictor.predict(batch), len(batch))) == len(batch) == steps // 160


@pytest.fixture
def batch(straight_road: RoadNetwork) -> SampleBatch:
    """Three vehicles eastwards at 10, 12 and 14 m/s, side by side and one behind."""
    places = [(20.0, -5.25, 10.0), (26.0, -1.75, 12.0), (8.0, -5.25, 14.0)]
    tracks = {key: moving(*place, accel_mps2=0.2) for key, place in enumerate(places, start=1)}
    return batch_of(tracks, straight_road)


def test_feet_to_the_right_and_ahead_are_metres_on_the_map(batch) -> None:
    """Two modes: 10 feet to the right, 100 ahead; 5 to the left, 200 ahead. The second is the likelier one."""

    def answer(view: NgsimView) -> Any:
        modes = np.broadcast_to(np.array([[10.0, 100.0], [-5.0, 200.0]])[None, :, None], (len(view), 2, 25, 2))
        return modes, np.tile([0.3, 0.7], (len(view), 1))

    hypotheses = PublishedPredictor(answer).predict(batch)
    assert hypotheses.probability[0].tolist() == [0.7, 0.3]
    # The road goes eastwards: ahead is +x, and the right is −y.
    for mode, (right_ft, ahead_ft) in enumerate([(-5.0, 200.0), (10.0, 100.0)]):
        expected = batch.xy_m + np.array([ahead_ft * FOOT_M, -right_ft * FOOT_M])
        assert hypotheses.xy_m[:, mode] == pytest.approx(np.repeat(expected[:, None], 25, axis=1))


def on_the_road(batch: SampleBatch, right_ahead_ft: Any) -> Any:
    """Places on the map of what a network says in feet, along a road that goes eastwards."""
    metres = np.asarray(right_ahead_ft, dtype=np.float64) * FOOT_M
    return batch.xy_m[:, None, None] + np.stack((metres[..., 1], -metres[..., 0]), axis=-1)


def assert_ranked(hypotheses: Any, batch: SampleBatch, modes_ft: Any, lateral: Any, longitudinal: Any) -> None:
    """Mode l + 3 k is that of the lateral manoeuvre l and the longitudinal manoeuvre k; the likeliest comes first."""
    places = on_the_road(batch, modes_ft)
    for sample in range(len(batch)):
        modes = range(len(modes_ft[0]))
        likely = np.array([float(lateral[sample, mode % 3] * longitudinal[sample, mode // 3]) for mode in modes])
        order = np.argsort(likely)[::-1]
        assert hypotheses.probability[sample] == pytest.approx(likely[order], abs=1e-6)
        assert hypotheses.xy_m[sample] == pytest.approx(places[sample, order], abs=1e-4)


@pytest.mark.parametrize(
    ("network", "make", "features_of"),
    [(Csp, make_csp, csp_features), (Stdan, make_stdan, stdan_features), (Bat, make_bat, bat_features)],
)
def test_answers_of_a_network_on_the_map(batch, tmp_path, network, make, features_of) -> None:
    """STDAN has one mode, which is sure; BAT's means are a distance and an angle from the right towards ahead."""
    saved, view = drawn(network()), ngsim_view(batch)
    torch.save(saved.state_dict(), tmp_path / "weights.pt")
    past, others = map(torch.from_numpy, features_of(view))
    given: Any = past, others, Neighbours(torch.from_numpy(view.sample), torch.from_numpy(view.cell), len(view))
    if network is Bat:
        targets, around = (polar(places) for places in positions_ft(view))
        behaviour = torch.from_numpy(behaviour_tensor(targets, around, view.sample, view.cell))
        given = BatInput(*given, behaviour, torch.from_numpy(view.scene))
    else:
        given = NetworkInput(*given)
    with torch.inference_mode():
        modes, lateral, longitudinal = saved(given)
    if network is Stdan:
        modes, lateral, longitudinal = modes[None], np.ones((len(batch), 3)), np.ones((len(batch), 3))
    means = modes[..., :2].double().numpy().transpose(2, 0, 1, 3)
    if network is Bat:
        means = means[..., :1] * np.stack((np.cos(means[..., 1]), np.sin(means[..., 1])), axis=-1)
    assert_ranked(make(tmp_path / "weights.pt").predict(batch), batch, means, lateral, longitudinal)


def test_without_a_checkpoint_or_with_another_ones_the_command_ends_with_one_line(tmp_path, capsys) -> None:
    torch.save({"op.weight": torch.zeros(5, 128)}, tmp_path / "other.pt")
    words = ["evaluate", "prediction", str(tmp_path), "--models", "csp"]
    assert main([*words, "--checkpoint", f"csp={tmp_path / 'other.pt'}"]) == 2
    error = capsys.readouterr().err.strip()
    assert "\n" not in error
    assert "other.pt" in error
    assert "21 of 22 missing, first ip_emb.weight" in error
    assert main(words) == 2
    assert "--checkpoint csp=PATH" in capsys.readouterr().err


WITHOUT_TORCH = """
import sys
from siren_ros.cli.main import main

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "torch":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
sys.exit(main(sys.argv[1:]))
"""


def test_without_torch_the_command_says_how_to_get_it(tmp_path) -> None:
    words = ["evaluate", "prediction", str(tmp_path), "--models", "csp", "--checkpoint", f"csp={tmp_path / 'x.pt'}"]
    command = [sys.executable, "-c", WITHOUT_TORCH, *words]
    ended = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert ended.returncode == 2
    assert len(ended.stderr.strip().splitlines()) == 1
    assert "./env --with models siren evaluate" in ended.stderr


def test_what_every_network_sees_and_answers_in_a_busy_episode(tmp_path: Path) -> None:
    """Features of three samples and of the first neighbours, and ways after 1, 3 and 5 s with drawn weights."""
    batch = samples_of(busy_record(), HistoryWindow(), Population.ALL).batch
    view = ngsim_view(batch)
    found: dict[str, object] = {
        "sample": view.sample[::97],
        "actor": view.actors.actor_id[view.neighbour[::97]],
        "cell": view.cell[::97],
        "tangent_rad": view.tangent_rad[3::150],
        "scene": view.scene[3::150],
    }
    for name, features in (("csp", csp_features), ("stdan", stdan_features), ("bat", bat_features)):
        targets, others = features(view)
        some = (one[::points, 3::300].reshape(-1, one.shape[-1]) for one, points in ((targets, 5), (others, 7)))
        found[f"{name} sees"] = list(some)
    targets, others = (polar(one) for one in positions_ft(view))
    tensor = behaviour_tensor(targets, others, view.sample, view.cell)
    found["behaviour"] = {"sum": tensor.sum(axis=(0, 1, 2)), "of one": tensor[::5, 3, ::13].reshape(-1, 6)}
    made = {"csp": (make_csp, Csp), "stdan": (make_stdan, Stdan), "bat": (make_bat, Bat)}
    for name, (make, network) in made.items():
        torch.save(drawn(network()).state_dict(), tmp_path / name)
        answer = make(tmp_path / name).predict(batch)
        ways = answer.xy_m[3::300, :3, 4::10] - batch.xy_m[3::300, None, None]
        found[f"{name} answers"] = ways.reshape(len(ways), -1), answer.probability[3::300]
    assert_known(Path(__file__).parent / "known" / "published.json", found, digits=4, decimals=4)
