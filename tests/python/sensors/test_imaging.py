"""Uses of OpenCV, compared with NumPy: hsv, smaller images, and colours in images."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from messages import refused

import flockstep
from flockstep.testing import check_vector_env

RED = flockstep.ColorRange(space="hsv", low=(170, 120, 30), high=(10, 255, 255))
WORLD = {
    "flockstep_scene": 1,
    "name": "gallery",
    "materials": {
        "white": {"base_color": [0.9, 0.9, 0.9]},
        "red": {"base_color": [0.8, 0.05, 0.05]},
        "blue": {"base_color": [0.05, 0.1, 0.8]},
    },
    "room": {"min": [0, 0, 0], "max": [10, 8, 4], "material": "white"},
    "boxes": [{"center": [7, 2, 1], "size": [1, 1, 2], "material": "red"}],
    "spheres": [{"center": [6, 5, 2], "radius": 0.5, "material": "blue"}],
    "markers": {"start": [1, 4, 2], "goal": [9, 4, 2], "spawn_box": {"min": [0.8, 3, 1], "max": [1.2, 5, 3]}},
}


@pytest.fixture(scope="module")
def world():
    return flockstep.World.from_dict(WORLD)


@pytest.fixture(scope="module")
def open_world():
    """A world with a sky, so that some depths are inf."""
    scene = {key: value for key, value in WORLD.items() if key != "room"}
    return flockstep.World.from_dict({**scene, "name": "open"})


def rendered(world, num_drones=6, **fields):
    """A batch with one camera that has taken frames at poses which depend only on the seed."""
    config = flockstep.CameraConfig(**{"width_px": 40, "height_px": 30, **fields})
    batch = flockstep.Batch([world], num_drones, cameras=[config], num_threads=2)
    rng = np.random.default_rng(3)
    half = rng.uniform(-0.5, 0.5, num_drones)
    turn = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    batch.set_pose(rng.uniform([1, 1, 1], [5, 7, 3], (num_drones, 3)), turn)
    batch.sense()
    return batch


def hsv_of(rgb):
    """The textbook's hue, saturation and value of (..., 3), hue in half degrees."""
    rgb = rgb.astype(float)
    value, spread = rgb.max(axis=-1), np.ptp(rgb, axis=-1)
    r, g, b = np.moveaxis(rgb, -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_largest = [(g - b) / spread % 6, (b - r) / spread + 2, (r - g) / spread + 4]
        hue = np.select([value == r, value == g], of_largest[:2], of_largest[2]) * 30
        saturation = 255 * spread / value
    return np.stack([np.where(spread > 0, hue, 0), np.where(value > 0, saturation, 0), value], axis=-1)


class TestHsv:
    def test_every_colour_in_steps_of_five_and_random_ones(self, world):
        steps = np.arange(0, 256, 5, dtype=np.uint8)
        colors = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(1, -1, 3)
        some = np.random.default_rng(0).integers(0, 256, (1, 50_000, 3), dtype=np.uint8)
        for image in (colors, some):
            # A range of one value in a channel selects the pixels with this value.
            expected = hsv_of(image)[0]
            for channel, values in ((0, range(0, 180, 7)), (1, range(0, 256, 17)), (2, range(0, 256, 17))):
                for value in values:
                    low, high = [0, 0, 0], [255, 255, 255]
                    low[channel] = high[channel] = value
                    mask = flockstep.color_blob(image, flockstep.ColorRange(space="hsv", low=low, high=high)).mask[0]
                    away = np.abs(expected[:, channel] - value)
                    away = np.minimum(away, 180 - away) if channel == 0 else away
                    assert away[mask].max(initial=0) < 0.65  # rounded, with 12-bit tables
                    assert mask[away < 0.35].all()

    @pytest.mark.parametrize("layout", ["hwc", "chw"])
    @pytest.mark.parametrize("outputs", [("hsv",), ("rgb", "hsv"), ("depth", "hsv", "rgb", "grey")])
    def test_of_what_the_camera_sees(self, world, layout, outputs):
        camera = rendered(world, outputs=outputs, layout=layout).camera()
        rgb = rendered(world, outputs=("rgb",)).camera().rgb
        hsv = camera.hsv if layout == "hwc" else camera.hsv.transpose(0, 2, 3, 1)
        assert camera.hsv.shape == ((6, 30, 40, 3) if layout == "hwc" else (6, 3, 30, 40))
        assert hsv.dtype == np.uint8
        away = np.abs(hsv - hsv_of(rgb))
        away[..., 0] = np.minimum(away[..., 0], 180 - away[..., 0])
        assert away.max() < 0.65
        assert len(np.unique(hsv[..., 0])) > 5
        if "rgb" not in outputs:
            with refused(ValueError, 'camera "front"', "rgb"):
                _ = camera.rgb


class TestResize:
    @pytest.mark.parametrize("pool", ["mean", "min", "max"])
    def test_images_are_of_blocks_of_pixels(self, open_world, pool):
        """Blocks of 4 x 3 pixels; the colours in hsv are those of the small image."""
        outputs = ("rgb", "depth", "grey", "hsv")
        whole = rendered(open_world, outputs=outputs).camera()
        small = rendered(open_world, outputs=outputs, resize=(10, 10), pool=pool).camera()
        assert small.config.image_size_px == (10, 10)
        for output in outputs[:3]:
            ours, blocks = getattr(small, output), getattr(whole, output).reshape(6, 10, 3, 10, 4, -1)
            expected = getattr(blocks, pool)(axis=(2, 4)).reshape(ours.shape)
            tolerance = 0.5 + 1e-6 if pool == "mean" and ours.dtype == np.uint8 else 0
            np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=tolerance, err_msg=output)
        away = np.abs(small.hsv - hsv_of(small.rgb))
        away[..., 0] = np.minimum(away[..., 0], 180 - away[..., 0])
        assert away.max() < 0.65
        assert 0.01 < np.isinf(whole.depth).mean() < 0.99

    @pytest.mark.parametrize(
        ("error", "said", "fields"),
        [
            (ValueError, ["camera.resize", 40, (41, 30)], {"resize": (41, 30)}),
            (ValueError, ["camera.resize", (0, 30)], {"resize": (0, 30)}),
            (ValueError, ["camera.resize", "semantic"], {"resize": (4, 3), "outputs": ("semantic",)}),
            (ValueError, ["camera.resize", "instance"], {"resize": (4, 3), "outputs": ("rgb", "instance")}),
            (ValueError, ["camera.resize", "normal"], {"resize": (4, 3), "outputs": ("normal",)}),
            (ValueError, ["camera.pool", "without resize"], {"pool": "min"}),
            (ValueError, ["pool", "median"], {"resize": (4, 3), "pool": "median"}),
            *((TypeError, ["resize", wrong], {"resize": wrong}) for wrong in (4, (4,), (4, 3, 2), ("a", "b"))),
        ],
    )
    def test_invalid_arguments(self, error, said, fields):
        with refused(error, *said):
            flockstep.CameraConfig(**{"width_px": 40, "height_px": 30, **fields})

    def test_a_removed_drone_sees_nothing(self, world):
        batch = rendered(world, outputs=("rgb", "depth", "hsv"), resize=(10, 6))
        batch.remove([2])
        camera = batch.camera()
        assert not camera.hsv[2].any()
        assert not camera.rgb[2].any()
        assert np.isinf(camera.depth[2]).all()
        assert camera.hsv[1].any()


