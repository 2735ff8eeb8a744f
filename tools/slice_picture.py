"""The picture of a fan as a slice, docs/images/fan-slice.webp: a LiDAR in an office, and what tracing it looks at.

.venv/bin/python -m tools.films fan-slice
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle, Wedge

import flockstep
from flockstep.pictures.lines import beams_of
from flockstep.pictures.relief import Relief
from flockstep.pictures.third_person_view import ThirdPersonView

WORLD = "indoor/office"
PLACE, YAW_RAD = (30.35, 8.45, 1.05), 2.75  # m; of the drone, which hovers level
VIEW = ((33.4, 5.6, 2.5), (29.9, 8.8, 0.75))  # m; viewer and target of the picture beside the plan
LIDAR = flockstep.LidarConfig(beams=35, hfov_deg=270.0, max_range_m=3.0)
SHOWN_M = ((26.6, 4.3), (34.2, 11.5))  # corners of the plan
PX_PER_M = 100
VIEW_PX = (900, 1080)
WIDTH = 16  # children of a node, triangles of a leaf
CUT, BESIDE, OPENED, SKIPPED, BEAM, HIT, DRONE = (
    "#15181e", "#9aa0ab", "#2f6fc2", "#9097a3", "#f0883e", "#c8321e", "#23469f"
)  # fmt: skip
DASHES = (0, (3, 2))

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.intp]


@dataclass
class Box:
    """A box of the tree: of up to sixteen children, or of up to sixteen triangles."""

    low: Floats
    high: Floats
    triangles: Ints  # all that lie in it
    children: list[Box] = field(default_factory=list)


def build(low: Floats, high: Floats, triangles: Ints) -> Box:
    """Return a tree of triangles (rows of the corners low and high of their boxes), split as trees for rays are."""
    box = Box(low[triangles].min(axis=0), high[triangles].max(axis=0), triangles)
    if len(triangles) > WIDTH:
        parts = [triangles]
        while len(parts) < WIDTH and max(map(len, parts)) > WIDTH:
            parts.sort(key=lambda part: surface(low[part].min(axis=0), high[part].max(axis=0)) * (len(part) > WIDTH))
            parts += split(low, high, parts.pop())
        box.children = [build(low, high, part) for part in parts]
    return box


def surface(low: Floats, high: Floats) -> Floats:
    """Return half the surfaces of boxes."""
    size = high - low
    return np.asarray((size * np.roll(size, 1, axis=-1)).sum(axis=-1))


def split(low: Floats, high: Floats, triangles: Ints) -> tuple[Ints, Ints]:
    """Return the halves whose boxes, weighted by their leaves, have the least surface."""
    best: tuple[float, Ints, int] | None = None
    for axis in range(3):
        order = triangles[np.argsort(low[triangles, axis] + high[triangles, axis], kind="stable")]
        lows, highs = low[order], high[order]
        first = surface(np.minimum.accumulate(lows), np.maximum.accumulate(highs))[:-1]
        last = surface(np.minimum.accumulate(lows[::-1]), np.maximum.accumulate(highs[::-1]))[-2::-1]
        count = np.arange(1, len(order))
        cost = first * -(-count // WIDTH) + last * -(-(len(order) - count) // WIDTH)
        at = int(cost.argmin())
        if best is None or cost[at] < best[0]:
            best = float(cost[at]), order, at + 1
    assert best is not None
    return best[1][: best[2]], best[1][best[2] :]


@dataclass
class Walk:
    """The boxes of a tree that a scan opens, and those that it skips."""

    nodes: list[Box] = field(default_factory=list)
    leaves: list[Box] = field(default_factory=list)
    skipped: list[Box] = field(default_factory=list)


def walk(box: Box, origin: Floats, edges: Floats, range_m: float) -> Walk:
    """Walk a tree as the tracer does, past boxes that the level plane, the range or the sector do not meet."""
    done, waiting = Walk(), [box]
    while waiting:
        here = waiting.pop()
        center, half = (here.low + here.high) / 2 - origin, (here.high - here.low) / 2
        meets = (
            np.linalg.norm(np.maximum(abs(center) - half, 0)) <= range_m
            and abs(center[2]) <= half[2]
            and (edges @ center + abs(edges) @ half >= 0).any()  # wider than a half turn: in front of one of them
        )
        if not meets:
            done.skipped.append(here)
        elif here.children:
            done.nodes.append(here)
            waiting += here.children
        else:
            done.leaves.append(here)
    return done


def cuts(corners: Floats, height: float) -> Floats:
    """Return the segments (S, 2, 2) in which a level plane cuts triangles (T, 3, 3)."""
    above = corners[..., 2] > height
    crossing = above.any(axis=1) & ~above.all(axis=1)
    corners, above = corners[crossing], above[crossing]
    lone = (above == (above.sum(axis=1) == 1)[:, None]).argmax(axis=1)  # the corner alone on its side
    at, others = np.arange(len(lone))[:, None], (lone[:, None] + [1, 2]) % 3
    a, b = corners[at, lone[:, None]], corners[at, others]
    share = (height - a[..., 2:]) / (b[..., 2:] - a[..., 2:])
    return np.asarray((a + share * (b - a))[..., :2])


@dataclass
class Slice:
    """A scan of the LiDAR, and what it computes."""

    batch: flockstep.Batch
    num_triangles: int
    walk: Walk
    cut: Floats  # (S, 2, 2) segments, from the leaves of the walk
    all_cut: Floats  # the same from all triangles
    turns: Floats  # rad; where the fan begins and ends

    @classmethod
    def scan(cls) -> Slice:
        """Scan at the place of the picture."""
        world = flockstep.World.load(WORLD)
        batch = flockstep.Batch([world], lidar=LIDAR)
        batch.set_pose([PLACE], [[np.cos(YAW_RAD / 2), 0, 0, np.sin(YAW_RAD / 2)]])
        batch.sense()
        mesh = world.mesh()
        meshes = mesh["objects"] >= len(world.primitives)  # primitives are traced without the tree
        corners = mesh["vertices"][mesh["triangles"][meshes]].astype(float)
        turns = YAW_RAD + np.deg2rad(LIDAR.hfov_deg) / 2 * np.array([-1, 1])
        edges = np.array([[-np.sin(turns[0]), np.cos(turns[0]), 0], [np.sin(turns[1]), -np.cos(turns[1]), 0]])
        tree = build(corners.min(axis=1), corners.max(axis=1), np.arange(len(corners)))
        done = walk(tree, np.array(PLACE), edges, LIDAR.max_range_m)
        listed = np.concatenate([leaf.triangles for leaf in done.leaves])
        return cls(batch, len(corners), done, cuts(corners[listed], PLACE[2]), cuts(corners, PLACE[2]), turns)


def draw(path: Path, scan: Slice) -> None:
    """Write the picture: the fan in the world, and its slice from above."""
    figure = plt.figure(figsize=(14, 8.5), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.27))
    viewer, target = np.array(VIEW)
    left.imshow(ThirdPersonView(scan.batch, size_px=VIEW_PX, place=(viewer, target), markers=()).frame(0))
    left.axis("off")
    left.set_title(f"a fan of {LIDAR.beams} beams among {scan.num_triangles:,} triangles", fontsize=15, pad=10)
    draw_plan(right, scan)
    opened = len(scan.walk.nodes) + len(scan.walk.leaves)
    right.set_title(f"its slice: {opened} boxes opened, {len(scan.cut)} triangles cut", fontsize=15, pad=10)
    figure.legend(handles=legend(), loc="outside lower center", ncols=3, frameon=False, fontsize=13, columnspacing=4.0)
    figure.savefig(path, dpi=110, pil_kwargs={"quality": 85}, bbox_inches="tight", pad_inches=0.12)
    plt.close(figure)


def draw_plan(axes: Axes, scan: Slice) -> None:
    """Draw the slice from above, over the world below it."""
    origin, ends, hit = beams_of(scan.batch, 0)
    low, high = np.array(SHOWN_M)
    size_px = (round((high - low)[0] * PX_PER_M), round((high - low)[1] * PX_PER_M))
    below = Relief(scan.batch.world_of(0), "top", low, high, size_px).picture(origin[2]).astype(float)
    axes.imshow((255 - 0.6 * (255 - below)).astype(np.uint8), extent=(low[0], high[0], low[1], high[1]))
    for boxes, color, width, style in (
        (scan.walk.skipped, SKIPPED, 0.8, DASHES),
        (scan.walk.leaves, OPENED, 1.5, "-"),
    ):
        for box in boxes:
            (x, y, _), (x_size, y_size, _) = box.low.tolist(), (box.high - box.low).tolist()
            axes.add_patch(Rectangle((x, y), x_size, y_size, fill=False, ec=color, lw=width, ls=style))
    begin, end = np.rad2deg(scan.turns)
    axes.add_patch(Wedge((PLACE[0], PLACE[1]), LIDAR.max_range_m, begin, end, fill=False, ec=BEAM, lw=1.2, ls=":"))
    for segments, color, width in (
        (scan.all_cut, BESIDE, 0.8),
        (np.stack([np.broadcast_to(origin, ends.shape), ends], axis=1)[..., :2], BEAM, 1.0),
        (scan.cut, CUT, 2.2),
    ):
        axes.add_collection(LineCollection(list(segments), colors=color, linewidths=width, zorder=3))
    axes.plot(*ends[hit, :2].T, "o", color=HIT, markersize=5, zorder=4)
    axes.plot(*origin[:2], "o", color=DRONE, markersize=11, zorder=4)
    axes.plot(high[0] - np.array([1.3, 0.3]), low[1] + np.array([0.25, 0.25]), color=CUT, linewidth=3)
    axes.text(high[0] - 0.8, low[1] + 0.32, "1 m", ha="center", va="bottom", fontsize=12)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xticks=[], yticks=[])


def legend() -> list[Line2D]:
    """Return the meaning of the lines."""
    return [
        Line2D([], [], color=BEAM, marker="o", markerfacecolor=HIT, markeredgecolor=HIT, label="beam, hit"),
        Line2D([], [], color=BEAM, linestyle=":", label="range and sector"),
        Line2D([], [], color=OPENED, linewidth=1.5, label="opened leaf of the tree"),
        Line2D([], [], color=SKIPPED, linestyle=DASHES, label="skipped box"),
        Line2D([], [], color=CUT, linewidth=2.2, label="triangle cut by the plane"),
        Line2D([], [], color=BESIDE, linewidth=0.8, label="other triangles in the plane: never cut"),
    ]
