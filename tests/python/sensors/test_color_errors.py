"""Colours that err, against a NumPy twin with the same random words, and against what each error alone does."""

import math
import pickle

import numpy as np
import pytest
from conftest import placed, world_of
from messages import refused
from philox import named_stream, normals, words

import flockstep
from flockstep import CameraConfig, ColorErrors

SCENE = {
    "name": "colours",
    "materials": {"red": {"base_color": [0.8, 0.1, 0.1]}, "green": {"base_color": [0.1, 0.7, 0.2]}},
    "room": {"min": [0, 0, 0], "max": [12, 8, 4]},
    "boxes": [{"center": [4, 3, 2], "size": [1, 1, 4], "material": "red"}],
    "spheres": [{"center": [3.2, 4.6, 1.5], "radius": 0.4, "material": "green"}],
    "markers": {"start": [1, 4, 2]},
}
HALL = world_of(**SCENE)
EVERY = ColorErrors(vignetting=0.7, auto_exposure=0.2, exposure=1.3, shot_noise=0.05, read_noise=0.01, gamma=0.8)
POSES = [[1, 4, 2], [2, 5, 1], [1, 3, 1.5], [0.5, 4, 3]]
IMAGE = {"width_px": 37, "height_px": 21, "outputs": ["rgb", "grey", "hsv"]}


