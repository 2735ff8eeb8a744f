"""Pictures of a drone from behind and above it, or from a fixed place, with beams, camera frustums and trail."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flockstep._core import Batch, CameraConfig, World
from flockstep.drone_mesh import DroneMesh
from flockstep.pictures.body import Body
from flockstep.pictures.depth_canvas import Color, DepthCanvas, Floats, Image
from flockstep.pictures.drawing import Drawing, Overlay, line_px
from flockstep.pictures.lines import Trail, beams_of, draw_move_lines, drones_of_env
from flockstep.pictures.posed_bodies import posed_bodies
from flockstep.pictures.stage import Obstacles, Stage, with_markers
from flockstep.rotations import rotate
from flockstep.task import MARKERS

_TRAIL: Color = (35, 90, 210)
_BEAM: Color = (250, 130, 70)
_HIT: Color = (200, 50, 20)
_FRUSTUM: Color = (130, 40, 170)

_FRUSTUM_LENGTH = 1.1  # length of the drawn camera frustums, in drone lengths
_MAX_BEAMS = 256  # more would hide the world
_FINER = 2  # supersampling factor, for smooth edges
_WORLDS = 64  # maximum number of cached worlds
_FOLLOWED, _LAG = 12, 0.5  # steps whose mean position the viewer follows; maximum lag in drone lengths
_MEAN, _OFF = 4, 0.25  # steps before and after that smooth a trail; maximum distance to it in drone lengths
_RECENT = 12  # drone lengths of the trail that a viewer who follows the drone sees


class ThirdPersonView:
    """Draws each env of a batch from behind and above its drone, inside the room, or from a fixed place.

    Parameters
    ----------
    batch
        The batch with the drones to draw.
    cameras
        Names of the batch's cameras whose frustums are drawn.
    trail
        Past positions of the drones, drawn smoothed; a viewer behind the drone sees the last 12 drone lengths. None
        draws no trails. With a trail the viewer follows a drone smoothly.
    beams
        Draw the LiDAR's beams. A beam without a hit is as long as the LiDAR's range.
    others
        Also draw the other drones of the same world, in paler colours.
    size_px
        Width and height of the picture. None: 640 x 480.
    place
        Two points (3,) m, world frame: the viewer and the point to look at. None: from behind and above the drone.
    markers
        The markers of the world to draw.
    overlay
        A `Task` or a `FlightOverlay`, whose `draw` adds to the pictures. None: no additions.
    mesh
        Mesh of the drones. None: drawn from their model.
    """

    def __init__(
        self,
        batch: Batch,
        cameras: Sequence[str] = (),
        trail: Trail | None = None,
        *,
        beams: bool = True,
        others: bool = False,
        size_px: tuple[int, int] | None = None,
        place: tuple[Floats, Floats] | None = None,
        markers: Sequence[str] = MARKERS,
        overlay: Overlay | None = None,
        mesh: DroneMesh | None = None,
    ) -> None:
        self._batch = batch
        self._cameras = [batch.camera(name) for name in cameras]
        self._trail = trail
        self._beams = beams
        self._others = others
        self._body = Body(batch.drone, mesh)
        corners = [np.asarray(batch.drone.hull, float)] + ([] if mesh is None else [mesh.vertices])
        self._length = float(max(np.ptp(points, axis=0).max() for points in corners))
        width, height = size_px or (640, 480)
        self._size_px = (width * _FINER, height * _FINER)
        self._line_px = _FINER * line_px(width)
        self._place = place
        self._markers = tuple(markers)
        self._overlay = overlay
        self._stages: dict[World, Stage] = {}  # by the world that `Batch.world_of` returns, in its light
        self._still: dict[World, DepthCanvas] = {}  # for a fixed place

    def frame(self, env: int) -> Image:
        """Return the picture of one env, (height, width, 3) uint8, a new array."""
        world_index = np.repeat(self._batch.world_index, self._batch.drones_per_env)
        world = self._batch.world_of(env)
        if world not in self._stages:
            if len(self._stages) >= _WORLDS:
                self._stages.clear()
                self._still.clear()
            self._stages[world] = Stage(with_markers(world, self._markers), self._length, self._size_px)
        position = np.asarray(self._batch.position[env], float)
        quat_wxyz = np.asarray(self._batch.quat_wxyz[env], float)
        canvas, obstacles = self._canvas(world, env, position, quat_wxyz)
        if self._batch.active[env]:
            self._body.draw(canvas, position, quat_wxyz, line_px=self._line_px)
            self._draw_trail(canvas, env)
            draw_move_lines(canvas, self._batch, drones_of_env(self._batch, env), 2 * self._line_px)
            self._draw_cameras(canvas, env, position, quat_wxyz)
            if self._overlay is not None:
                self._overlay.draw(self._batch, env, Drawing(canvas, self._line_px))
            self._draw_beams(canvas, env)  # last, because they are transparent
        if self._others:
            for other in np.flatnonzero(self._batch.active & (world_index == world_index[env])):
                if other != env:
                    pose = self._batch.position[other].astype(float), self._batch.quat_wxyz[other].astype(float)
                    self._body.draw(canvas, *pose, pale=True, line_px=self._line_px)
                    if other not in drones_of_env(self._batch, env):
                        draw_move_lines(canvas, self._batch, [int(other)], 2 * self._line_px)
        if obstacles is not None:
            obstacles.draw(canvas)
        return _averaged(canvas.rgb)

    def _canvas(
        self, world: World, env: int, position: Floats, quat_wxyz: Floats
    ) -> tuple[DepthCanvas, Obstacles | None]:
        """Return the world to draw into, and the obstacles to draw last."""
        stage = self._stages[world]
        bodies = posed_bodies(self._batch, env // self._batch.drones_per_env)
        stage.show_bodies(bodies)
        if self._place is None:
            return stage.set(position, quat_wxyz, self._anchor(env, position))
        if bodies:
            return stage.seen_from(*self._place), None
        if world not in self._still:
            self._still[world] = stage.seen_from(*self._place)
        return self._still[world].copy(), None

    def _anchor(self, env: int, position: Floats) -> Floats:
        """Return the point that the viewer follows: the drone's mean position over the last steps."""
        if self._trail is None or len(path := self._trail.of(env)[-_FOLLOWED:]) == 0:
            return position
        lag: Floats = path.mean(axis=0, dtype=float) - position
        return position + lag * min(1.0, _LAG * self._length / max(float(np.linalg.norm(lag)), 1e-9))

    def _draw_trail(self, canvas: DepthCanvas, env: int) -> None:
        if self._trail is None:
            return
        path = smoothed(self._trail.of(env).astype(float), _OFF * self._length)
        if self._place is None:  # older parts would cross the picture again and again
            left_m = np.cumsum(np.linalg.norm(np.diff(path[::-1], axis=0), axis=1))[::-1]
            path = path[int((left_m > _RECENT * self._length).sum()) :]
        canvas.lines(path[:-1], path[1:], _TRAIL, width_px=2 * self._line_px)

    def _draw_cameras(self, canvas: DepthCanvas, env: int, position: Floats, quat_wxyz: Floats) -> None:
        for camera in self._cameras:
            apex, *corners = position + rotate(
                quat_wxyz, frustum(camera.config_of(env), _FRUSTUM_LENGTH * self._length)
            )
            for corner, following in zip(corners, corners[1:] + corners[:1], strict=True):
                canvas.lines(np.array([apex, corner]), np.array([corner, following]), _FRUSTUM, width_px=self._line_px)

    def _draw_beams(self, canvas: DepthCanvas, env: int) -> None:
        if not self._beams:
            return
        origin, ends, hit = beams_of(self._batch, env)
        some = np.arange(0, len(ends), max(-(-len(ends) // _MAX_BEAMS), 1))
        canvas.lines(np.broadcast_to(origin, ends[some].shape), ends[some], _BEAM, width_px=self._line_px, opacity=0.6)
        canvas.dots(ends[hit], _HIT, size_px=3 * self._line_px)


def smoothed(path: Floats, most_m: float) -> Floats:
    """Return the mean of neighbouring positions along a path (K, 3) m, at most ``most_m`` off it; both ends stay.

    Steps along the axes would otherwise look like stairs.
    """
    count = len(path)
    index = np.arange(count)
    half = np.minimum(np.minimum(index, count - 1 - index), _MEAN)
    total = np.insert(np.cumsum(path, axis=0), 0, 0, axis=0)
    off = (total[index + half + 1] - total[index - half]) / (2 * half + 1)[:, None] - path
    length = np.linalg.norm(off, axis=1, keepdims=True)
    result: Floats = path + off * np.minimum(1, most_m / np.maximum(length, 1e-9))
    return result


def frustum(camera: CameraConfig, length_m: float) -> Floats:
    """Return a camera's position and the four corners of its view at a depth, (5, 3) m, body frame.

    The corners are in image order: upper left, upper right, lower right, lower left.
    """
    left, right = camera.cx / camera.fx, (camera.cx - camera.width_px) / camera.fx
    top, bottom = camera.cy / camera.fy, (camera.cy - camera.height_px) / camera.fy
    local = np.array([[0, 0, 0], [1, left, top], [1, right, top], [1, right, bottom], [1, left, bottom]]) * length_m
    return np.asarray(camera.offset_m, float) + rotate(np.asarray(camera.quat_wxyz, float), local)


def _averaged(fine: Image) -> Image:
    rows = fine[::_FINER].astype(np.uint16)
    for i in range(1, _FINER):
        rows += fine[i::_FINER]
    total = rows[:, ::_FINER].copy()
    for j in range(1, _FINER):
        total += rows[:, j::_FINER]
    return ((total + _FINER * _FINER // 2) // (_FINER * _FINER)).astype(np.uint8)
