"""Pictures of a drone from behind and above it, or from a fixed place, with beams, camera frustums and trail."""

from __future__ import annotations

from collections.abc import Sequence
from math import isqrt

import numpy as np

from flockstep._core import Batch, CameraConfig, World
from flockstep.drone_mesh import DroneMesh
from flockstep.pictures.body import Body
from flockstep.pictures.depth_canvas import DepthCanvas, Floats, Image, Ints
from flockstep.pictures.drawing import Drawing, Overlay, line_px
from flockstep.pictures.lines import Trail, beams_of, draw_beams, draw_move_lines, drones_of_env, with_beams
from flockstep.pictures.posed_bodies import posed_bodies
from flockstep.pictures.stage import Stage
from flockstep.pictures.style import STYLES
from flockstep.rotations import rotate
from flockstep.task import MARKERS

_FRUSTUM_LENGTH = 1.1  # length of the drawn camera frustums, in drone lengths
_MAX_BEAMS = 256  # more would hide the world
SAMPLES = 4  # per pixel, for smooth edges
_MOST_BODIES = 4096  # of a picture
_SAME = 0.01  # distance at which two drones are in the same place, in drone lengths
_WORLDS = 64  # maximum number of cached worlds
_FOLLOWED, _LAG = 12, 0.5  # steps whose mean position the viewer follows; maximum lag in drone lengths
_MEAN, _OFF = 4, 0.25  # steps before and after that smooth a trail; maximum distance to it in drone lengths
_EDGE = (75, 115, 225)  # of hulls
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
        Draw the LiDAR's beams even if `Batch.set_beams_visible` does not show them. A beam without a hit is as long as
        the LiDAR's range.
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
    samples
        Samples per pixel: 1, 4, 9 or 16.
    style
        A name of `STYLES`.
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
        samples: int = SAMPLES,
        style: str = "bright",
    ) -> None:
        self._batch = batch
        self._cameras = [batch.camera(name) for name in cameras]
        self._trail = trail
        self._beams = beams
        self._others = others
        self._style = STYLES[style]
        self._body = Body(batch.drone, mesh, style)
        self._length = float(np.ptp(self._body.corners, axis=0).max())
        self._size_px = size_px or (640, 480)
        self._samples = samples
        self._line_px = isqrt(samples) * line_px(self._size_px[0])
        self._place = place
        self._markers = tuple(markers)
        self._overlay = overlay
        self._stage: Stage | None = None  # of the last picture
        self._stages: dict[World, Stage] = {}  # by the world that `Batch.world_of` returns, in its light

    def frame(self, env: int) -> Image:
        """Return the picture of one env, (height, width, 3) uint8, a new array."""
        world = self._batch.world_of(env)
        if world not in self._stages:
            if len(self._stages) >= _WORLDS:
                self._stages.clear()
            styled = self._style.applied_to(world)
            self._stages[world] = Stage(
                styled, self._length, self._size_px, self._samples, self._markers, light=self._style.camera
            )
        if self._stage is not (stage := self._stages[world]):
            if self._stage is not None:
                self._stage.forget()
            self._stage = stage
        position = np.asarray(self._batch.position[env], float)
        quat_wxyz = np.asarray(self._batch.quat_wxyz[env], float)
        others = self._others_of(env)
        bodies = posed_bodies(self._batch, env // self._batch.drones_per_env)
        drones = [*others[: _MOST_BODIES - 1 - len(bodies)], *([env] if self._batch.active[env] else [])]
        poses = [(self._batch.position[drone], self._batch.quat_wxyz[drone]) for drone in drones]
        bodies += [self._body.at(*pose, pale=drone != env) for drone, pose in zip(drones, poses, strict=True)]
        faded = None
        if self._place is None:
            canvas, faded = stage.set(position, quat_wxyz, self._anchor(env, position), bodies)
        else:
            canvas = stage.seen_from(*self._place, bodies)
        for at, turn in poses if len(self._body.edges) else ():
            starts, ends = (np.asarray(at, float) + rotate(turn, self._body.edges[:, end]) for end in (0, 1))
            canvas.lines(starts, ends, _EDGE, width_px=self._line_px)
        if self._batch.active[env]:
            self._draw_trail(canvas, env)
            draw_move_lines(canvas, self._batch, drones_of_env(self._batch, env), 2 * self._line_px)
            self._draw_cameras(canvas, env, position, quat_wxyz)
            if self._overlay is not None:
                self._overlay.draw(self._batch, env, Drawing(canvas, self._line_px))
            for drone in with_beams(self._batch, env, self._beams, map(int, others)):
                self._draw_beams(canvas, drone)  # last, because they are transparent
        of_other_envs = [int(other) for other in others if other not in drones_of_env(self._batch, env)]
        draw_move_lines(canvas, self._batch, of_other_envs, 2 * self._line_px)
        if faded is not None:
            faded.draw(canvas)
        return canvas.rgb

    def _others_of(self, env: int) -> Ints:
        """Return the other drones of the same world to draw, the nearest first, without those within the drone."""
        if not self._others:
            return np.zeros(0, int)
        world_index = np.repeat(self._batch.world_index, self._batch.drones_per_env)
        others = np.flatnonzero(self._batch.active & (world_index == world_index[env]))
        others = others[others != env]
        apart = np.linalg.norm(self._batch.position[others] - self._batch.position[env], axis=1)
        if self._batch.active[env]:
            others, apart = others[apart > _SAME * self._length], apart[apart > _SAME * self._length]
        nearest: Ints = others[np.argsort(apart, kind="stable")]
        return nearest

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
        canvas.lines(path[:-1], path[1:], self._style.trail, width_px=2 * self._line_px)

    def _draw_cameras(self, canvas: DepthCanvas, env: int, position: Floats, quat_wxyz: Floats) -> None:
        for camera in self._cameras:
            apex, *corners = position + rotate(
                quat_wxyz, frustum(camera.config_of(env), _FRUSTUM_LENGTH * self._length)
            )
            for corner, following in zip(corners, corners[1:] + corners[:1], strict=True):
                sides = np.array([apex, corner]), np.array([corner, following])
                canvas.lines(*sides, self._style.frustum, width_px=self._line_px)

    def _draw_beams(self, canvas: DepthCanvas, drone: int) -> None:
        origin, ends, hit = beams_of(self._batch, drone)
        some = np.arange(0, len(ends), max(-(-len(ends) // _MAX_BEAMS), 1))
        draw_beams(canvas, self._style, origin, ends[some], hit[some], self._line_px)
        canvas.dots(ends[hit], self._style.hit, size_px=3 * self._line_px)


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
