from dataclasses import replace

import numpy as np
import pytest

from siren_ros.errors import InputError
from siren_ros.roads.road_network import RoadNetwork
from siren_ros.sensors.navigation.gnss import GeoReference, Gnss
from siren_ros.sensors.suite.mount import Mount, map_from_base
from siren_ros.sensors.suite.suite import GnssSpec

NETWORK = RoadNetwork((), (), (), {}, (0.0, 0.0), "!")
EXACT = GnssSpec(
    "gnss",
    Mount(0.0, 0.0, 1.93),
    horizontal_noise_stddev_m=0.0,
    vertical_noise_stddev_m=0.0,
    bias_walk_m_per_sqrt_s=0.0,
)
M_PER_DEG_LAT = 111_207.0  # of the meridian at 49 degrees north (WGS 84)


def test_a_map_without_geo_reference_lies_at_the_documented_place() -> None:
    fix = Gnss(EXACT, GeoReference.of(NETWORK), 0).measure(0, map_from_base(0.0, 0.0, 0.5, 1.0), 0.0)
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((49.0, 8.4), abs=1e-8)
    assert fix.altitude_m == pytest.approx(2.43)


def test_a_hundred_metres_north_and_east() -> None:
    receiver = Gnss(EXACT, GeoReference.of(NETWORK), 0)
    north = receiver.measure(0, map_from_base(0.0, 100.0, 0.0, 0.0), 0.0)
    east = receiver.measure(0, map_from_base(100.0, 0.0, 0.0, 0.0), 0.0)
    assert (north.latitude_deg - 49.0) * M_PER_DEG_LAT == pytest.approx(100.0, abs=0.05)
    per_degree = np.pi / 180.0 * 6_378_137.0 / np.sqrt(1.0 - 0.00669438 * np.sin(np.radians(49)) ** 2)
    assert (east.longitude_deg - 8.4) * per_degree * np.cos(np.radians(49)) == pytest.approx(100.0, abs=0.01)


def test_the_antennas_lever_arm_turns_with_the_carrier() -> None:
    ahead = replace(EXACT, mount=Mount(10.0, 0.0, 1.0))
    fix = Gnss(ahead, GeoReference.of(NETWORK), 0).measure(0, map_from_base(0.0, 0.0, 0.0, np.pi / 2), 0.0)
    assert (fix.latitude_deg - 49.0) * M_PER_DEG_LAT == pytest.approx(10.0, abs=0.01)
    assert fix.longitude_deg == pytest.approx(8.4, abs=1e-9)


def test_the_maps_own_reference_is_used_with_its_offset() -> None:
    utm = replace(
        NETWORK,
        projection="+proj=utm +zone=32 +ellps=WGS84",
        origin_lat_lon_deg=(48.0, 9.0),
        projected_origin_m=(500_000.0, 0.0),
    )
    assert GeoReference.of(utm).geodetic(0.0, 0.0) == pytest.approx((0.0, 9.0), abs=1e-9)
    shifted = replace(utm, projected_origin_m=(500_300.0, 5_000_400.0))
    moved = replace(utm, projected_origin_m=(500_000.0, 5_000_000.0))
    assert GeoReference.of(shifted).geodetic(-100.0, 50.0) == GeoReference.of(moved).geodetic(200.0, 450.0)
    with pytest.raises(InputError, match="projection"):
        GeoReference("+proj=merc", (0.0, 0.0)).geodetic(0.0, 0.0)


def test_noise_and_variance_agree() -> None:
    noisy = replace(EXACT, horizontal_noise_stddev_m=1.5, vertical_noise_stddev_m=3.0)
    receiver = Gnss(noisy, GeoReference.of(NETWORK), 5)
    fixes = [receiver.measure(step, np.eye(4), step * 0.05) for step in range(0, 800, 2)]
    north = np.array([(fix.latitude_deg - 49.0) * M_PER_DEG_LAT for fix in fixes])
    up = np.array([fix.altitude_m - 1.93 for fix in fixes])
    assert north.std() == pytest.approx(1.5, rel=0.15)
    assert up.std() == pytest.approx(3.0, rel=0.15)
    assert fixes[0].variance_m2.tolist() == [2.25, 2.25, 9.0]


def test_the_variance_grows_as_the_bias_walks() -> None:
    """A random walk of 0.3 m/√s has a variance of 0.09 m² for each second, on every axis."""
    walking = replace(EXACT, horizontal_noise_stddev_m=0.2, vertical_noise_stddev_m=0.4, bias_walk_m_per_sqrt_s=0.3)
    reference, errors = GeoReference.of(NETWORK), []
    for seed in range(300):
        fix = Gnss(walking, reference, seed).measure(40, np.eye(4), 2.0)
        assert fix.variance_m2 == pytest.approx([0.04 + 0.18, 0.04 + 0.18, 0.16 + 0.18])
        errors.append(((fix.latitude_deg - 49.0) * M_PER_DEG_LAT, fix.altitude_m - 1.93))
    north, up = np.array(errors).T
    assert north.var() == pytest.approx(0.22, rel=0.25)
    assert up.var() == pytest.approx(0.34, rel=0.25)
    assert np.abs(np.mean(errors, axis=0)).max() < 0.1
