"""The camera backend ``gl``: it shows what raycast shows, refuses the rest, and raycast replaces it if OpenGL fails."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import numpy.typing as npt
import pytest
from conftest import world_of

import flockstep

OUTPUTS = ("rgb", "depth", "semantic", "instance", "normal", "grey")
POSES = 200


def random_poses(
    world: flockstep.World, count: int, rng: np.random.Generator
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Random poses in the world's bounds with any rotation."""
    low, high = np.asarray(world.bounds, float)
    quat = rng.normal(size=(count, 4))
    return (
        rng.uniform(low + 0.3, high - 0.3, (count, 3)).astype(np.float32),
        (quat / np.linalg.norm(quat, axis=1, keepdims=True)).astype(np.float32),
    )


def pictures(
    backend: str, world: flockstep.World, poses: tuple[npt.NDArray[np.float32], ...], **fields: object
) -> flockstep.Camera:
    camera = flockstep.CameraConfig(outputs=OUTPUTS, **fields)
    batch = flockstep.Batch([world], len(poses[0]), cameras=[camera], camera_backend=backend)
    assert batch.camera_backend_report().startswith(backend)
    batch.set_pose(*poses)
    batch.capture()
    return batch.camera()


def off_silhouettes(*ids: npt.NDArray[np.uint16]) -> npt.NDArray[np.bool_]:
    """Pixels whose 3 x 3 neighbourhood has one id in each image, without the image border."""
    alone = np.ones((ids[0].shape[0], ids[0].shape[1] - 2, ids[0].shape[2] - 2), bool)
    for image in ids:
        centre = image[:, 1:-1, 1:-1]
        for row in range(3):
            for column in range(3):
                shifted = image[:, row : row + centre.shape[1], column : column + centre.shape[2]]
                alone &= shifted == centre
    return alone


def gems() -> flockstep.World:
    """Octahedra of triangles, each a separate object, over a floor of triangles under an open sky.

    They are convex, so there are no silhouettes within an id.
    """
    rng = np.random.default_rng(4)
    faces = [[i, j, k] if (i + j + k) % 2 else [i, k, j] for i in (0, 1) for j in (2, 3) for k in (4, 5)]
    meshes = []
    for _ in range(120):
        arms = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.1, 0.9, 3)[:, None]
        centre = rng.uniform([-8, -8, 1], [8, 8, 5])
        corners = centre + np.stack([arms, -arms], axis=1).reshape(6, 3)
        meshes.append({"vertices": corners.tolist(), "triangles": faces, "material": str(rng.choice(["clay", "sand"]))})
    floor = [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]
    meshes.append({"vertices": floor, "triangles": [[0, 1, 2], [0, 2, 3]], "material": "sand"})
    return world_of(
        name="gems",
        materials={
            "clay": {"base_color": [0.6, 0.3, 0.2]},
            "sand": {"base_color": [0.7, 0.6, 0.4]},
        },
        meshes=meshes,
    )


