"""`Light.at_hour`, against other equations of the sun's place, closed forms, and images."""

import itertools
import math

import numpy as np
import pytest
from conftest import placed, world_of
from messages import refused

from flockstep import CameraConfig, Light

COLORS = ("sun_color", "sky_ambient", "ground_ambient", "zenith_color", "horizon_color")
TILT_DEG = 23.44


def sun_of(hour, latitude_deg, day):
    """Return the sun's direction by Spencer's series (1971, as NOAA uses it) and horizontal coordinates (Meeus, 13)."""
    year = 2 * math.pi / 365 * (day - 1 + (hour - 12) / 24)
    waves = [(0.006918, 0), (-0.399912, 0.070257), (-0.006758, 0.000907), (-0.002697, 0.00148)]
    declination = sum(a * math.cos(k * year) + b * math.sin(k * year) for k, (a, b) in enumerate(waves))
    latitude, angle = math.radians(latitude_deg), math.radians(15 * (hour - 12))
    westward = math.atan2(
        math.sin(angle), math.cos(angle) * math.sin(latitude) - math.tan(declination) * math.cos(latitude)
    )
    height = math.asin(
        math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(angle)
    )
    level = math.cos(height)
    return np.array([-math.sin(westward) * level, -math.cos(westward) * level, math.sin(height)])


def angle_deg(one, other):
    return math.degrees(2 * math.asin(min(np.linalg.norm(np.subtract(one, other)) / 2, 1)))


def height_deg(*when):
    return math.degrees(math.asin(Light.at_hour(*when).sun_direction[2]))


def test_the_sun_is_where_other_equations_put_it():
    hours, latitudes, days = (0, 4.5, 9, 12, 15.25, 21), (-75, -33.9, 1, 48, 66), range(1, 366, 13)
    for when in itertools.product(hours, latitudes, days):
        direction = Light.at_hour(*when).sun_direction
        assert angle_deg(direction, sun_of(*when)) < 0.3, when
        assert abs(np.linalg.norm(direction) - 1) < 1e-6


def test_solstices_and_equinoxes():
    assert Light.at_hour(12) == Light.at_hour(12, 48, 172) == Light.at_hour(np.float64(12), day_of_year=np.int64(172))
    for latitude, day, height, north in (
        (48, 172, 90 - 48 + TILT_DEG, -1),
        (48, 355, 90 - 48 - TILT_DEG, -1),
        (-34, 172, 90 - 34 - TILT_DEG, 1),
        (-34, 355, 90 - 34 + TILT_DEG, 1),
    ):
        assert height_deg(12, latitude, day) == pytest.approx(height, abs=0.1)
        east, up_north, _ = Light.at_hour(12, latitude, day).sun_direction
        assert abs(east) < 1e-6
        assert math.copysign(1, up_north) == north
    assert angle_deg(Light.at_hour(6, 48, 80).sun_direction, (1, 0, 0)) < 1
    assert angle_deg(Light.at_hour(18, 48, 80).sun_direction, (-1, 0, 0)) < 1
    for hour in range(25):
        assert height_deg(hour, 90, 172) == pytest.approx(TILT_DEG, abs=0.1)
    rises = 12 - math.degrees(math.acos(-math.tan(math.radians(48)) * math.tan(math.radians(TILT_DEG)))) / 15
    assert abs(height_deg(rises, 48, 172)) < 0.1


def test_it_is_the_default_light_with_the_sun_as_high_as_there():
    default, light = Light(), Light.at_hour(10, 0, 80)
    assert height_deg(10, 0, 80) == pytest.approx(math.degrees(math.asin(default.sun_direction[2])), abs=0.3)
    for name in Light.__match_args__[1:]:
        np.testing.assert_allclose(getattr(light, name), getattr(default, name), rtol=0.01, err_msg=name)


def test_evenings_are_redder_and_darker_without_a_jump():
    hours = np.arange(12, 24, 0.01)
    lights = [Light.at_hour(hour) for hour in hours]
    for name in COLORS:
        values = np.array([getattr(light, name) for light in lights])
        steps = np.diff(values, axis=0)
        assert -0.01 < steps.min() <= steps.max() <= 1e-7, name
    sun = np.array([light.sun_color for light in lights])
    is_up = np.array([light.sun_direction[2] > 0 for light in lights])
    redness = sun[is_up, 0] / sun[is_up, 2]
    assert (np.diff(redness) > -1e-5).all()  # which rounding may cause around noon
    assert redness[-1] > 10 * redness[0]
    assert (sun[is_up].min(axis=1) > 0).all()
    sets = hours[is_up][-1]
    assert not sun[hours > sets + 0.1].any()
    assert lights[0].gamma == Light().gamma


def test_nights_are_dark_and_alike():
    for when in ((0, 48, 355), (3, 48, 355), (12, 85, 355)):
        light = Light.at_hour(*when)
        assert light.sun_color == [0, 0, 0]
        for name in COLORS[1:]:
            kept = np.divide(getattr(light, name), getattr(Light(), name))
            np.testing.assert_allclose(kept, [0.04, 0.05, 0.1], rtol=1e-5)


def test_images_get_darker_from_noon_to_midnight():
    world = world_of(name="field", planes=[{"center": [0, 0, 0], "size": [200, 200]}], markers={"start": [0, 0, 2]})
    batch = placed(world, [[0, 0, 2]], camera=CameraConfig(width_px=16, height_px=12))
    means = []
    for hour in (12, 17, 19, 20, 24):
        batch.set_light(Light.at_hour(hour))
        batch.capture()
        means.append(batch.camera().rgb.mean(axis=(0, 1, 2)).tolist())
    assert (np.diff(means, axis=0) < 0).all()
    assert np.min(means) > 1
    assert means[-1][2] > means[-1][0]  # bluish


@pytest.mark.parametrize(
    ("field", "value", "error"),
    [
        *(("hour", value, ValueError) for value in (-0.01, 24.5, math.nan, math.inf)),
        *(("latitude_deg", value, ValueError) for value in (-91, 90.5, math.nan)),
        *(("day_of_year", value, ValueError) for value in (0, 367, 2**40)),
        ("hour", "noon", TypeError),
        ("latitude_deg", None, TypeError),
        ("day_of_year", 1.5, TypeError),
    ],
)
def test_bad_times_and_places_are_refused(field, value, error):
    with refused(error, field, value):
        Light.at_hour(**{"hour": 12, field: value})
