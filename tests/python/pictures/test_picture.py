"""Pictures from any viewpoint, and the choices of `render_view`, `render_size` and `render_camera`."""

import gymnasium
import numpy as np
import pytest
from conftest import begun, placed
from messages import refused

import flockstep
from flockstep.pictures import choice, views
from flockstep.pictures.picture import facing
from flockstep.rotations import rotate


def test_a_picture_is_what_a_drones_camera_sees(room):
    camera = flockstep.CameraConfig(name="any", width_px=40, height_px=30, outputs=("rgb", "depth", "instance"))
    quat_wxyz = [0.8, 0.0, 0.0, 0.6]
    picture = flockstep.render(room, (3, 4, 2), quat_wxyz, camera=camera)
    batch = placed([room], [[3, 4, 2]], [quat_wxyz], cameras=[camera])
    batch.capture()
    assert list(picture) == ["rgb", "depth", "instance"]
    for output, array in picture.items():
        np.testing.assert_array_equal(array, getattr(batch.camera("any"), output)[0])


def test_by_default_it_is_large_and_faces_ahead(room):
    picture = flockstep.render(room, (2, 4, 2))
    assert picture["rgb"].shape == (480, 640, 3)
    np.testing.assert_array_equal(picture["rgb"], flockstep.render(room, (2, 4, 2), look_at=(3, 4, 2))["rgb"])


@pytest.mark.parametrize("target", [(4, 5, 3), (-1, 2, 0), (0, 0, 5), (0, 0, -5), (-3, 0, 0), (1e-3, 0, 1)])
def test_facing_points_there_and_stays_level(target):
    quat_wxyz = facing((0, 0, 0), target).astype(float)
    assert np.linalg.norm(quat_wxyz) == pytest.approx(1)
    np.testing.assert_allclose(rotate(quat_wxyz, np.array([1.0, 0, 0])), target / np.linalg.norm(target), atol=1e-6)
    left, up = rotate(quat_wxyz, np.array([0, 1.0, 0])), rotate(quat_wxyz, np.array([0, 0, 1.0]))
    assert left[2] == pytest.approx(0, abs=1e-6)
    assert up[2] >= -1e-6


def test_what_is_looked_at_is_in_the_middle(room):
    camera = flockstep.CameraConfig(width_px=101, height_px=75, outputs=("semantic",))
    seen = flockstep.render(room, (1, 7, 3.5), look_at=room.goal, camera=camera)["semantic"]
    assert seen[37, 50] == 65535


@pytest.mark.parametrize(
    ("pose", "look_at", "said"),
    [
        ([(1, 1, 1), (1, 0, 0, 0)], (2, 2, 2), ["look_at", "quat_wxyz"]),
        ([(1, 1, 1)], (1, 1, 1), ["look_at", "position"]),
        ([(1, 1)], None, ["position", (3,), (2,)]),
        ([(1, 1, 1), (1, 0, 0)], None, ["quat_wxyz", (4,), (3,)]),
        ([(1, 1, np.nan)], None, ["position"]),
    ],
)
def test_bad_input_is_refused(room, pose, look_at, said):
    with refused(ValueError, *said):
        flockstep.render(room, *pose, look_at=look_at)


def test_render_view_chooses(room):
    shapes = {}
    for name in ("top", "third_person"):
        envs = begun(2, worlds=room, render_mode="rgb_array", render_view=name)
        shapes[name] = [frame.shape for frame in envs.render()]
        envs.close()
    assert shapes == {"top": [(256, 256, 3)] * 2, "third_person": [(480, 640, 3)] * 2}
    with refused(UserWarning, "for pictures"):
        assert flockstep.DroneVectorEnv(1, worlds=room, render_view="third_person").render() is None


@pytest.mark.parametrize("view", ["top", "third_person", "camera", ((1, 1, 2), (4, 4, 2))])
def test_the_size_is_chosen(room, view):
    camera = flockstep.CameraConfig(width_px=32, height_px=24)
    keywords = {"worlds": room, "camera": camera, "render_mode": "rgb_array", "render_view": view}
    envs = gymnasium.make_vec("flockstep/LidarNavigation-v0", 1, **keywords, render_size=(120, 60))
    single = gymnasium.make("flockstep/LidarNavigation-v0", **keywords, render_size=(120, 60))
    envs.reset(seed=0)
    single.reset(seed=0)
    image = single.render()
    assert [frame.shape for frame in envs.render()] == [(60, 120, 3)]
    np.testing.assert_array_equal(envs.render()[0], image)
    if view == "camera":  # every pixel enlarged two and a half times, between black borders
        down, right = np.arange(1, 120, 2) // 5, np.arange(1, 160, 2) // 5
        np.testing.assert_array_equal(image[:, 20:100], envs.batch.camera().rgb[0][np.ix_(down, right)])
        assert not image[:, :20].any()
        assert not image[:, 100:].any()
    envs.close()
    single.close()


