import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from hand_made_record import crossing
from shapely.geometry import LineString, Point, box

from siren_ros.base.numerics.geometry import Polyline
from siren_ros.errors import InputError
from siren_ros.sensing.scene.kerbside import clear_pole
from siren_ros.sensing.scene.surfaces import (
    FreeSpace,
    SceneConfig,
    drawn_centres,
    junction_carriageway,
    ring_samples,
    road_surfaces,
)
from siren_ros.simulation.roads.road_network import LaneKind


def test_every_lane_lies_on_its_surface_and_regions_do_not_overlap(network):
    s = road_surfaces(network, drawn_centres(network, 0.0), SceneConfig())
    surface = {
        LaneKind.DRIVING: s.carriageway,
        LaneKind.INTERNAL: s.paved,
        LaneKind.SHOULDER: s.paved,
        LaneKind.SIDEWALK: s.sidewalk,
    }
    for lane in network.lanes:
        area = LineString(lane.centre.points).buffer(lane.width_m / 2 - 0.05, cap_style="flat")
        assert area.difference(surface[lane.kind]).area < 0.01 * area.area, lane.lane_id
    s = road_surfaces(network, drawn_centres(network, 0.0), SceneConfig())
    for region, other in itertools.combinations([s.carriageway, s.shoulder, s.sidewalk, s.median, s.verge], 2):
        assert region.intersection(other).area < 0.01


@pytest.mark.parametrize("length_m", [2.0, 5.0, 30.0])
def test_a_lane_that_ends_at_a_junction_is_paved_up_to_it_and_no_further(length_m):
    """Also one that is shorter than its two ends of 3 m, which count as part of the junctions there."""
    network = crossing()
    end = network.lanes[1].centre.points[-1]
    short = replace(network.lanes[1], centre=Polyline.through(np.array([end - (0.0, length_m), end])))
    alone = replace(network, lanes=(short,))
    around = shapely.box(-10.0, -20.0, 20.0, 10.0)
    assert junction_carriageway(alone, shapely.MultiPolygon(), around).area == pytest.approx(0.0, abs=1e-6)
    reaching = junction_carriageway(alone, shapely.MultiPolygon(), shapely.box(-10.0, -200.0, 20.0, 10.0))
    assert reaching.area == pytest.approx(3.5 * min(length_m, 2 * 3.0))


@pytest.mark.parametrize(
    ("name", "value"),
    [("tile_m", 0.0), ("kerb_height_m", -1.0), ("building_height_m", (9.0, 5.0)), ("tree_spacing_m", -2.0)],
)
def test_unusable_numbers_are_named(name, value):
    with pytest.raises(InputError, match=name):
        SceneConfig(**{name: value})


@pytest.fixture
def space():
    """Traffic between y = −5 and 5 m."""
    return FreeSpace(SimpleNamespace(keep_clear=box(-100.0, -5.0, 100.0, 5.0)))


def test_traffics_space_is_never_free_and_discs_do_not_overlap(space):
    assert not space.place_disc(0.0, 5.9, 1.0)
    assert space.place_disc(0.0, 6.1, 1.0)
    points = np.array([(0.0, 5.9), (0.0, 6.1), (0.0, -7.0)])
    assert space.clear_of_traffic(points, 1.0).tolist() == [False, True, True]
    assert [space.place_disc(x_m, 20.5, 1.0) for x_m in (19.5, 21.0, 21.6)] == [True, False, True]


def test_what_is_taken_is_taken_also_across_cells_and_the_first_clear_place_is_found(space):
    """Cells are 20 m wide: an area over several of them is found from each."""
    space.occupy(box(15.0, 30.0, 65.0, 34.0))
    for x_m in (16.0, 30.0, 50.0, 64.0):
        assert not space.is_clear(Point(x_m, 35.0).buffer(1.5))
        assert space.is_clear(Point(x_m, 36.0).buffer(1.5))
    assert space.is_clear(Point(13.0, 32.0).buffer(1.5))
    assert not space.is_clear(Point(14.0, 32.0).buffer(1.5))
    candidates = np.array([(0.0, 0.0), (0.0, 5.5), (0.0, 7.0), (0.0, 9.0)])
    assert (space.first_clear(candidates, 1.0), space.first_clear(candidates, 0.9)) == ((0.0, 7.0), (0.0, 9.0))
    assert space.first_clear(candidates, 1.0) is None
    assert clear_pole(space, 3.0, 0.0, (0.0, 1.0), 14.0, 0.3) == (3.0, 5.5), "every quarter of a metre"
    assert clear_pole(space, 3.0, 0.0, (0.0, -1.0), 5.0, 0.3) is None


def test_samples_of_a_ring_have_the_area_on_their_left():
    area = shapely.union(box(0.0, 0.0, 40.0, 20.0) - box(10.0, 5.0, 20.0, 15.0), box(60.0, 0.0, 68.0, 8.0))
    places, tangents = ring_samples(area, 2.0)
    assert len(places) == (120 + 40 + 32) // 2
    assert np.hypot(tangents[:, 0], tangents[:, 1]) == pytest.approx(np.ones(len(places)))
    # Half a metre to the left is inside, to the right outside; not at corners, where the tangent turns.
    beside = 0.05 * np.stack((-tangents[:, 1], tangents[:, 0]), axis=-1)
    assert shapely.contains_xy(area, places + beside + 0.01 * tangents).mean() > 0.95
    assert shapely.contains_xy(area, places - beside + 0.01 * tangents).mean() < 0.05
    assert np.median(np.hypot(*np.diff(places[:60], axis=0).T)) == pytest.approx(2.0)
    places, tangents = ring_samples(box(0.0, 0.0, 0.3, 0.3), 2.0)
    assert places.shape == tangents.shape == (0, 2), "short rings have none"
