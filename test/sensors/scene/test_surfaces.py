import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, Point

from siren_ros.errors import InputError
from siren_ros.numerics.polyline import Polyline
from siren_ros.roads.road_network import LaneKind, RoadNetwork
from siren_ros.sensors.scene.config import SceneConfig
from siren_ros.sensors.scene.markings import arrow, ribbon, road_markings
from siren_ros.sensors.scene.surfaces import drawn_centres, road_surfaces


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