def is_close(ours: npt.NDArray[np.float32], theirs: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Return whether depths are as close as the backends promise: within 1 mm and 0.1 %."""
    return np.isclose(theirs, ours, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    "name", ["gems", "playground/camera-train-1", "outdoor/forest", "outdoor/city", "indoor/office"]
)
def test_backends_agree(name: str) -> None:
    world = gems() if name == "gems" else flockstep.scenes.load(name)[0].with_light(fog_visibility_m=0)
    poses = random_poses(world, POSES, np.random.default_rng(0))
    size = {"width_px": 40, "height_px": 30}
    raycast, gl = (pictures(backend, world, poses, **size) for backend in ("raycast", "gl"))
    assert (raycast.semantic == gl.semantic).mean() >= 0.995
    assert (raycast.instance == gl.instance).mean() >= 0.995
    inner = off_silhouettes(raycast.instance, gl.instance)
    assert inner.mean() > (0.4 if name in flockstep.scenes.GENERATED else 0.5)  # shelves are full of small objects
    ours, theirs = (camera.depth[:, 1:-1, 1:-1][inner] for camera in (raycast, gl))
    np.testing.assert_array_equal(np.isfinite(ours), np.isfinite(theirs))
    seen = np.isfinite(ours)
    # A tree and a gate's frame occlude themselves, so there are silhouettes within their ids.
    assert (~is_close(ours, theirs)).mean() <= (1e-4 if name in flockstep.scenes.GENERATED or world.gates else 0)
    for output in ("rgb", "grey"):
        ours, theirs = (getattr(camera, output)[:, 1:-1, 1:-1][inner].astype(int) for camera in (raycast, gl))
        assert np.abs(ours - theirs).mean() < 2
    turned = (raycast.normal * gl.normal).sum(-1)[:, 1:-1, 1:-1][inner]
    assert (turned[seen] > 0.995).mean() > 0.99  # except at edges between the walls of a room, which are one instance


@pytest.mark.parametrize("fields", [{"samples_per_pixel": 9}, {"layout": "chw", "depth_kind": "range"}])
def test_options_agree(fields: dict[str, object]) -> None:
    world = world_of(
        materials={"clay": {"base_color": [0.6, 0.3, 0.2]}, "sand": {"base_color": [0.7, 0.6, 0.4]}},
        planes=[{"center": [0, 0, 0], "size": [20, 20], "material": "sand"}],
        boxes=[{"center": [2, 0, 0.5], "size": [1, 1, 1], "quat_wxyz": [0.9239, 0, 0, 0.3827], "material": "clay"}],
        spheres=[{"center": [3, 2, 1], "radius": 0.7, "material": "clay"}],
        capsules=[{"center": [3, -2, 1.2], "radius": 0.3, "height": 2, "material": "clay"}],
        meshes=[{"vertices": [[4, -1, 0], [4, 1, 0], [4, 0, 2]], "triangles": [[0, 1, 2]], "material": "clay"}],
    )
    rng = np.random.default_rng(1)
    angle = rng.uniform(-0.4, 0.4, 50)
    poses = (
        rng.uniform([-3, -2, 0.5], [-1, 2, 2.5], (50, 3)).astype(np.float32),
        np.stack([np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], 1).astype(np.float32),
    )
    raycast, gl = (
        pictures(backend, world, poses, width_px=64, height_px=48, **fields) for backend in ("raycast", "gl")
    )
    assert (raycast.instance == gl.instance).mean() >= 0.995
    inner = off_silhouettes(raycast.instance, gl.instance)
    axis = 1 if "layout" in fields else 3
    difference = np.abs(raycast.rgb.astype(int) - gl.rgb).max(axis=axis)[:, 1:-1, 1:-1][inner]
    assert difference.mean() < 2
    ours, theirs = raycast.depth[:, 1:-1, 1:-1][inner], gl.depth[:, 1:-1, 1:-1][inner]
    seen = np.isfinite(ours) & np.isfinite(theirs)
    assert seen.mean() > 0.3
    assert is_close(ours[seen], theirs[seen]).all()


@pytest.mark.parametrize("capture_mode", ["every_step", "on_movement"])
def test_envs_fly_by_gl_as_by_raycast(capture_mode: str) -> None:
    """With a LiDAR, across episode ends, and with frames of which only some are due."""
    raycast, gl = (
        flockstep.DroneVectorEnv(
            8,
            observation="pixels",
            camera=flockstep.CameraConfig(width_px=32, height_px=24, layout="chw", capture_mode=capture_mode),
            camera_backend=backend,
            max_episode_steps=7,
            stagger_first_episode=True,
        )
        for backend in ("raycast", "gl")
    )
    assert gl.batch.camera_backend_report().startswith("gl")
    rng = np.random.default_rng(3)
    ours, theirs = raycast.reset(seed=0)[0], gl.reset(seed=0)[0]
    ended = 0
    for _ in range(30):
        assert np.abs(ours["image"].astype(int) - theirs["image"]).mean() < 2
        np.testing.assert_array_equal(ours["ranges"], theirs["ranges"])
        np.testing.assert_array_equal(raycast.batch.camera().frame_step, gl.batch.camera().frame_step)
        actions = rng.integers(3, size=8)
        (ours, *rest), (theirs, *rest_of_theirs) = raycast.step(actions), gl.step(actions)
        np.testing.assert_equal(rest[:3], rest_of_theirs[:3])
        ended += int((rest[1] | rest[2]).sum())
    assert ended > 16


def test_auto_is_raycast() -> None:
    world = flockstep.scenes.load("playground/camera-train-1")[0]
    batch = flockstep.Batch([world], 4, cameras=[flockstep.CameraConfig()], camera_backend="auto")
    assert batch.camera_backend_report() == "raycast: the choice of auto"


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    program = (
        "import warnings, numpy as np, flockstep\n"
        "world = flockstep.scenes.load('playground/camera-train-1')[0]\n"
        "camera = flockstep.CameraConfig(width_px=32, height_px=24)\n"
        "def make(backend): return flockstep.Batch([world], 4, cameras=[camera], camera_backend=backend)\n"
    )
    forks = "ignore:This process:DeprecationWarning"  # since Python 3.12 a fork beside other threads warns
    return subprocess.run(
        [sys.executable, "-W", forks, "-c", program + code],
        env={**os.environ, **environment},
        check=False,
        capture_output=True,
        text=True,
        timeout=120,
    )


@pytest.mark.parametrize("trouble", ["missing", "failing"])
def test_without_opengl_raycast_renders_with_one_warning(trouble: str) -> None:
    # libepoxy calls OpenGL through function pointers: the error after each readback is replaced by getpid().
    fail = (
        "import ctypes\n"
        "variable = ctypes.c_void_p.in_dll(ctypes.CDLL('libepoxy.so.0'), 'epoxy_glGetError')\n"
        "variable.value = ctypes.cast(ctypes.CDLL(None).getpid, ctypes.c_void_p).value\n"
    )
    result = run(
        (fail if trouble == "failing" else "") + "with warnings.catch_warnings(record=True) as caught:\n"
        "    warnings.simplefilter('always')\n"
        "    batch = make('gl')\n"
        "    batch.sense(); batch.sense()\n"
        "reference = make('raycast'); reference.sense()\n"
        "assert np.array_equal(batch.camera().rgb, reference.camera().rgb)\n"
        "assert batch.camera().rgb.any()\n"
        "print(len(caught), caught[0].category.__name__, caught[0].message, '|', batch.camera_backend_report())\n",
        FLOCKSTEP_EGL="none" if trouble == "missing" else "",
    )
    assert result.returncode == 0, result.stderr
    why = "EGL is switched off" if trouble == "missing" else "OpenGL failed with error"
    assert result.stdout.startswith(f"1 RuntimeWarning cameras: gl is not available; raycast renders instead: {why}")
    assert "| raycast: gl is not available (" in result.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="limits the address space")
@pytest.mark.parametrize("gibibytes", [0.05, 0.3, 0.9, 6.0])
def test_a_small_address_space_costs_opengl_and_not_the_process(gibibytes: float) -> None:
    """Without care, Mesa would end the process."""
    result = run(
        "import os, resource\n"
        # TBB ends the process if it cannot start a thread for each processor
        "os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])\n"
        "used = int(open('/proc/self/statm').read().split()[0]) * 4096\n"
        f"resource.setrlimit(resource.RLIMIT_AS, (used + int({gibibytes} * 2**30),) * 2)\n"
        "warnings.simplefilter('ignore')\n"
        "batch = make('gl'); batch.capture(); print(batch.camera_backend_report())"
    )
    assert result.returncode == 0, result.stderr
    if gibibytes > 5.1:  # enough for everything that it uses
        assert result.stdout.startswith("gl: ")
    elif gibibytes < 1:
        assert "the limit on address space is too low" in result.stdout


def test_raycast_needs_no_opengl_and_does_not_warn() -> None:
    result = run("make('raycast').sense()\n", FLOCKSTEP_EGL="none")
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


@pytest.mark.parametrize(
    "end",
    [
        "",  # the batch is alive when the interpreter ends
        "import atexit; atexit.register(lambda: batch.sense())\n",
        "raise SystemExit(0)\n",
        "import threading\n"
        "others = [batch, make('gl'), make('gl')]\n"
        "threads = [threading.Thread(target=lambda b=b: [b.sense() for _ in range(20)]) for b in others]\n"
        "[t.start() for t in threads]; [t.join() for t in threads]\n"
        "assert all(np.array_equal(b.camera().rgb, batch.camera().rgb) for b in others)\n",
        "import os; pid = os.fork()\nif pid: os.waitpid(pid, 0)\n",  # the child has a copy that it must not touch
        "import os; pid = os.fork()\n"
        "if pid:\n"
        "    assert os.waitpid(pid, 0)[1] == 0\n"
        "else:\n"
        "    with warnings.catch_warnings(record=True) as caught:\n"
        "        warnings.simplefilter('always'); own = make('gl'); own.sense()\n"
        "    assert 'forked' in str(caught[0].message) and own.camera().rgb.any()\n"
        "    os._exit(0)\n",  # like multiprocessing: exit handlers of Mesa wait for threads of the parent
        "batches = [make('gl') for _ in range(20)]\nfor b in batches: b.sense()\n",
        "for _ in range(30): make('gl').sense()\n",
        "try:\n    batch.capture(np.ones(3, bool))\nexcept ValueError: pass\nbatch.capture()\n",
    ],
)
def test_gl_ends_cleanly(end: str) -> None:
    if "fork" in end and not hasattr(os, "fork"):
        pytest.skip("no fork on this system")
    result = run("batch = make('gl'); batch.sense()\nassert batch.camera().rgb.any()\n" + end)
    assert (result.returncode, result.stderr) == (0, "")
