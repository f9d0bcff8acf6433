"""The projections of the sun's shadows and of the light on the ground."""

import numpy as np
import pytest

from siren_ros.sensors.camera.ground_light import (
    LIGHT_GRID_M,
    LIGHT_HALF_M,
    UNIT_FROM_CLIP,
    cell_of,
    light_from_map,
    sun_view,
)

CENTRE = (30.0, -12.0)


@pytest.mark.parametrize(
    ("point", "texture"),
    [
        (CENTRE, (0.5, 0.5)),
        ((30.0 + LIGHT_HALF_M, -12.0 - LIGHT_HALF_M), (1.0, 0.0)),
        ((30.0 - LIGHT_HALF_M, -12.0), (0.0, 0.5)),
    ],
)
def test_the_square_of_light_is_the_whole_texture(point, texture):
    scale, x, y = light_from_map(CENTRE)
    assert (scale * point[0] + x, scale * point[1] + y) == pytest.approx(texture)


def test_the_nearest_grid_point_gives_the_light():
    assert cell_of(np.array([2.4 * LIGHT_GRID_M, -0.6 * LIGHT_GRID_M, 9.0])) == (2, -1)


def sun(elevation_deg, azimuth_deg):
    e, a = np.radians((elevation_deg, azimuth_deg))
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


@pytest.mark.parametrize("direction", [(60.0, 0.0), (35.0, 130.0), (80.0, -60.0), (90.0, 0.0)])
def test_the_view_along_the_sun_holds_the_square_and_what_shades_it(direction):
    """Points along one ray of the sun fall on one texel, the nearer to the sun in front."""
    towards = sun(*direction)
    view = sun_view(towards, CENTRE, 40.0, (0.0, 25.0))

    def seen(point):
        return (view @ np.array([*point, 1.0]))[:3]

    corners = [(CENTRE[0] + sx * 40.0, CENTRE[1] + sy * 40.0, 0.0) for sx in (-1, 1) for sy in (-1, 1)]
    projected = np.array([seen(corner) for corner in corners])
    assert np.abs(projected[:, :2]).max(axis=0) == pytest.approx([1.0, 1.0])
    assert seen((*CENTRE, 0.0))[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    for corner in corners:
        low = np.array(corner)
        high = low + towards * 25.0 / towards[2]
        assert seen(high)[:2] == pytest.approx(seen(low)[:2], abs=1e-9)
        assert -1.0 <= seen(high)[2] < seen(low)[2] <= 1.0
    unit = UNIT_FROM_CLIP @ view @ np.array([*CENTRE, 0.0, 1.0])
    assert unit[:2] == pytest.approx([0.5, 0.5])
    assert unit[2] == pytest.approx(0.5 + 0.5 * seen((*CENTRE, 0.0))[2])
