"""Scenes with a drone: seen from behind and above with nearer obstacles and markers faded, or from a fixed place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep._core import BodyConfig, CameraConfig, World
from flockstep.pictures.depth_canvas import DepthCanvas, Floats, Image, Ints
from flockstep.pictures.picture import FARTHEST_M, facing, render
from flockstep.rotations import rotate

# In drone lengths:
_BACK = np.array([-3.4, 1.4, 0.0])  # position of the viewer: behind the drone and to its left,
_UP = np.array([0.0, 0.0, 2.3])  # and above it
_FREE = 0.3  # minimum distance from a wall
_AHEAD = 0.5  # distance of the point to look at, ahead of the drone

_HFOV_DEG = 75.0
_NEAR_M = 0.05
_NUMBERED = 1 << 15  # more primitives than this are not faded: cameras may have no instance numbers for them
_DISSOLVED = 0.3  # final opacity of an obstacle or a marker nearer than the drone
_MARKERS = 65533  # least semantic id of a marker
_FADE = 0.5  # distance in front of the drone, in drone lengths, at which that opacity is reached


@dataclass
class Obstacles:
    """Obstacles and markers to fade, pixel by pixel."""

    at: Ints  # (K,) indices of the frame's pixels
    rgb: Image  # (K, 3)
    depth: npt.NDArray[np.float32]  # (K,) m
    opacity: npt.NDArray[np.float32]  # (K,)

    def draw(self, canvas: DepthCanvas) -> None:
        """Draw the obstacles over the surfaces behind them."""
        rgb = canvas.rgb.reshape(-1, 3)
        opacity = np.where(canvas.depth.reshape(-1)[self.at] < self.depth, np.float32(0), self.opacity)
        behind = rgb[self.at].astype(np.float32)
        rgb[self.at] = behind + opacity[:, None] * (self.rgb - behind) + np.float32(0.5)


class Stage:
    """Takes pictures of one world.

    Parameters
    ----------
    length
        Length of the drone in m; the viewer keeps a few lengths of distance.
    size_px
        Width and height of the pictures.
    """

    def __init__(self, world: World, length: float, size_px: tuple[int, int]) -> None:
        self.world = world
        self._length = length
        self._size_px = size_px
        primitives = world.primitives
        self._solid = np.array([primitive["kind"] != "room" for primitive in primitives], bool)
        self._top = np.array([top_of(primitive) for primitive in primitives])
        # Indexed by instance. Meshes are not faded, because the floor may be one.
        self._dissolves = np.zeros(1 << 16, bool)
        self._outputs = ["rgb", "depth", "semantic"]
        if len(primitives) <= _NUMBERED:
            self._dissolves[1 : 1 + len(primitives)] = self._solid
            self._outputs += ["instance"]
        self._bodies: Sequence[BodyConfig] = ()
        self._bare = world.with_markers()
        self._emptied = _emptied(world)

    def show_bodies(self, bodies: Sequence[BodyConfig]) -> None:
        """Set the bodies of the next canvases."""
        self._bodies = bodies

    def seen_from(self, viewer: Floats, target: Floats) -> DepthCanvas:
        """Return a canvas of the world seen from a position (3,) m towards another."""
        turn = facing(viewer, target).astype(float)
        picture = self._take(self.world, viewer, turn, "rgb", "depth")
        return DepthCanvas(picture["rgb"], picture["depth"], self._camera(), viewer, turn, self.world.light)

    def set(self, position: Floats, quat_wxyz: Floats, anchor: Floats | None = None) -> tuple[DepthCanvas, Obstacles]:
        """Return a canvas on which to draw a drone at a pose, and the obstacles, which are to be drawn last.

        The viewer keeps its distance from the anchor (3,) m near the drone; by default from the drone itself.
        """
        anchor = position if anchor is None else anchor
        viewer, turn = _viewpoint(self.world, self._solid, position, quat_wxyz, self._length, anchor)
        picture = self._take(self.world, viewer, turn, *self._outputs)
        rgb, depth = picture["rgb"].reshape(-1, 3), picture["depth"].reshape(-1)
        canvas = DepthCanvas(picture["rgb"], picture["depth"], self._camera(), viewer, turn, self.world.light)

        cut = max(float(rotate(turn, position - viewer, inverse=True)[0]), 2 * _NEAR_M)
        dissolves = self._dissolving(picture, position)
        at = np.flatnonzero(dissolves & (depth < cut))
        if len(at):  # the background: everything beyond the drone, plus nearer walls
            behind = self._take(self.world, viewer, turn, "rgb", "depth", near_m=cut)
            behind_rgb, behind_depth = behind["rgb"].reshape(-1, 3)[at], behind["depth"].reshape(-1)[at]
            kept = [] if self._emptied is None else [(self._take(self._emptied, viewer, turn, "rgb", "depth"), at >= 0)]
            is_marker = picture["semantic"].reshape(-1)[at] >= _MARKERS
            if is_marker.any():  # behind a marker also nearer surfaces that do not fade
                bare = self._take(self._bare, viewer, turn, *self._outputs)
                kept.append((bare, is_marker & ~self._dissolving(bare, position)[at]))
            for surfaces, where in kept:
                surface_depth = surfaces["depth"].reshape(-1)[at]
                nearer = where & (surface_depth < behind_depth)
                behind_rgb[nearer] = surfaces["rgb"].reshape(-1, 3)[at[nearer]]
                behind_depth = np.where(nearer, surface_depth, behind_depth)
            opacity = np.maximum(1 - (cut - depth[at]) / (self._length * _FADE) * (1 - _DISSOLVED), _DISSOLVED)
            obstacles = Obstacles(at, rgb[at], depth[at], opacity.astype(np.float32))
            rgb[at], depth[at] = behind_rgb, behind_depth
        else:
            obstacles = Obstacles(at, rgb[at], depth[at], np.zeros(0, np.float32))
        return canvas, obstacles

    def _dissolving(self, picture: dict[str, npt.NDArray[Any]], position: Floats) -> npt.NDArray[np.bool_]:
        """Return which pixels (H * W,) show a marker or an obstacle that fades if it is nearer than the drone."""
        dissolving: npt.NDArray[np.bool_] = picture["semantic"].reshape(-1) >= _MARKERS
        if "instance" in picture:
            # Primitives below the drone do not hide it from a viewer above: the ground stays whole.
            dissolves = self._dissolves.copy()
            dissolves[1 : 1 + len(self._top)] &= self._top > position[2]
            dissolving |= dissolves[picture["instance"].reshape(-1)]
        return dissolving

    def _camera(self, near_m: float = _NEAR_M, outputs: tuple[str, ...] = ("rgb",)) -> CameraConfig:
        width, height = self._size_px
        return CameraConfig(
            width_px=width,
            height_px=height,
            hfov_deg=_HFOV_DEG,
            near_m=near_m,
            far_m=FARTHEST_M,
            outputs=outputs,
            shadows=True,
        )

    def _take(
        self, world: World, viewer: Floats, turn: Floats, *outputs: str, near_m: float = _NEAR_M
    ) -> dict[str, npt.NDArray[Any]]:
        bodies = () if world is self._emptied else self._bodies
        return render(world, viewer, turn, camera=self._camera(near_m, outputs), bodies=bodies)


def with_markers(world: World, markers: Sequence[str]) -> World:
    """Return a world with only these of its markers; the same object if it has no others."""
    found = {"start": world.start is not None, "waypoints": len(world.waypoints) > 0, "goal": world.goal is not None}
    dropped = [name for name in found if found[name] and name not in markers]
    if not dropped:
        return world
    scene = world.to_dict()
    scene["markers"] = {name: value for name, value in scene["markers"].items() if name not in dropped}
    return World.from_dict(scene)


def top_of(primitive: dict[str, Any]) -> float:
    """Return the highest point of the box around a primitive, in metres."""
    half = np.asarray(primitive["half_extents"], float)
    axes = [rotate(np.asarray(primitive["quat_wxyz"], float), axis) for axis in np.eye(3)]
    return float(primitive["center"][2] + sum(abs(axis[2]) * size for axis, size in zip(axes, half, strict=True)))


def _emptied(world: World) -> World | None:
    """Return the empty room, or None if there is no room."""
    rooms = [primitive for primitive in world.primitives if primitive["kind"] == "room"]
    if not rooms:
        return None
    center, half = np.asarray(rooms[0]["center"], float), np.asarray(rooms[0]["half_extents"], float)
    return World.from_dict(
        {
            "flockstep_scene": 1,
            "name": world.name,
            "materials": {m["name"]: {k: m[k] for k in ("base_color", "emissive")} for m in world.materials},
            "room": {
                "min": (center - half).tolist(),
                "max": (center + half).tolist(),
                "material": rooms[0]["material"],
            },
            "light": world.light,
        }
    )


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
