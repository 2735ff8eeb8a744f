"""Scenes with a drone: seen from behind and above with nearer obstacles and markers faded, or from a fixed place."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, BodyConfig, Camera, CameraConfig, World
from flockstep.pictures.body import DRONE
from flockstep.pictures.depth_canvas import Color, DepthCanvas, Floats, Image, Ints, blended
from flockstep.pictures.drawing import line_px
from flockstep.pictures.picture import FARTHEST_M, facing, take, take_by, without_bodies
from flockstep.rotations import rotate
from flockstep.task import MARKERS

# In drone lengths:
_BACK = np.array([-3.4, 1.4, 0.0])  # position of the viewer: behind the drone and to its left,
_UP = np.array([0.0, 0.0, 2.3])  # and above it
_FREE = 0.3  # minimum distance from a wall
_AHEAD = 0.5  # distance of the point to look at, ahead of the drone

_NEAR_M = 0.05
_OUTPUTS = ("rgb", "depth")
_NUMBERED = 1 << 15  # more primitives than this are not faded: cameras may have no instance numbers for them
_DISSOLVED = 0.3  # final opacity of an obstacle or a marker nearer than the drone
#: Colours of markers, as cameras render them.
_MARKER_COLORS: dict[str, Color] = {"start": (230, 52, 43), "waypoints": (237, 202, 43), "goal": (43, 202, 65)}
#: Keys of primitives in scene files.
_SHAPES = ("pillars", "cylinders", "boxes", "spheres", "capsules", "planes", "discs", "gates")
_FADE = 0.5  # distance in front of the drone, in drone lengths, at which that opacity is reached
_SPAWNED = 32  # for more bodies each picture has a batch of its own
_FIRST_BODY = 61440  # instance number of a picture's first body
_DARK = 110  # maximum brightness of dark surfaces, before which drones have a rim of light
_RIM, _RIM_OPACITY = np.array([205, 225, 255]), np.array(0.6)


@dataclass
class Faded:
    """Obstacles, pixel by pixel, and markers that are nearer than the drone, to draw last."""

    at: Ints  # (K,) indices of the picture's pixels
    rgb: Image  # (K, 3)
    depth: npt.NDArray[np.float32]  # (K,) m
    markers: list[tuple[Floats, Color]]  # (3,) m
    marker_m: float  # radius of markers
    opacity: Callable[[Floats], Floats]  # of depths

    def draw(self, canvas: DepthCanvas) -> None:
        """Draw them over the surfaces behind them."""
        for place, color in self.markers:
            canvas.sphere(place, self.marker_m, color, self.opacity)
        rgb = canvas.rgb.reshape(-1, 3)
        opacity = np.where(canvas.depth.reshape(-1)[self.at] < self.depth, 0, self.opacity(self.depth))
        behind = rgb[self.at].astype(np.float32)
        rgb[self.at] = behind + opacity[:, None].astype(np.float32) * (self.rgb - behind) + np.float32(0.5)


class Stage:
    """Takes pictures of one world with drones and other bodies in it.

    Parameters
    ----------
    length
        Length of the drone in m; the viewer keeps a few lengths of distance.
    size_px
        Width and height of the pictures.
    samples
        Samples per pixel: 1, 4, 9 or 16.
    markers
        The markers of the world to show.
    hfov_deg
        Horizontal field of view.
    light
        Fields of the `CameraConfig` of pictures with shadows.
    """

    def __init__(
        self,
        world: World,
        length: float,
        size_px: tuple[int, int],
        samples: int = 1,
        markers: Sequence[str] = MARKERS,
        hfov_deg: float = 75.0,
        light: Mapping[str, Any] = {},
    ) -> None:
        world = without_bodies(world)  # pictures show those of the env
        self._length = length
        self._size_px = size_px
        self._samples = samples
        self._hfov_deg = hfov_deg
        self._light = light
        places = {
            "start": [] if world.start is None else [world.start],
            "waypoints": list(world.waypoints),
            "goal": [] if world.goal is None else [world.goal],
        }
        self._markers = [
            (name, np.asarray(place, float)) for name in MARKERS if name in markers for place in places[name]
        ]
        self._batches: dict[tuple[World, bool], Batch] = {}  # by the world, and if fast
        self._shown: dict[tuple[int, ...], World] = {}  # the world by the markers that are shown
        if len(self._markers) == sum(map(len, places.values())):
            self._shown[tuple(range(len(self._markers)))] = world
        self.world = world
        primitives = world.primitives
        self._solid = np.array([primitive["kind"] != "room" for primitive in primitives], bool)
        self._top = np.array([top_of(primitive) for primitive in primitives])
        # Indexed by instance. Meshes are not faded, because the floor may be one.
        self._dissolves = np.zeros(1 << 16, bool)
        self._outputs: Sequence[str] = _OUTPUTS
        if len(primitives) <= _NUMBERED:
            self._dissolves[1 : 1 + len(primitives)] = self._solid
            self._outputs = (*_OUTPUTS, "instance")

    def _with_markers(self, shown: Sequence[int]) -> World:
        """Return the world with some of its markers, of these numbers."""
        if tuple(shown) not in self._shown:
            places: dict[str, list[Floats]] = {name: [] for name in MARKERS}
            for index in shown:
                name, place = self._markers[index]
                places[name].append(place)
            one = {name: places[name][0] for name in ("start", "goal") if places[name]}
            self._shown[tuple(shown)] = self.world.with_markers(waypoints=places["waypoints"] or None, **one)
        return self._shown[tuple(shown)]

    @cached_property
    def _lasting(self) -> World:
        """The world without markers and what may fade."""
        scene = self.world.to_dict()
        for kind in (*_SHAPES, "markers", "bodies"):
            scene.pop(kind, None)
        if not scene.keys() & {"room", "meshes"}:  # a world cannot be empty
            scene["boxes"] = [{"center": [0, 0, 0], "size": [0.001] * 3, "visibility": "solid"}]
        return World.from_dict(scene)

    def seen_from(self, viewer: Floats, target: Floats, bodies: Sequence[BodyConfig] = ()) -> DepthCanvas:
        """Return a canvas of the world seen from a position (3,) m towards another."""
        turn = facing(viewer, target).astype(float)
        world = self._with_markers(range(len(self._markers)))
        return self._canvas(self._taken(world, viewer, turn, bodies), viewer, turn, bodies)

    def set(
        self,
        position: Floats,
        quat_wxyz: Floats,
        anchor: Floats | None = None,
        bodies: Sequence[BodyConfig] = (),
    ) -> tuple[DepthCanvas, Faded]:
        """Return a canvas for a drone at a pose, and what is nearer than it, which is to be drawn last.

        The viewer keeps its distance from the anchor (3,) m near the drone; by default from the drone itself. The drone
        is one of the bodies.
        """
        anchor = position if anchor is None else anchor
        viewer, turn = _viewpoint(self.world, self._solid, position, quat_wxyz, self._length, anchor)
        ahead = rotate(turn, np.array([1.0, 0.0, 0.0]))
        cut = max(float(ahead @ (position - viewer)), 2 * _NEAR_M)

        def opacity(depth: Floats) -> Floats:
            faded: Floats = np.clip(1 - (cut - depth) / (self._length * _FADE) * (1 - _DISSOLVED), _DISSOLVED, 1)
            return faded

        radius = self.world.marker_radius_m
        is_near = [-radius < ahead @ (place - viewer) < cut + radius for _, place in self._markers]
        world = self._with_markers([index for index, hides in enumerate(is_near) if not hides])
        picture = self._taken(world, viewer, turn, bodies)
        canvas = self._canvas(picture, viewer, turn, bodies)
        rgb, depth = canvas.rgb.reshape(-1, 3), canvas.depth.reshape(-1)
        at = np.flatnonzero(depth < cut)
        at = at[self._dissolving(picture, at, position)]
        markers = [
            (place, _MARKER_COLORS[name]) for (name, place), hides in zip(self._markers, is_near, strict=True) if hides
        ]
        faded = Faded(at, rgb[at], depth[at], markers, radius, opacity)
        if len(at):  # show what is behind: everything beyond the drone, and what does not fade, such as the drone
            beyond = take(world, viewer, turn, self._camera(near_m=cut, fast=True), bodies)
            lasting = self._taken(self._lasting, viewer, turn, bodies, fast=True)
            is_beyond = beyond.depth.reshape(-1)[at] < lasting.depth.reshape(-1)[at]
            for picture, where in ((beyond, at[is_beyond]), (lasting, at[~is_beyond])):
                depth[where] = picture.depth.reshape(-1)[where]
                rgb[where] = picture.rgb.reshape(-1, 3)[where]
        return canvas, faded

    def _taken(
        self, world: World, viewer: Floats, turn: Floats, bodies: Sequence[BodyConfig], *, fast: bool = False
    ) -> Camera:
        """Take a picture by a batch that is kept for the next one: its memory takes longer to get than a picture."""
        camera = self._camera(_OUTPUTS if fast else self._outputs, fast=fast)
        if len(bodies) > _SPAWNED:
            return take(world, viewer, turn, camera, bodies)
        if (world, fast) not in self._batches:
            if len(self._batches) > 1:
                self.forget()
            self._batches[world, fast] = Batch(world, cameras=[camera], max_bodies=_SPAWNED)
        batch = self._batches[world, fast]
        batch.bodies.remove()
        for body in bodies:  # a configuration without its pose is the same one in each picture, and known to the batch
            unplaced = copy.copy(body)
            unplaced.position_m, unplaced.quat_wxyz = (0, 0, 0), (1, 0, 0, 0)
            batch.bodies.spawn(unplaced, [body.position_m], [body.quat_wxyz])
        return take_by(batch, viewer, turn)

    def forget(self) -> None:
        """Free the memory that is kept for the next picture."""
        self._batches.clear()

    def _dissolving(self, picture: Camera, at: Ints, position: Floats) -> npt.NDArray[np.bool_]:
        """Return which of some pixels (K,) show an obstacle that fades if it is nearer than the drone."""
        if "instance" not in self._outputs:
            return np.zeros(len(at), bool)
        # Primitives below the drone do not hide it from a viewer above: the ground stays whole.
        dissolves = self._dissolves.copy()
        dissolves[1 : 1 + len(self._top)] &= self._top > position[2]
        dissolving: npt.NDArray[np.bool_] = dissolves[picture.instance.reshape(-1)[at]]
        return dissolving

    def _camera(
        self, outputs: Sequence[str] = _OUTPUTS, *, near_m: float = _NEAR_M, fast: bool = False
    ) -> CameraConfig:
        width, height = self._size_px
        return CameraConfig(
            width_px=width,
            height_px=height,
            hfov_deg=self._hfov_deg,
            near_m=near_m,
            far_m=FARTHEST_M,
            outputs=outputs,
            samples_per_pixel=1 if fast else self._samples,
            adaptive_samples=True,
            shadows=not fast,
            **({} if fast else self._light),
        )

    def _canvas(self, picture: Camera, viewer: Floats, turn: Floats, bodies: Sequence[BodyConfig]) -> DepthCanvas:
        rgb, depth = picture.rgb[0].copy(), picture.depth[0].copy()
        others = sum(body.name != DRONE for body in bodies)  # drones come last
        if "instance" in self._outputs:
            light_rims(rgb, picture.instance[0] >= _FIRST_BODY + others)
        return DepthCanvas(rgb, depth, self._camera(), viewer, turn, self.world.light, isqrt(self._samples))


def light_rims(rgb: Image, is_drone: npt.NDArray[np.bool_]) -> None:
    """Lighten drones (H, W) in a picture (H, W, 3) along their edges to dark surfaces, so that they show in shade."""
    rows = np.flatnonzero(is_drone.any(axis=1))
    part = slice(max(rows[0] - 1, 0), rows[-1] + 2) if len(rows) else slice(0)
    inside = is_drone[part]
    red, green, blue = (rgb[part, :, color] for color in range(3))
    beside = ~inside & (np.maximum(np.maximum(red, green), blue) < _DARK)  # a maximum over the last axis takes longer
    for _ in range(line_px(rgb.shape[1])):
        wide = np.pad(beside, 1)
        beside |= wide[2:, 1:-1] | wide[:-2, 1:-1] | wide[1:-1, 2:] | wide[1:-1, :-2]
    rim = inside & beside
    rgb[part][rim] = blended(rgb[part][rim], _RIM, _RIM_OPACITY)


def top_of(primitive: dict[str, Any]) -> float:
    """Return the highest point of the box around a primitive, in metres."""
    half = np.asarray(primitive["half_extents"], float)
    axes = [rotate(np.asarray(primitive["quat_wxyz"], float), axis) for axis in np.eye(3)]
    return float(primitive["center"][2] + sum(abs(axis[2]) * size for axis, size in zip(axes, half, strict=True)))


def _viewpoint(
    world: World,
    solid: npt.NDArray[np.bool_],
    position: Floats,
    quat_wxyz: Floats,
    length: float,
    anchor: Floats,
) -> tuple[Floats, Floats]:
    """Return the viewer's position and orientation for looking at a drone."""
    forward = rotate(quat_wxyz, np.array([1.0, 0.0, 0.0]))
    heading = np.arctan2(forward[1], forward[0])  # level, independent of the drone's tilt
    level = np.array([np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2)])
    # First up to the ceiling, then back to the wall: near a wall the view comes from above.
    viewer = _pushed(world, solid, anchor, length * _UP, length * _FREE)
    viewer = _pushed(world, solid, viewer, length * rotate(level, _BACK), length * _FREE)
    viewer = _pushed(world, solid, position, viewer - position, 0.0)
    ahead = anchor + length * rotate(level, np.array([_AHEAD, 0.0, 0.0]))
    return viewer, facing(viewer, ahead).astype(float)


def _pushed(world: World, solid: npt.NDArray[np.bool_], origin: Floats, way: Floats, free: float) -> Floats:
    """Return the end of a motion from a point (3,) along a vector (3,) m that passes obstacles and stops at walls."""
    length = float(np.linalg.norm(way))
    if length == 0:
        return origin
    gone = 0.0
    for _ in range(2 * len(solid) + 1):
        hit = world.raycast((origin + gone * way / length)[None], way[None], length + free - gone)
        gone += float(hit["t_hit"][0])
        if not 0 <= hit["primitive"][0] < len(solid) or not solid[hit["primitive"][0]]:
            break
        gone += 1e-3  # into the obstacle, or out of it
        if gone >= length + free:
            break
    reach = min(length, max(gone - free, gone / 2))
    return origin + way / length * reach
