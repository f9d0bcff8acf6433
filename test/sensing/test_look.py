import numpy as np
import pytest

from siren_ros.base.params.folders import names_in_params
from siren_ros.errors import InputError
from siren_ros.sensing.look import Look, load_look, sun_position


def test_every_look_loads_and_the_default_is_the_clear_morning():
    names = names_in_params("looks")
    assert {"clear", "evening", "overcast", "rain", "fog", "dusk", "night", "night_rain"} <= set(names)
    for name in names:
        load_look(name)
    clear, plain = load_look("clear"), Look()
    assert clear.sun_azimuth_rad == pytest.approx(plain.sun_azimuth_rad, abs=1e-4)
    assert clear.sun_elevation_rad == pytest.approx(plain.sun_elevation_rad, abs=1e-4)
    assert clear.sun_colour == plain.sun_colour
    with pytest.raises(InputError, match="overcast"):
        load_look("thunder")


def test_the_sun_stands_in_the_south_at_noon_and_rises_in_the_east_at_the_equinox():
    azimuth, elevation = sun_position(12.0, 81, np.radians(49.0))
    assert azimuth == pytest.approx(-np.pi / 2)
    assert np.degrees(elevation) == pytest.approx(41.0, abs=0.1)
    azimuth, elevation = sun_position(6.0, 81, np.radians(49.0))
    assert (azimuth, elevation) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert np.degrees(sun_position(12.0, 172, np.radians(49.0))[1]) == pytest.approx(41.0 + 23.44, abs=0.1)


def test_fog_and_rain_weaken_laser_light():
    assert Look().lidar_extinction_per_m == 0.0
    fog = load_look("fog")
    assert np.exp(-fog.lidar_extinction_per_m * fog.visibility_m) == pytest.approx(0.05, rel=0.01)
    assert np.exp(-fog.haze_per_m * fog.visibility_m) == pytest.approx(0.05, rel=0.01)
    one_mm_per_h = Look(rain_mm_per_h=1.0)
    assert 10.0 * np.log10(np.exp(one_mm_per_h.lidar_extinction_per_m * 1000.0)) == pytest.approx(1.076)


def test_at_night_the_lamps_are_lit_and_the_sky_darkens_with_the_sun(tmp_path):
    path, looks = tmp_path / "mine.yaml", []
    for elevation_deg in (10, 2, -3, -8, -40):
        path.write_text(f"sun_elevation_deg: {elevation_deg}\n", encoding="utf-8")
        looks.append(load_look(str(path)))
    assert [look.lamps_lit for look in looks] == [False, True, True, True, True]
    zenith = [sum(look.zenith_colour) for look in looks]
    assert zenith == sorted(zenith, reverse=True)
    assert looks[1].direct_colour == (0.0, 0.0, 0.0)
    path.write_text("hour: 2.0\nzenith_colour: [0.5, 0.1, 0.1]\n", encoding="utf-8")
    assert load_look(str(path)).lamps_lit
    assert load_look(str(path)).zenith_colour == (0.5, 0.1, 0.1)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        *[("cloud_cover: 2.0", "cloud_cover"), ("cluod_cover: 0.2", "cluod_cover")],
        *[("sun_colour: [1.0, 2.0]", "sun_colour"), ("hour: 24.5", "hour")],
        *[("sun_elevation_deg: -91", "sun_elevation_deg"), ("visibility_m: 0", "visibility_m")],
    ],
)
def test_a_wrong_look_is_refused_with_its_key(tmp_path, text, match):
    path = tmp_path / "mine.yaml"
    path.write_text(text + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=match):
        load_look(str(path))