def test_the_camera_is_chosen(room):
    cameras = [flockstep.CameraConfig(name=name, width_px=16, height_px=12) for name in ("ahead", "below")]
    cameras[1].quat_wxyz = (0.70710678, 0, 0.70710678, 0)
    keywords = {"worlds": room, "camera": cameras, "render_mode": "rgb_array"}
    for name, index in ((None, 0), ("below", 1), ("ahead", 0)):
        envs = begun(1, **keywords, render_view="camera", render_camera=name)
        np.testing.assert_array_equal(envs.render()[0], envs.batch.camera(cameras[index].name).rgb[0])
    with refused(ValueError, "render_camera", "behind"):
        flockstep.DroneVectorEnv(1, **keywords, render_view="camera", render_camera="behind")


def shown(room, **keywords):
    """A picture of an env from a corner of the room, after a step."""
    view = ((0.5, 0.5, 3.5), (5, 6, 1))
    keywords = {"render_view": view, "render_size": (160, 120), "render_mode": "rgb_array", **keywords}
    envs = begun(1, worlds=room, **keywords)
    envs.step([0])
    (image,) = envs.render()
    envs.close()
    return image


def test_the_dark_style_is_dark_with_bright_drones(room):
    bright, dark = (shown(room, render_style=style).astype(int) for style in ("bright", "dark"))
    assert bright.mean() > 140
    assert dark.mean() < 70
    assert (dark.max(axis=-1) > 200).sum() > 10
    # The same world from the same place: what is lit in one picture is not somewhere else in the other.
    edges = [np.abs(np.diff(image.mean(axis=-1), axis=1)) > 4 for image in (bright, dark)]
    assert (edges[0] & edges[1]).sum() > 0.3 * edges[1].sum()


def test_the_soft_style_darkens_corners(room):
    bright, soft = (shown(room, render_style=style).astype(int) for style in ("bright", "soft"))
    darker = bright.max(axis=-1) - soft.max(axis=-1)
    assert (darker > 40).mean() > 0.01  # along the edges of the room
    assert (np.abs(darker) < 3).mean() > 0.2  # in the middle of its walls


@pytest.mark.parametrize("samples", [4, 16])
@pytest.mark.parametrize(
    ("world", "viewer", "target"),
    [("playground/train-3", (2, 7, 3.4), (11.7, 6.3, 2)), ("indoor/warehouse", (4, 14, 3), (11, 18.9, 1.6))],
)
def test_adaptive_samples_look_like_all_samples(world, viewer, target, samples):
    def taken(**fields):
        camera = flockstep.CameraConfig(hfov_deg=75, shadows=True, **fields)
        return flockstep.render(world, viewer, look_at=target, camera=camera)["rgb"].astype(int)

    adaptive, every = (taken(samples_per_pixel=samples, adaptive_samples=few) for few in (True, False))
    for other, mean, strong in ((adaptive, (0, 0.4), (-1, 2e-3)), (taken(), (0.3, 5), (5e-3, 1))):
        apart = np.abs(other - every).max(axis=-1)
        assert mean[0] < apart.mean() < mean[1]
        assert strong[0] < (apart > 16).mean() < strong[1]


def test_more_samples_smooth_edges_only(room):
    one, four, sixteen = (shown(room, render_samples=samples).astype(int) for samples in (1, 4, 16))
    np.testing.assert_array_equal(four, shown(room))
    apart = [np.abs(image - sixteen).max(axis=-1) for image in (one, four)]
    assert apart[1].mean() < 0.6 * apart[0].mean()
    assert (apart[0] > 8).mean() < 0.2


