from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from published_files import golden, golden_cells

from siren_ros.evaluation.prediction.published.behaviour import behaviour_tensor, behaviours, closeness_centralities

NEAR, FAR = 5.0, 100.0


def centralities(*points: tuple[float, float]) -> Any:
    return closeness_centralities(np.array(points)[None, None])[0, 0]


def test_vertices_that_all_join_are_as_close_as_can_be() -> None:
    assert centralities((0.0, 0.0), (0.0, 0.1), (0.1, 0.0)).tolist() == [1.0, 1.0, 1.0]


def test_a_chain_has_a_middle() -> None:
    chain = [(0.0, NEAR * place) for place in range(4)]
    assert centralities(*chain) == pytest.approx([3 / 6, 3 / 4, 3 / 4, 3 / 6])


def test_parts_count_by_their_size() -> None:
    # Each reaches one of three others, at one hop: 1/1, scaled by 1/3.
    pairs = [(0.0, 0.0), (0.0, NEAR), (FAR, 0.0), (FAR, NEAR)]
    assert centralities(*pairs) == pytest.approx([1 / 3] * 4)
    assert centralities((0.0, 0.0), (FAR, 0.0)).tolist() == [0.0, 0.0]


def test_vertices_join_where_the_rounded_weight_is_not_zero() -> None:
    assert centralities((0.0, 0.0), (5.29, 0.0)).tolist() == [1.0, 1.0]
    assert centralities((0.0, 0.0), (5.30, 0.0)).tolist() == [0.0, 0.0]
    assert round(float(np.exp(-5.29)), 2) == 0.01
    assert round(float(np.exp(-5.30)), 2) == 0.0


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), reach_ft=st.floats(1.0, 60.0))
def test_closeness_is_networkxs(seed: int, reach_ft: float) -> None:
    networkx = pytest.importorskip("networkx")
    points = np.random.default_rng(seed).uniform(0.0, reach_ft, (2, 2, 39, 2)).round(2)
    found = closeness_centralities(points)
    for sample, graph in np.ndindex(2, 2):
        apart = np.hypot(*np.moveaxis(points[sample, graph][:, None] - points[sample, graph], -1, 0))
        reference = networkx.closeness_centrality(networkx.from_numpy_array((-np.exp(-apart)).round(2)))
        assert found[sample, graph] == pytest.approx([reference[vertex] for vertex in range(39)])


def test_a_target_alone_that_stands_still_joins_all_empty_cells() -> None:
    nobody = np.empty(0, dtype=np.intp)
    found = behaviour_tensor(np.zeros((2, 16, 2)), np.empty((0, 16, 2)), nobody, nobody)
    assert found.shape == (16, 2, 39, 6)
    assert (found[..., :3] == 0.0).all()
    assert (found[..., 3:] == 1.0).all()


def test_the_target_hides_a_neighbour_in_cell_20() -> None:
    own, other = np.zeros((1, 16, 2)), np.full((1, 16, 2), FAR)
    hidden = behaviour_tensor(own, other, np.array([0]), np.array([20]))
    seen = behaviour_tensor(own, other, np.array([0]), np.array([21]))
    assert (hidden[..., 3] == 1.0).all()
    assert (seen[..., 3] < 1.0).any()


@pytest.mark.parametrize(("away_ft", "joined"), [(5.294, True), (5.296, False)])
def test_positions_are_rounded_to_hundredths_of_a_foot(away_ft: float, *, joined: bool) -> None:
    """Vertices join up to 5.298 feet; 5.296 counts as 5.30 and 5.294 as 5.29."""
    own, other = np.zeros((1, 16, 2)), np.full((1, 16, 2), (away_ft, 0.0))
    found = behaviour_tensor(own, other, np.array([0]), np.array([3]))
    assert bool((found[..., 3:] == 1.0).all()) is joined


def test_cells_and_points_are_listed_by_cell_and_read_by_point() -> None:
    """Of one neighbour in cell 5 the list holds 16 points from place 80 on: graph 2 has the places 78 to 116."""
    own, other = np.zeros((1, 16, 2)), np.full((1, 16, 2), FAR)
    found = behaviour_tensor(own, other, np.array([0]), np.array([5]))[:, 0, :, 3]
    apart = np.isclose(found, round(15 / 38, 2))
    assert np.argwhere(apart).tolist() == [[2, vertex] for vertex in range(2, 18)]
    # The others of that graph reach 22 of 38 at one hop, and nobody else's neighbours are missing.
    rest = np.isclose(found[2], round(22 / 38, 2))
    assert np.flatnonzero(rest).tolist() == [0, 1, *range(18, 39)]
    assert (np.delete(found, 2, axis=0) == 1.0).all()


def test_it_is_the_published_tensor_up_to_the_order_of_graphs() -> None:
    known = golden("bat")
    sample, cell = golden_cells(known)
    own, others = (known[name].swapaxes(0, 1).astype(np.float64) for name in ("hist", "nbrs"))
    grid = np.zeros((len(own), 39, 16, 2))
    grid[sample, cell] = others
    grid[:, 20] = own
    closeness = closeness_centralities(np.round(grid, 2).reshape(-1, 16, 39, 2))
    published = known["behaviour"][..., 3].swapaxes(0, 1)
    # The published loader's threads have finished in some order: the row that each of its graphs is.
    apart = np.abs(np.round(closeness, 2)[:, None].astype(np.float32) - published[:, :, None]).max(axis=-1)
    in_that_order = np.take_along_axis(closeness, apart.argmin(axis=2)[..., None], axis=1)
    assert np.array_equal(behaviours(in_that_order), known["behaviour"])
    in_order = behaviour_tensor(own, others, sample, cell)
    assert np.array_equal(np.sort(in_order[..., 3].sum(axis=-1), axis=0), np.sort(published.sum(axis=-1).T, axis=0))


def test_columns_of_made_centralities() -> None:
    """Closeness in hundredths stands in the last three, the mixed-up changes in the second, and nothing elsewhere."""
    closeness = np.random.default_rng(0).uniform(0.0, 1.0, (2, 16, 39))
    found = behaviours(closeness)
    assert found.shape == (16, 2, 39, 6)
    assert not found[..., [0, 2]].any()
    for sample, point, cell in ((0, 0, 0), (1, 3, 7), (1, 15, 38), (0, 9, 20), (1, 0, 15), (0, 0, 16)):
        expected = round(float(closeness[sample, point, cell]), 2)
        assert found[point, sample, cell, 3:] == pytest.approx([expected] * 3)
        vertex, graph = divmod(39 * point + cell, 16)
        along = closeness[sample, graph]
        change = 0.0 if vertex == 38 else float(along[vertex + 1] - along[vertex])
        assert found[point, sample, cell, 1] == pytest.approx(round(change, 2), abs=1e-6)
