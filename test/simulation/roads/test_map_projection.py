import pytest

from siren_ros.simulation.roads.map_projection import geodetic_from_projected, projected_from_geodetic

UTM_33 = "+proj=utm +zone=33 +ellps=WGS84 +datum=WGS84 +units=m +no_defs"


def test_the_central_meridian_at_45_degrees():
    """The WGS 84 meridian arc from the equator to 45° is 4 984 944.378 m."""
    assert geodetic_from_projected(UTM_33, 500_000.0, 4_984_944.378 * 0.9996) == pytest.approx((45.0, 15.0), abs=1e-8)


def test_off_the_meridian_it_agrees_with_proj():
    """Netconvert's PROJ puts 52.52° N 13.40° E at 391 440.0321 m east and 5 820 079.6668 m north in zone 33."""
    lat, lon = geodetic_from_projected(UTM_33, 391_440.0321, 5_820_079.6668)
    assert (lat, lon) == pytest.approx((52.52, 13.40), abs=1e-8)


def test_a_place_is_projected_as_proj_does():
    """The same place the other way round."""
    assert projected_from_geodetic(UTM_33, 52.52, 13.40) == pytest.approx((391_440.0321, 5_820_079.6668), abs=1e-3)
    assert projected_from_geodetic(UTM_33, 45.0, 15.0) == pytest.approx((500_000.0, 4_984_944.378 * 0.9996), abs=1e-3)


def test_scale_and_false_origin_are_the_projections():
    plain = projected_from_geodetic("+proj=tmerc +lat_0=48 +lon_0=9", 48.5, 9.25)
    scaled = projected_from_geodetic("+proj=tmerc +lat_0=48 +lon_0=9 +k_0=0.9 +x_0=100 +y_0=-200", 48.5, 9.25)
    assert plain is not None
    assert scaled == pytest.approx((0.9 * plain[0] + 100.0, 0.9 * plain[1] - 200.0))
    # 0.25° of longitude at 48.5° are 18.5 km, 0.5° of latitude 55.6 km.
    assert plain == pytest.approx((18_470.0, 55_600.0), rel=0.01)


def test_the_southern_hemisphere_has_its_false_northing():
    north = geodetic_from_projected(UTM_33, 480_000.0, 1_000_000.0)
    south = geodetic_from_projected(f"{UTM_33} +south", 480_000.0, 9_000_000.0)
    assert south == pytest.approx((-north[0], north[1]), abs=1e-10)


def test_transverse_mercator_with_an_origin_of_its_own():
    projection = "+proj=tmerc +lat_0=48.5 +lon_0=9.25 +k=0.9999 +x_0=1000 +y_0=2000 +datum=WGS84"
    assert geodetic_from_projected(projection, 1000.0, 2000.0) == pytest.approx((48.5, 9.25), abs=1e-8)
    north = geodetic_from_projected(projection, 1000.0, 2111.0)
    assert north[0] - 48.5 == pytest.approx(111.0 / 0.9999 / 111_206.0, rel=1e-3)


@pytest.mark.parametrize(
    "projection", ["!", "-", "", "+proj=merc", "+proj=utm", "+proj=utm +zone=x", "+proj=tmerc +k=0"]
)
def test_other_projections_have_no_answer(projection):
    assert geodetic_from_projected(projection, 0.0, 0.0) is None


@pytest.mark.parametrize(
    "projection",
    [
        "+proj=utm +zone=10 +ellps=WGS84 +datum=WGS84 +units=m +no_defs",
        "+proj=utm +zone=30 +south +ellps=WGS84",
        "+proj=tmerc +lat_0=49 +lon_0=8 +k=0.9996 +x_0=1000 +y_0=-500 +datum=WGS84",
    ],
)
@pytest.mark.parametrize(("east_m", "north_m"), [(0.0, 0.0), (60_000.0, 4_100_000.0), (-90_000.0, 5_700_000.0)])
def test_projecting_there_and_back(projection, east_m, north_m):
    x_m = east_m + (500_000.0 if "utm" in projection else 0.0)
    geodetic = geodetic_from_projected(projection, x_m, north_m)
    assert geodetic is not None
    assert projected_from_geodetic(projection, *geodetic) == pytest.approx((x_m, north_m), abs=1e-3)
    assert projected_from_geodetic("+proj=longlat", *geodetic) is None