def linear_of(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def srgb_of(light):
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


def disturbed(image, errors, camera, normal):
    """The image (H, W, C) that a camera writes, from the equations of the documents in float64."""
    height, width = image.shape[:2]
    y, z = (camera.cx - np.arange(width) - 0.5) / camera.fx, (camera.cy - np.arange(height) - 0.5) / camera.fy
    cosine = 1 / np.sqrt(1 + y**2 + z[:, None] ** 2)
    light = linear_of(image / 255)
    exposure = errors.exposure * errors.auto_exposure / light.mean()
    light *= exposure * (1 - errors.vignetting * (1 - cosine**4))[:, :, None]
    light += np.sqrt(errors.shot_noise**2 * light + errors.read_noise**2) * normal
    return 255 * srgb_of(np.rint(np.clip(light, 0, 1) * 4095) / 4095) ** errors.gamma


def batch_of(errors, *, poses=POSES, fields=IMAGE, **keywords):
    """A batch whose drones have a camera without errors and one with them."""
    cameras = [CameraConfig(name="exact", **fields), CameraConfig(name="erring", **fields, color_errors=errors)]
    batch = placed(HALL, poses, cameras=cameras, **keywords)
    batch.seed(np.arange(batch.num_envs) + 5)
    return batch


@pytest.mark.parametrize("layout", ["hwc", "chw"])
@pytest.mark.parametrize("drones_per_env", [1, 2])
def test_images_are_those_of_the_twin(layout, drones_per_env):
    batch = batch_of(EVERY, fields={**IMAGE, "layout": layout}, drones_per_env=drones_per_env)
    camera = batch.camera("erring").config
    height, width = IMAGE["height_px"], IMAGE["width_px"]
    for reading in range(2):
        batch.sense()
        for drone in range(len(POSES)):
            env, member = divmod(drone, drones_per_env)

            def normal_of(number, rows, values, env=env, member=member, reading=reading):
                draws = (values + 3) // 4
                stream = named_stream("errors of camera.erring") ^ (number << 16)
                a, b, c, d = words(stream, 4 * width * height * reading, rows * draws, env + 5, member=member)
                pairs = np.stack([normals(a, b).reshape(-1, 2), normals(c, d).reshape(-1, 2)], 1)
                return pairs.reshape(rows, -1)[:, :values]

            exact, got = (batch.camera(name).rgb[drone] for name in ("exact", "erring"))
            if layout == "chw":
                exact, got = exact.transpose(1, 2, 0), got.transpose(1, 2, 0)
                normal = normal_of(2, 3 * height, width).reshape(3, height, width).transpose(1, 2, 0)
            else:
                normal = normal_of(2, height, 3 * width).reshape(height, width, 3)
            off = np.abs(got - disturbed(exact, EVERY, camera, normal))
            assert off.max() < 6  # one of 4,095 levels, in the dark
            assert (off < 0.51).mean() > 0.99
            exact, got = (batch.camera(name).grey[drone, :, :, None] for name in ("exact", "erring"))
            off = np.abs(got - disturbed(exact, EVERY, camera, normal_of(3, height, width)[:, :, None]))
            assert (off < 0.51).mean() > 0.99


def colors(errors, **fields):
    """Images without and with these errors."""
    batch = batch_of(errors, fields={**IMAGE, **fields})
    batch.sense()
    return [batch.camera(name).rgb.astype(float) for name in ("exact", "erring")]


def test_each_error_alone():
    exact, got = colors(ColorErrors(exposure=0.5))
    assert np.abs(got - 255 * srgb_of(0.5 * linear_of(exact / 255))).max() < 1.5
    exact, got = colors(ColorErrors(exposure=1000))
    assert (got[exact > 1] == 255).all()
    exact, got = colors(ColorErrors(exposure=0))
    assert (got == 0).all()
    exact, got = colors(ColorErrors(auto_exposure=0.1))
    assert np.abs(linear_of(got / 255).mean((1, 2, 3)) - 0.1).max() < 0.003
    exact, got = colors(ColorErrors(gamma=2))
    assert np.abs(got - 255 * (exact / 255) ** 2).max() < 1.5
    exact, got = colors(ColorErrors(vignetting=1), hfov_deg=90)
    dark, mid = got[:, 10, 0], got[:, 10, 18]
    np.testing.assert_array_equal(mid, exact[:, 10, 18])  # the middle of the image
    x = 18 / 18.5
    assert np.abs(dark - 255 * srgb_of(linear_of(exact[:, 10, 0] / 255) / (1 + x * x) ** 2)).max() < 1.5
    exact, got = colors(ColorErrors(gamma=1 + 1e-6))
    np.testing.assert_array_equal(got, exact)  # 12 bits hold every sRGB value


def test_hsv_is_of_the_erring_colours():
    batch = batch_of(EVERY)
    batch.sense()
    np.testing.assert_array_equal(batch.camera("erring").hsv[..., 2], batch.camera("erring").rgb.max(-1))
    only = batch_of(EVERY, fields={**IMAGE, "outputs": ["hsv"]})
    only.sense()
    np.testing.assert_array_equal(only.camera("erring").hsv, batch.camera("erring").hsv)


def test_errors_precede_resizing():
    whole = {**IMAGE, "width_px": 36, "height_px": 20, "outputs": ["rgb"]}
    full = colors(EVERY, **whole)[1].reshape(4, 5, 4, 9, 4, 3)
    small = colors(EVERY, **whole, resize=(9, 5), pool="max")[1]
    np.testing.assert_array_equal(small, full.max((2, 4)))


def test_no_errors_are_the_same_bits():
    batch = batch_of(ColorErrors())
    batch.sense()
    for output in IMAGE["outputs"]:
        np.testing.assert_array_equal(getattr(batch.camera("erring"), output), getattr(batch.camera("exact"), output))
    assert CameraConfig(color_errors=ColorErrors()) == CameraConfig()


def test_bits_do_not_depend_on_threads_and_snapshots_continue():
    images = []
    for keywords in ({"num_threads": 1}, {"num_threads": 3, "block_size": 1}):
        batch = batch_of(EVERY, **keywords)
        batch.sense()
        blob = batch.snapshot()
        batch.sense()
        images.append(batch.camera("erring").rgb.copy())
    np.testing.assert_array_equal(*images)
    other = batch_of(EVERY)
    other.restore(blob)
    assert not np.array_equal(other.camera("erring").rgb, images[0])
    other.sense()
    np.testing.assert_array_equal(other.camera("erring").rgb, images[0])


def test_configurations_survive_recipes_and_pickles():
    camera = CameraConfig(**IMAGE, color_errors=EVERY)
    assert pickle.loads(pickle.dumps(camera)) == camera != CameraConfig(**IMAGE)
    env = flockstep.DroneVectorEnv(2, worlds="train", camera=camera)
    assert flockstep.Recipe.from_json(env.recipe.to_json()).cameras[0].color_errors == EVERY


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("vignetting", [-0.1, 1.1, math.nan]),
        ("auto_exposure", [0, -1, 1.1, math.nan]),
        ("exposure", [-1, math.nan, math.inf, 1e9]),
        ("shot_noise", [-1, math.nan, 2]),
        ("read_noise", [-1, math.nan, 2]),
        ("gamma", [0, -1, math.nan, 11]),
    ],
)
def test_bad_errors_are_refused(field, values):
    for value in values:
        with refused(ValueError, f"camera.color_errors.{field}"):
            CameraConfig(color_errors=ColorErrors(**{field: value}))


def test_errors_without_colours_are_refused():
    with refused(ValueError, "camera.color_errors"):
        CameraConfig(outputs=["depth"], color_errors=EVERY)
    with refused(TypeError, "color_errors"):
        CameraConfig(color_errors="many")