def test_odd_places_and_sizes_are_sane_pictures(room):
    """One pixel, a viewer inside the pillar, and one outside the room."""
    assert shown(room, render_size=(1, 1)).shape == (1, 1, 3)
    assert shown(room, render_size=(1, 1), render_view="third_person", render_samples=16).shape == (1, 1, 3)
    inside = shown(room, render_view=((4, 4.5, 2), (8, 4.5, 2)))
    assert inside.any()
    outside = shown(room, render_view=((-30, -30, 20), (4, 4, 2)))
    assert outside.any()


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"render_size": 100}, ["render_size", 100]),
        ({"render_size": (100, 0)}, ["render_size", (100, 0)]),
        ({"render_size": (100.5, 10)}, ["render_size", (100.5, 10)]),
        ({"render_size": (True, 10)}, ["render_size", (True, 10)]),
        ({"render_camera": "eye"}, ["render_camera", "eye"]),
        ({"render_view": "fleet", "render_style": "drak"}, ["render_style", "bright", "dark", "drak"]),
        ({"render_view": "fleet", "render_style": 7}, ["render_style", 7]),
        ({"render_view": "top", "render_style": "dark"}, ["render_style", "top", "dark"]),
        ({"render_view": "fleet", "render_samples": 2}, ["render_samples", 1, 4, 9, 16, 2]),
        ({"render_view": "fleet", "render_samples": True}, ["render_samples", True]),
        ({"render_view": "side"}, ["render_view", "side"]),
        ({"render_view": ((0, 0, 0),)}, ["render_view", "two points"]),
        ({"render_view": ((0, 0, 0), (0, 0, 0))}, ["render_view", "two points"]),
        ({"render_view": ((0, 0, 0), (0, np.nan, 1))}, ["render_view", "two points"]),
        ({"render_view": 7}, ["render_view", 7]),
        ({"render_view": True}, ["render_view", True]),
        ({"render_view": "camera", "render_mode": "rgb_array"}, ["render_view", "camera"]),
    ],
)
def test_keywords_are_checked_with_and_without_pictures(room, keywords, said):
    with refused(ValueError, *said):
        flockstep.DroneVectorEnv(1, worlds=room, **keywords)


@pytest.mark.parametrize("camera", [{}, {"layout": "chw"}, {"outputs": ("grey",)}])
def test_the_drones_own_camera(room, camera):
    config = flockstep.CameraConfig(name="eye", width_px=32, height_px=24, **camera)
    batch = flockstep.Batch([room], 2, cameras=[config])
    view, trail = views.make(choice.choose("camera", None, None), batch, [config])
    assert trail is None
    batch.set_pose(np.float32([[2, 4, 2], [2, 6, 1]]))
    batch.sense()
    frames = [view.frame(0), view.frame(1)]
    batch.begin_episode(np.array([True, False]))
    assert view.frame(0).shape == (24, 32, 3)
    assert not view.frame(0).any()  # its last frame belongs to the previous episode
    expected = flockstep.render(room, (2, 6, 1), camera=flockstep.CameraConfig(width_px=32, height_px=24))["rgb"]
    assert frames[1].shape == (24, 32, 3)
    if "outputs" not in camera:
        np.testing.assert_array_equal(frames[1], expected)
    else:
        np.testing.assert_array_equal(frames[1][..., 0], batch.camera("eye").grey[1])
    kept = frames[0].copy()
    batch.set_pose(np.float32([[5, 2, 2], [2, 6, 1]]))
    batch.sense()
    np.testing.assert_array_equal(frames[0], kept)  # a copy


def test_a_camera_without_colours_is_refused(room):
    config = flockstep.CameraConfig(width_px=8, height_px=8, outputs=("depth",))
    batch = flockstep.Batch([room], cameras=[config])
    with refused(ValueError, "render_view", "camera", "rgb", "grey"):
        views.make(choice.choose("camera", None, None), batch, [config])


def test_stable_baselines_gets_pictures_and_trails(room):
    pytest.importorskip("stable_baselines3")
    vec = flockstep.sb3.make_vec(
        "flockstep/LidarNavigation-v0",
        2,
        worlds=room,
        render_mode="rgb_array",
        render_view="third_person",
        render_size=(320, 200),
    )
    vec.seed(0)
    vec.reset()
    for _ in range(3):
        vec.step(np.array([0, 0]))
    assert vec.env.trail is not None
    assert len(vec.env.trail.of(1)) == 4
    assert [image.shape for image in vec.get_images()] == [(200, 320, 3)] * 2
    vec.close()