class Look(flockstep.Task):
    """Observes the nearest depth in each part of the picture, its colours as hsv, and a red object."""

    camera = flockstep.CameraConfig(
        width_px=64, height_px=48, outputs=("rgb", "depth", "hsv"), resize=(16, 12), pool="min"
    )
    observation_space = spaces.Dict(
        {
            "near": spaces.Box(0, 1, (12, 16), np.float32),
            "hsv": spaces.Box(0, 255, (12, 16, 3), np.uint8),
            "red": spaces.Box(-1, 1, (2,), np.float32),
        }
    )
    max_episode_steps = 8

    def step(self, batch):
        return batch.position[:, 0], batch.contact.hit

    def observe(self, batch):
        camera = batch.camera()
        red = flockstep.color_blob(camera.rgb, RED)
        return {
            "near": 1 / (1 + camera.depth),
            "hsv": camera.hsv,
            "red": np.stack([red.offset, red.area], axis=1),
        }


class TestTasks:
    @pytest.mark.parametrize("mode", ["next_step", "same_step"])
    def test_a_python_task_passes_the_checker(self, world, mode):
        check_vector_env(
            lambda n: flockstep.DroneVectorEnv(n, worlds=world, task=Look(), autoreset_mode=mode, num_threads=1)
        )

    def test_final_observations_are_of_the_last_frame(self, world):
        envs = flockstep.DroneVectorEnv(2, worlds=world, task=Look(), autoreset_mode="same_step")
        twin = flockstep.DroneVectorEnv(2, worlds=world, task=Look(), autoreset_mode="disabled")
        for each in (envs, twin):
            each.reset(seed=0)
        actions = np.tile(np.float32([1, 0.5, 0]), (2, 1))
        for _ in range(8):
            *_, infos = envs.step(actions)
            last, *_ = twin.step(actions)
        for name in ("near", "hsv", "red"):
            np.testing.assert_array_equal(np.stack([final[name] for final in infos["final_obs"]]), last[name])

    @pytest.mark.parametrize(
        "color",
        [
            RED,
            flockstep.ColorRange(space="excess", low=(17, 0, 0)),
            flockstep.ColorRange(space="hsv", low=(100, 100, 30), high=(130, 255, 255)),
            flockstep.ColorRange(space="rgb", low=(0, 0, 60), high=(60, 90, 255)),
        ],
    )
    @pytest.mark.parametrize("resize", [None, (32, 24)])
    def test_the_camera_task_observes_another_colour(self, world, color, resize):
        camera = flockstep.CameraConfig(width_px=64, height_px=48, resize=resize)
        envs = gymnasium.make_vec(
            "flockstep/CameraNavigation-v0", 5, worlds=world, camera=camera, color=color, random_start=True
        )
        observation, _ = envs.reset(seed=0)
        rng, seen = np.random.default_rng(1), 0
        for _ in range(40):
            blob = flockstep.color_blob(envs.unwrapped.batch.camera().rgb, color)
            np.testing.assert_array_equal(observation[:, 0], blob.offset)
            np.testing.assert_array_equal(observation[:, 1], blob.area)
            seen += blob.found.sum()
            observation, *_ = envs.step(rng.integers(0, 3, 5))
        assert seen > 50
        spec = envs.spec.to_json()
        again = gymnasium.make_vec(gymnasium.envs.registration.EnvSpec.from_json(spec), num_envs=5)
        assert again.unwrapped.batch.camera().config == envs.unwrapped.batch.camera().config
        np.testing.assert_array_equal(again.reset(seed=0)[0], envs.reset(seed=0)[0])

    def test_pixels_of_a_resized_camera(self, world):
        camera = flockstep.CameraConfig(width_px=64, height_px=48, layout="chw", resize=(20, 15))
        envs = flockstep.DroneVectorEnv(
            3, worlds=world, observation="pixels", camera=camera, render_mode="rgb_array", render_view="camera"
        )
        observation, _ = envs.reset(seed=0)
        assert observation["image"].shape == (3, 3, 15, 20)
        np.testing.assert_array_equal(observation["image"], envs.batch.camera().rgb)
        assert envs.render()[0].shape == (15, 20, 3)

    def test_a_colour_where_no_image_is_observed(self, world):
        with refused(ValueError, "task.color"):
            flockstep.DroneVectorEnv(1, worlds=world, color=RED)


