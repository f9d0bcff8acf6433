import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from siren_ros.sensing.camera.antialiasing import smooth_edges

SIZE = 64
DARK, BRIGHT = np.array([20, 40, 60, 3]), np.array([220, 200, 180, 7])


def picture(is_bright):
    return np.where(is_bright[..., None], BRIGHT, DARK).astype(np.uint8)


def smoothed(rgba):
    out = np.array(rgba, order="C")
    smooth_edges(out)
    return out


def places(samples):
    """Rows and columns of sample points, ``samples`` along each side of a pixel."""
    along = (np.arange(SIZE * samples) + 0.5) / samples
    return np.meshgrid(along, along, indexing="ij")


HALF_RAD = np.arctan(0.5)


def errors_of_edge(slant_rad, octant, offset):
    """Sums of the errors of a straight edge before and after."""
    turn_rad = octant // 2 * np.pi / 2 + (slant_rad if octant % 2 else -slant_rad)

    def bright(samples):
        y, x = places(samples)
        return (x - SIZE / 2) * np.cos(turn_rad) + (y - SIZE / 2) * np.sin(turn_rad) > offset

    fine = bright(16).reshape(SIZE, 16, SIZE, 16).mean(axis=(1, 3))
    true = DARK[0] + fine * (BRIGHT[0] - DARK[0])
    drawn = picture(bright(1))
    inner = np.s_[8:-8, 8:-8]
    return [np.abs(p[..., 0] - true)[inner].sum() for p in (drawn, smoothed(drawn))]


@settings(max_examples=40, deadline=None)
@given(st.floats(0.06, 0.7), st.integers(0, 7), st.floats(-8.0, 8.0))
def test_a_straight_edge_comes_nearer_to_its_true_coverage(slant_rad, octant, offset):
    """Most where the edge is nearly level; at 45 degrees its steps have the least length."""
    assume(abs(slant_rad - HALF_RAD) > 0.005)  # the next test's
    before, after = errors_of_edge(slant_rad, octant, offset)
    assert after <= 0.75 * before


@pytest.mark.parametrize("octant", range(8))
def test_an_edge_whose_steps_are_all_alike_comes_nearer_by_a_fifth(octant):
    """On an edge with a slope of 1/2 all steps have two pixels, and on some of them the same error each."""
    ratios = []
    for offset in np.arange(-8.0, 8.0, 0.25):
        before, after = errors_of_edge(HALF_RAD, octant, offset)
        ratios.append(after / before)
    assert max(ratios) <= 0.8 + 1e-9


@pytest.mark.parametrize("block", [np.s_[10:40, :], np.s_[:, 10:40], np.s_[10:40, 12:13], np.s_[10:30, 20:50]])
def test_edges_along_rows_and_columns_and_their_corners_stay_sharp(block):
    shape = np.zeros((SIZE, SIZE), bool)
    shape[block] = True
    assert np.array_equal(smoothed(picture(shape)), picture(shape))


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_rows_are_treated_as_columns_and_labels_stay(seed):
    rng = np.random.default_rng(seed)
    drawn = picture(gaussian_filter(rng.standard_normal((SIZE, SIZE)), 4.0) > 0.0)
    out = smoothed(drawn)
    assert (out[..., :3] != drawn[..., :3]).any()
    assert np.array_equal(out[..., 3], drawn[..., 3])
    for turn in (lambda p: p.transpose(1, 0, 2), lambda p: p[:, ::-1], lambda p: p[::-1]):
        assert np.abs(turn(smoothed(turn(drawn))).astype(int) - out).max() <= 2


def test_faint_differences_are_left_as_they_are():
    drawn = np.full((SIZE, SIZE, 4), 100, np.uint8)
    drawn[np.tri(SIZE, dtype=bool)] += 15
    assert np.array_equal(smoothed(drawn), drawn)
