"""Pictures from behind and above a drone: the world, the drone, its LiDAR beams, its cameras' views, its trail."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt

from swiftlet._core import Batch, CameraConfig, DroneModel, LidarConfig, World
from swiftlet.depth_canvas import Color, DepthCanvas, Floats, Image
from swiftlet.picture import facing, render
from swiftlet.task import rotate
from swiftlet.trail import Trail

_DRONE = (0.03, 0.09, 0.42)  # linear, as materials are
_EDGE: Color = (20, 40, 110)
_TRAIL: Color = (35, 90, 210)
_BEAM: Color = (250, 130, 70)
_HIT: Color = (200, 50, 20)
_FRUSTUM: Color = (130, 40, 170)

# In lengths of the drone:
_BACK = np.array([-3.4, 1.4, 0.0])  # the viewer is behind the drone and to its left,
_UP = np.array([0.0, 0.0, 2.3])  # above it,
_FREE = 0.3  # so far from a wall,
_AHEAD = 0.5  # and looks at what is before the drone
_FRUSTUM_LENGTH = 1.1  # cameras' views as they are drawn
_FADE = 0.5  # in which obstacles before the drone dissolve
_DISSOLVED = 0.3  # their opacity then
_NEAR_M = 0.05
_MAX_BEAMS = 256  # more would hide the world
_FINER = 2  # drawn so many times larger, then averaged: smooth edges


class ThirdPersonView:
    """Draws the envs of a batch, each from behind and above its drone, within the same room.

    Parameters
    ----------
    batch
        Whose drones to draw.
    drone
        The batch's drone model; None for the default one.
    lidar
        The batch's LiDAR. A beam that hits nothing is drawn as long as the drone's range. None draws no beams.
    cameras
        Names of cameras of the batch whose views are drawn.
    trail
        Where the drones have been. None draws no trails.
    width_px, height_px
        Of the picture.
    """

    def __init__(
        self,
        batch: Batch,
        drone: DroneModel | None = None,
        lidar: LidarConfig | None = None,
        cameras: Sequence[str] = (),
        trail: Trail | None = None,
        *,
        width_px: int = 640,
        height_px: int = 480,
    ) -> None:
        self._batch = batch
        self._lidar = lidar
        self._directions = None if lidar is None else np.asarray(batch.lidar_directions, float)
        self._cameras = [batch.camera(name) for name in cameras]
        self._trail = trail
        self._corners = np.asarray((DroneModel() if drone is None else drone).hull, float)
        self._normals, self._offsets = _faces(self._corners)
        self._edges = _edges(self._corners, self._normals, self._offsets)
        self._length = float(np.ptp(self._corners, axis=0).max())
        self._size_px = (width_px * _FINER, height_px * _FINER)

    def frame(self, env: int) -> Image:
        """Return the picture of one env, (height_px, width_px, 3) uint8, a new array."""
        world = self._batch.worlds[self._batch.world_index[env]]
        position = np.asarray(self._batch.position[env], float)
        quat_wxyz = np.asarray(self._batch.quat_wxyz[env], float)
        stage = _Stage(world, position, quat_wxyz, self._length, self._size_px)
        if self._batch.active[env]:
            self._draw_drone(stage.canvas, world, position, quat_wxyz)
            self._draw_trail(stage.canvas, env)
            self._draw_cameras(stage.canvas, env, position, quat_wxyz)
            self._draw_beams(stage.canvas, env, position, quat_wxyz)
        return _averaged(stage.finished())

    def _draw_drone(self, canvas: DepthCanvas, world: World, position: Floats, quat_wxyz: Floats) -> None:
        normals = rotate(quat_wxyz, self._normals)
        corners = position + rotate(quat_wxyz, self._corners)
        canvas.solid(normals, self._offsets + normals @ position, corners, _shaded(world, normals, _DRONE))
        canvas.lines(corners[self._edges[:, 0]], corners[self._edges[:, 1]], _EDGE, width_px=_FINER)

    def _draw_trail(self, canvas: DepthCanvas, env: int) -> None:
        if self._trail is None:
            return
        path = self._trail.of(env)
        canvas.lines(path[:-1], path[1:], _TRAIL, width_px=2 * _FINER)

    def _draw_cameras(self, canvas: DepthCanvas, env: int, position: Floats, quat_wxyz: Floats) -> None:
        for camera in self._cameras:
            apex, *corners = position + rotate(
                quat_wxyz, frustum(camera.config_of(env), _FRUSTUM_LENGTH * self._length)
            )
            for corner, following in zip(corners, corners[1:] + corners[:1], strict=True):
                canvas.lines(np.array([apex, corner]), np.array([corner, following]), _FRUSTUM, width_px=_FINER)

    def _draw_beams(self, canvas: DepthCanvas, env: int, position: Floats, quat_wxyz: Floats) -> None:
        if self._lidar is None or self._directions is None:
            return
        ranges = np.asarray(self._batch.lidar_ranges[env], float).ravel()
        directions = rotate(quat_wxyz, self._directions[env].reshape(-1, 3))
        origin = position + rotate(quat_wxyz, np.asarray(self._lidar.offset_m, float))
        hit = np.isfinite(ranges)
        ends = origin + directions * np.where(hit, ranges, self._batch.lidar_max_range_m[env])[:, None]
        some = np.arange(0, len(ends), -(-len(ends) // _MAX_BEAMS))
        canvas.lines(np.broadcast_to(origin, ends[some].shape), ends[some], _BEAM, width_px=_FINER, opacity=0.6)
        canvas.dots(ends[hit], _HIT, size_px=3 * _FINER)


def frustum(camera: CameraConfig, length_m: float) -> Floats:
    """Return where a camera is and the four corners of what it sees at a depth, (5, 3) m, body frame.

    The corners are those of the image: upper left, upper right, lower right, lower left.
    """
    left, right = camera.cx / camera.fx, (camera.cx - camera.width_px) / camera.fx
    top, bottom = camera.cy / camera.fy, (camera.cy - camera.height_px) / camera.fy
    local = np.array([[0, 0, 0], [1, left, top], [1, right, top], [1, right, bottom], [1, left, bottom]]) * length_m
    return np.asarray(camera.offset_m, float) + rotate(np.asarray(camera.quat_wxyz, float), local)


class _Stage:
    """The world as seen from behind a drone: a canvas, before which obstacles that are in the way dissolve."""

    def __init__(
        self, world: World, position: Floats, quat_wxyz: Floats, length: float, size_px: tuple[int, int]
    ) -> None:
        kinds = [primitive["kind"] for primitive in world.primitives]
        solid = np.array([kind != "room" for kind in kinds], bool)
        viewer, turn = _viewpoint(world, solid, position, quat_wxyz, length)
        ahead = float(rotate(turn, position - viewer, inverse=True)[0])
        cut = max(ahead - length / 2, 2 * _NEAR_M)  # nearer than the drone
        camera = CameraConfig(width_px=size_px[0], height_px=size_px[1], hfov_deg=75.0, near_m=_NEAR_M, far_m=1000.0)
        camera.outputs = ("rgb", "depth", "instance")
        picture = render(world, viewer, turn, camera=camera)
        rgb, depth = picture["rgb"], picture["depth"]

        dissolves = np.zeros(1 << 16, bool)  # by instance: meshes do not, floors may be among them
        dissolves[1 : 1 + len(solid)] = solid
        self._at = np.flatnonzero(depth < cut)  # pixels
        self._at = self._at[dissolves[picture["instance"].reshape(-1)[self._at]]]
        if len(self._at):
            camera.near_m, camera.outputs = cut, ("rgb", "depth")
            beyond = render(world, viewer, turn, camera=camera)
            if "room" in kinds:  # where nothing is beyond, a wall has been cut away, too
                self._at = self._at[np.isfinite(beyond["depth"].reshape(-1)[self._at])]
            self._rgb, self._depth = rgb.reshape(-1, 3)[self._at], depth.reshape(-1)[self._at]
            rgb.reshape(-1, 3)[self._at] = beyond["rgb"].reshape(-1, 3)[self._at]
            depth.reshape(-1)[self._at] = beyond["depth"].reshape(-1)[self._at]
        self._opacity_per_m = (1 - _DISSOLVED) / (length * _FADE)
        self._cut = cut
        camera.near_m = _NEAR_M
        self.canvas = DepthCanvas(rgb, depth, camera, viewer, turn)

    def finished(self) -> Image:
        """Return the canvas with the obstacles before it."""
        if len(self._at):
            rgb = self.canvas.rgb.reshape(-1, 3)
            opacity = np.maximum(1 - (self._cut - self._depth) * self._opacity_per_m, np.float32(_DISSOLVED))
            opacity[self.canvas.depth.reshape(-1)[self._at] < self._depth] = 0  # drawn before it
            behind = rgb[self._at].astype(np.float32)
            rgb[self._at] = behind + opacity[:, None] * (self._rgb - behind) + np.float32(0.5)
        return self.canvas.rgb


def _viewpoint(
    world: World, solid: npt.NDArray[np.bool_], position: Floats, quat_wxyz: Floats, length: float
) -> tuple[Floats, Floats]:
    """Return from where to look at a drone, and how turned."""
    forward = rotate(quat_wxyz, np.array([1.0, 0.0, 0.0]))
    heading = np.arctan2(forward[1], forward[0])  # level, whatever the drone's tilt
    level = np.array([np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)])
    # Up to the ceiling, then back to the wall: near a wall the view comes from above.
    viewer = _pushed(world, solid, position, length * _UP, length * _FREE)
    viewer = _pushed(world, solid, viewer, length * rotate(level, _BACK), length * _FREE)
    viewer = _pushed(world, solid, position, viewer - position, 0.0)
    ahead = position + length * rotate(level, np.array([_AHEAD, 0.0, 0.0]))
    return viewer, facing(viewer, ahead).astype(float)


def _pushed(world: World, solid: npt.NDArray[np.bool_], origin: Floats, way: Floats, free: float) -> Floats:
    """Return where one gets from a point (3,) along a way (3,) m: through what dissolves, to before a wall."""
    length = float(np.linalg.norm(way))
    if length == 0:
        return origin
    gone = 0.0
    for _ in range(2 * len(solid) + 1):
        hit = world.raycast((origin + gone * way / length)[None], way[None], length + free - gone)
        gone += float(hit["t_hit"][0])
        if not 0 <= hit["primitive"][0] < len(solid) or not solid[hit["primitive"][0]]:
            break
        gone += 1e-3  # into it, or out of it
    reach = min(length, max(gone - free, gone / 2))
    return origin + way / length * reach


def _shaded(world: World, normals: Floats, color: tuple[float, float, float]) -> Image:
    """Return the colours (F, 3) of faces, lit as cameras see the world."""
    light = {name: np.asarray(value, float) for name, value in world.light.items()}
    sun = np.maximum(normals @ light["sun_direction"], 0)[:, None] * light["sun_color"]
    up = (1 + normals[:, 2:]) / 2
    ambient = light["ground_ambient"] + up * (light["sky_ambient"] - light["ground_ambient"])
    values: Floats = 255 * np.minimum(color * (sun + ambient), 1) ** (1 / light["gamma"])
    return np.rint(values).astype(np.uint8)


def _averaged(fine: Image) -> Image:
    rows = fine[::_FINER].astype(np.uint16)
    for i in range(1, _FINER):
        rows += fine[i::_FINER]
    total = rows[:, ::_FINER].copy()
    for j in range(1, _FINER):
        total += rows[:, j::_FINER]
    return ((total + _FINER * _FINER // 2) // (_FINER * _FINER)).astype(np.uint8)


def _faces(corners: Floats) -> tuple[Floats, Floats]:
    """Return the half spaces normals (F, 3) . p <= offsets (F,) that make the convex hull of points (V, 3)."""
    a, b, c = corners[np.array(list(combinations(range(len(corners)), 3))).T]
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    scale = float(np.ptp(corners, axis=0).max())
    kept = sizes > 1e-6 * scale**2
    normals, a = normals[kept] / sizes[kept, None], a[kept]
    offsets = np.einsum("ij,ij->i", normals, a)
    beyond = normals @ corners.T - offsets[:, None]
    outer = beyond.max(axis=1) <= 1e-5 * scale
    inner = beyond.min(axis=1) >= -1e-5 * scale  # the plane of a face, seen from within
    planes = np.concatenate(
        [
            np.insert(normals[outer], 3, offsets[outer], axis=1),
            np.insert(-normals[inner], 3, -offsets[inner], axis=1),
        ]
    )
    _, first = np.unique(np.round(planes, 4) + 0.0, axis=0, return_index=True)
    return planes[first, :3], planes[first, 3]


def _edges(corners: Floats, normals: Floats, offsets: Floats) -> npt.NDArray[np.intp]:
    """Return the edges of a convex body as pairs (E, 2) of its corners."""
    on_face = (np.abs(corners @ normals.T - offsets) <= 1e-4 * np.ptp(corners, axis=0).max()).astype(int)
    return np.argwhere(np.triu(on_face @ on_face.T >= 2, 1))