class TestColors:
    def test_components_by_hand(self):
        image = np.zeros((20, 30, 3), np.uint8)
        image[2:5, 3:7] = (200, 20, 20)
        image[5, 7] = (210, 0, 0)  # touches it at a corner
        image[10:12, 20:21] = (120, 0, 5)
        image[15, 15] = (0, 200, 0)
        for layout, array in (("hwc", image), ("chw", image.transpose(2, 0, 1))):
            parts = flockstep.color_components(array, RED, layout)
            np.testing.assert_array_equal(parts.box, [[3, 2, 5, 4], [20, 10, 1, 2]])
            np.testing.assert_array_equal(parts.area_px, [13, 2])
            rows, columns = np.nonzero(parts.labels == 1)
            np.testing.assert_allclose(parts.centroid, [[columns.mean() + 0.5, rows.mean() + 0.5], [20.5, 11]])
            assert parts.labels.dtype == parts.box.dtype == parts.area_px.dtype == np.int32
            assert parts.labels[11, 20] == 2
        nothing = flockstep.color_components(np.zeros((4, 4, 3), np.uint8), RED)
        assert nothing.box.shape == (0, 4)
        assert nothing.centroid.shape == (0, 2)

    def test_shapes_of_blobs(self):
        image = np.zeros((20, 30, 3), np.uint8)
        image[2:5, 3:7] = (200, 20, 20)
        blob = flockstep.color_blob(image, RED)
        assert blob.found.shape == ()
        assert blob.found
        assert (blob.x, blob.y, blob.width, blob.height) == (3, 2, 4, 3)
        assert blob.mask.shape == (20, 30)
        many = flockstep.color_blob(np.stack([[image, 0 * image]] * 3), RED)
        np.testing.assert_array_equal(many.found, [[True, False]] * 3)
        assert many.mask.shape == (3, 2, 20, 30)
        assert flockstep.color_blob(np.zeros((0, 4, 4, 3), np.uint8), RED).found.shape == (0,)

    @pytest.mark.parametrize(
        ("call", "error", "said"),
        [
            (lambda f: f(np.zeros((4, 4, 3)), RED), ValueError, ["image", "uint8", "float64"]),
            (lambda f: f(np.zeros((4, 4), np.uint8), RED), ValueError, ["image", "uint8", (4, 4)]),
            (lambda f: f(np.zeros((4, 4, 3), np.uint8), RED, "chw"), ValueError, ["image", "3, height, width"]),
            (lambda f: f(np.zeros((4, 0, 3), np.uint8), RED), ValueError, ["image"]),
            (lambda f: f(np.zeros((4, 4, 3), np.uint8), RED, "bgr"), ValueError, ["layout", "bgr"]),
            (lambda f: f(np.zeros((4, 4, 3), np.uint8), "red"), TypeError, ["color", "red"]),
        ],
    )
    def test_bad_images(self, call, error, said):
        for function in (flockstep.color_blob, flockstep.color_components):
            with refused(error, *said):
                call(function)
        with refused(ValueError, "image"):
            flockstep.color_components(np.zeros((2, 4, 4, 3), np.uint8), RED)

    @pytest.mark.parametrize(
        ("fields", "error", "said"),
        [
            ({"space": "lab"}, ValueError, ["space", "lab"]),
            ({"low": (0, -1, 0)}, ValueError, ["color.low[1]", -1]),
            ({"high": (0, 20, 256)}, ValueError, ["color.high[2]", 256]),
            ({"space": "rgb", "low": (9, 0, 0), "high": (8, 9, 9)}, ValueError, ["color.low", (8, 9, 9), (9, 0, 0)]),
            ({"low": (1, 2)}, TypeError, ["low", "3 numbers"]),
        ],
    )
    def test_invalid_ranges(self, fields, error, said):
        with refused(error, *said):
            flockstep.ColorRange(**fields)

    def test_a_range_that_was_changed_is_checked_again(self):
        color = flockstep.ColorRange()
        color.low = (300, 0, 0)
        with refused(ValueError, "color.low"):
            flockstep.color_blob(np.zeros((4, 4, 3), np.uint8), color)
