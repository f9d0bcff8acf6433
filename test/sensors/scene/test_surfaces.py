from dataclasses import replace

import numpy as np
import pytest
import shapely
from hand_made_record import crossing
from shapely.geometry import LineString, Point

from siren_ros.errors import InputError
from siren_ros.numerics.geometry import Polyline
from siren_ros.roads.road_network import LaneKind, RoadNetwork
from siren_ros.sensors.scene.config import SceneConfig
from siren_ros.sensors.scene.markings import arrow, ribbon, road_markings
from siren_ros.sensors.scene.surfaces import _junction_carriageway, drawn_centres, road_surfaces


def test_regions_do_not_overlap(network: RoadNetwork) -> None:
    s = road_surfaces(network, drawn_centres(network, 0.0), SceneConfig())
    regions = [s.carriageway, s.shoulder, s.sidewalk, s.median, s.verge]
    for number, one in enumerate(regions):
        for other in regions[number + 1 :]:
            assert one.intersection(other).area < 0.01


def test_every_lane_lies_on_its_surface(network: RoadNetwork) -> None:
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


def test_roads_go_on_beyond_dead_ends_and_nowhere_else(network: RoadNetwork) -> None:
    centres = drawn_centres(network, 40.0)
    for lane in network.lanes:
        longer = 0.0 if network.edges[lane.edge].internal else 40.0
        assert centres[lane.index].length_m == pytest.approx(lane.length_m + longer)


def test_markings_lie_inside_the_paved_surface_and_apart_from_each_other(network: RoadNetwork) -> None:
    config = SceneConfig()
    centres = drawn_centres(network, config.road_extension_m)
    surfaces = road_surfaces(network, centres, config)
    markings = road_markings(network, centres, surfaces, config)
    assert markings.white.difference(surfaces.paved).area < 1e-6
    assert markings.yellow.difference(surfaces.paved).area < 1e-6
    assert markings.white.intersection(markings.yellow).area < 1e-6
    # A stop line before the signal, the boundary between opposite directions, a shoulder's edge line.
    lane = next(lane for lane in network.lanes if lane.kind is LaneKind.DRIVING)
    assert markings.white.covers(Point(*lane.centre.at(lane.length_m - 0.25)))
    leftmost = next(lane for lane in network.lanes if lane.position == 3)
    assert markings.yellow.covers(Point(*leftmost.centre.offset_points(30.0, leftmost.width_m / 2 - 0.15)))
    assert markings.white.covers(Point(*lane.centre.offset_points(30.0, -lane.width_m / 2)))


def test_dividers_are_dashed_far_from_the_signal_and_solid_near_it(network: RoadNetwork) -> None:
    config = SceneConfig()
    centres = drawn_centres(network, 0.0)
    markings = road_markings(network, centres, road_surfaces(network, centres, config), config)
    lane = next(lane for lane in network.lanes if lane.kind is LaneKind.DRIVING and lane.position == 2)
    covered = shapely.contains_xy(markings.white, lane.centre.offset_points(np.arange(0.5, 65, 0.1), lane.width_m / 2))
    assert covered.mean() == pytest.approx(3.0 / 9.0, abs=0.05)
    assert shapely.contains_xy(
        markings.white, lane.centre.offset_points(np.arange(71, 89, 0.1), lane.width_m / 2)
    ).all()


@pytest.mark.parametrize("length_m", [2.0, 5.0, 30.0])
def test_a_lane_that_ends_at_a_junction_is_paved_up_to_it_and_no_further(length_m: float) -> None:
    """Also one that is shorter than its two ends of 3 m, which count as part of the junctions there."""
    network = crossing()
    end = network.lanes[1].centre.points[-1]
    short = replace(network.lanes[1], centre=Polyline.through(np.array([end - (0.0, length_m), end])))
    alone = replace(network, lanes=(short,))
    around = shapely.box(-10.0, -20.0, 20.0, 10.0)
    assert _junction_carriageway(alone, shapely.MultiPolygon(), around).area == pytest.approx(0.0, abs=1e-6)
    reaching = _junction_carriageway(alone, shapely.MultiPolygon(), shapely.box(-10.0, -200.0, 20.0, 10.0))
    assert reaching.area == pytest.approx(3.5 * min(length_m, 2 * 3.0))


def test_the_crossings_surfaces_are_where_its_lanes_are() -> None:
    """Shoulder from 7 to 9.5 m, lanes from 0 to 7 m; gravel for 2 m beside the road, since there are no sidewalks."""
    network = crossing()
    found = road_surfaces(network, drawn_centres(network, 0.0), SceneConfig())

    def there(area: shapely.Geometry, *xs_m: float, y_m: float = -70.0) -> list[bool]:
        return [bool(shapely.contains_xy(area, x_m, y_m)) for x_m in xs_m]

    assert there(found.carriageway, 0.1, 3.5, 6.9, 7.1, 9.6) == [True, True, True, False, False]
    assert there(found.shoulder, 6.9, 7.1, 9.4, 9.6) == [False, True, True, False]
    assert there(found.median, 9.4, 9.6, 12.1, 12.3) == [False, True, True, False], "up to the road of its own"
    assert there(found.verge, 9.6, 12.1, 15.7, 15.8, 17.7, 17.8) == [False, False, False, True, True, False]
    assert there(found.verge, -3.4, -3.6, -5.4, -5.6) == [False, True, True, False]
    assert there(found.keep_clear, 9.4, 9.6, y_m=-70.0) == [True, False]
    assert there(found.keep_clear, -9.0, 19.0, y_m=9.0) == [True, True], "all of the junction's outline"
    assert there(found.paved, 5.25, 1.75, -1.75, y_m=-5.0) == [True, True, True]
    assert found.sidewalk.is_empty
    assert found.bounds_m == (-110.0, -120.0, 120.0, 110.0)
    assert found.raised.equals(found.median)


def test_a_ribbon_keeps_its_width_around_a_bend() -> None:
    angle = np.linspace(0.0, np.pi / 2, 30)
    centre = Polyline.through(20.0 * np.column_stack((np.cos(angle), np.sin(angle))))
    strip = ribbon(centre, 0.0, centre.length_m, 2.0, 0.2)
    assert strip.is_valid
    assert strip.area == pytest.approx(0.2 * 18.0 * np.pi / 2, rel=0.01)


def test_arrows_point_to_their_side() -> None:
    centre = Polyline.through([(0.0, 0.0), (50.0, 0.0)])
    (left,), (right,) = list(arrow(centre, 20.0, {"l"})), list(arrow(centre, 20.0, {"r"}))
    assert left.bounds[3] > 1.0
    assert right.bounds[1] < -1.0
    assert len(list(arrow(centre, 20.0, {"s", "l", "t"}))) == 2


@pytest.mark.parametrize(
    ("name", "value"),
    [("tile_m", 0.0), ("kerb_height_m", -1.0), ("building_height_m", (9.0, 5.0)), ("tree_spacing_m", -2.0)],
)
def test_unusable_numbers_are_named(name: str, value: object) -> None:
    with pytest.raises(InputError, match=name):
        SceneConfig(**{name: value})
