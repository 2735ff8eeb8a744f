"""The pictures of docs/images/gallery: bundled places in three views with a LiDAR point cloud, and strips of views.

.venv/bin/python -m tools.gallery --out docs/images/gallery
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import imageio.v3 as imageio
import matplotlib
import numpy as np
import numpy.typing as npt
import tyro
from tqdm import tqdm

import flockstep
from flockstep.pictures.picture import facing

#: Scenes by name; the first STRIP of them form a strip for the README.
SCENES = (
    "indoor/office",
    "outdoor/city",
    "indoor/warehouse",
    "outdoor/forest",
    "playground/train-3",
    "bench/complex",
)
STRIP = 4
SIZE_PX = (640, 360)
STRIP_PX = (320, 200)
#: Scene of the pictures in several lights.
LIT = "outdoor/city"
LIGHTS = 4
#: Scene of the picture with and without soft light, which shows its LOUNGE.
SOFTENED = "indoor/office"
SOFT: dict[str, Any] = {"sun_size_deg": 3.0, "ambient_occlusion_rays": 16}
HALF_PX = (560, 420)
#: Errors of the picture of sensors: of a colour camera, a depth camera and a LiDAR, which sees SEEN_PX.
COLORS = flockstep.ColorErrors(vignetting=1.0, shot_noise=0.04, read_noise=0.01)
LENS = (-0.25, 0.06, 0.0, 0.0)
MOTION: dict[str, Any] = {"rolling_shutter_s": 0.03, "exposure_s": 0.02, "blur_samples": 16}  # while it turns
DEPTHS = flockstep.CameraConfig.preset("d435").depth_errors
RANGES = flockstep.RangeErrors(noise_std_m=0.03, noise_per_m=0.01, dropout=0.1, divergence_mrad=3.0)
SEEN_PX = (400, 300)
HFOV_DEG = 80.0
#: A spinning LiDAR, which scans every SCAN_EVERY_M metres of the path.
LIDAR = flockstep.LidarConfig(channels=32, beams=720, hfov_deg=360.0, vfov_deg=60.0, max_range_m=25.0)
SCAN_EVERY_M = 0.7
EYES_M = 6.0  # maximum height above the surface below; higher views are used only if there are no others

Image = npt.NDArray[np.uint8]
Points = npt.NDArray[np.float32]
View: TypeAlias = tuple[Points, Points]  # viewer and target, m
LOUNGE: View = np.array([15, 7, 2.2], np.float32), np.array([18.9, 11.5, 1.0], np.float32)


def way_through(world: flockstep.World, step_m: float = 0.1) -> Points:
    """Return evenly spaced points (n, 3) along a path from start to goal; a straight line if no path is found."""
    goals = [*world.waypoints, world.goal]
    path = flockstep.plan(world, world.start, goals, cell_m=max(0.4, 0.012 * float(np.ptp(world.bounds, axis=0).max())))
    corners = np.array([world.start, *goals]) if path is None else path
    legs = [np.linspace(a, b, max(round(float(np.linalg.norm(b - a)) / step_m), 1) + 1) for a, b in pairwise(corners)]
    return np.concatenate([leg[1:] for leg in legs]).astype(np.float32)


def along(world: flockstep.World, way: Points, first: float, last: float) -> View:
    """Return the least blocked view ahead between two fractions of the path."""
    camera = flockstep.CameraConfig(width_px=64, height_px=36, hfov_deg=HFOV_DEG, outputs=("depth",))
    best: tuple[float, View] | None = None
    down = world.raycast(way, np.tile(np.float32([0, 0, -1]), (len(way), 1)), 1000.0)["t_hit"]
    places = (np.linspace(first, last, 24) * (len(way) - 61)).astype(int)
    low = places[down[places] < EYES_M]
    for here in low if len(low) else places:
        target = np.array([*way[here + 60][:2], way[here][2] - 0.3], np.float32)  # 6 m ahead
        depth = flockstep.render(world, way[here], look_at=target, camera=camera)["depth"]
        width = float(np.log(np.clip(depth, 0.3, 15)).mean())
        if best is None or width > best[0]:
            best = width, (way[here], target)
    assert best is not None
    return best[1]


def above(world: flockstep.World) -> View:
    """Return a view of the whole world."""
    low, high = world.bounds
    size = high - low
    middle = np.array([*(low + size / 2)[:2], low[2]], np.float32)
    reach = 0.42 * np.linalg.norm(size[:2])
    place = middle + np.array([-0.75 * reach, -0.95 * reach, 0.85 * reach + 0.2 * size[2]], np.float32)
    return place.astype(np.float32), middle


def picture(
    world: flockstep.World, position: Points, look_at: Points, size_px: tuple[int, int] = SIZE_PX, **fields: Any
) -> Image:
    """Return a camera image from there, with shadows of the sun. fields: of the camera, instead of the usual ones."""
    usual: dict[str, Any] = {"hfov_deg": HFOV_DEG, "samples_per_pixel": 4, "shadows": True, "far_m": 2000.0}
    camera = flockstep.CameraConfig(width_px=size_px[0], height_px=size_px[1], **usual | fields)
    seen: Image = flockstep.render(world, position, look_at=look_at, camera=camera)["rgb"]
    return seen


def cloud(world: flockstep.World, way: Points) -> Points:
    """Return the points (n, 3) m that the LiDAR hits along the path."""
    batch = flockstep.Batch([world], lidar=LIDAR)
    found = []
    for position in way[:: round(SCAN_EVERY_M / 0.1)]:
        batch.set_pose(position[None])
        batch.sense()
        points = batch.lidar().points.reshape(-1, 3)
        found.append(points[np.isfinite(points).all(axis=1)])
    return np.concatenate(found)


def drawn(points: Points, position: Points, look_at: Points, size_px: tuple[int, int] = SIZE_PX) -> Image:
    """Return an image of the points from there, coloured by height."""
    w, x, y, z = facing(position, look_at)
    forward = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    left = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
    up = np.cross(forward, left)
    offset = points - position
    depth = offset @ forward
    focal = size_px[0] / 2 / np.tan(np.radians(HFOV_DEG) / 2)
    seen = depth > 0.1
    depth, offset, height = depth[seen], offset[seen], points[seen, 2]
    columns = np.round(size_px[0] / 2 - focal * (offset @ left) / depth).astype(int)
    rows = np.round(size_px[1] / 2 - focal * (offset @ up) / depth).astype(int)
    low, high = np.percentile(height, (2, 98))
    shade = np.clip((height - low) / max(high - low, 1e-6), 0, 1)
    colors = matplotlib.colormaps["turbo"](0.05 + 0.9 * shade)[:, :3]
    image: Image = np.full((size_px[1], size_px[0], 3), 16, np.uint8)
    order = np.argsort(-depth)
    order = order[
        (rows[order] >= 0) & (rows[order] < size_px[1]) & (columns[order] >= 0) & (columns[order] < size_px[0])
    ]
    image[rows[order], columns[order]] = (255 * colors[order]).round().astype(np.uint8)
    return image


def sensed(world: flockstep.World, *, errs: bool) -> Image:
    """Return what a camera, a depth camera and a LiDAR in the lounge measure."""
    size: dict[str, Any] = {"width_px": SEEN_PX[0], "height_px": SEEN_PX[1], "hfov_deg": HFOV_DEG}
    bent: dict[str, Any] = {"color_errors": COLORS, "distortion": LENS, **MOTION} if errs else {}
    camera = flockstep.CameraConfig(**size, samples_per_pixel=4, shadows=True, far_m=50.0, **bent)
    deep = flockstep.CameraConfig(**size, outputs=("depth",), far_m=10.0, **{"depth_errors": DEPTHS} if errs else {})
    lidar = flockstep.LidarConfig(channels=64, beams=720, hfov_deg=180.0, vfov_deg=70.0, max_range_m=12.0)
    if errs:
        lidar.errors = RANGES
    depth = flockstep.render(world, LOUNGE[0], look_at=LOUNGE[1], camera=deep)["depth"]
    near = np.where((depth > 0) & np.isfinite(depth), 1 / np.maximum(depth, 0.5), 0)
    shades = 255 * matplotlib.colormaps["turbo"](near)[..., :3] * (near > 0)[..., None]
    batch = flockstep.Batch([world], lidar=lidar, cameras=[camera])
    batch.set_pose(LOUNGE[0][None], facing(LOUNGE[0], LOUNGE[1] + np.float32([0.8, -0.6, 0]))[None])
    batch.sense()
    batch.move(LOUNGE[0][None], facing(*LOUNGE)[None])
    batch.sense()
    points = batch.lidar().points.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    seen = batch.camera().rgb[0]
    above_it = LOUNGE[0] + np.float32([-1.5, -1.5, 3.0])
    return np.concatenate([seen, shades.astype(np.uint8), drawn(points, above_it, LOUNGE[1], SEEN_PX)], axis=1)


def sheet(world: flockstep.World, indoor: bool) -> Image:
    """Return three views and the point cloud, two by two. Indoors the roof is left out."""
    way = way_through(world)
    third = along(world, way, 0.7, 1.0) if indoor else above(world)
    points = cloud(world, way)
    if indoor:
        points = points[points[:, 2] < way[:, 2].max() + 0.5]
    panes = [picture(world, *along(world, way, 0.0, 0.3)), picture(world, *along(world, way, 0.35, 0.65))]
    panes += [picture(world, *third), drawn(points, *above(world))]
    gap = 4
    image = np.full((2 * SIZE_PX[1] + gap, 2 * SIZE_PX[0] + gap, 3), 255, np.uint8)
    for i, pane in enumerate(panes):
        row, column = (i // 2) * (SIZE_PX[1] + gap), (i % 2) * (SIZE_PX[0] + gap)
        image[row : row + SIZE_PX[1], column : column + SIZE_PX[0]] = pane
    return image


@dataclass
class Args:
    """Draw the gallery: a sheet of each scene, and strips: some scenes, a city in several lights, soft light."""

    out: Path = Path("out/gallery")
    """Folder for the pictures."""
    scenes: tuple[str, ...] = SCENES
    """Scenes to draw."""


def main(args: Args) -> None:
    """Draw, and print the location."""
    args.out.mkdir(parents=True, exist_ok=True)
    strip = []
    for name in tqdm(args.scenes, unit="scene"):
        world = flockstep.World.load(name)
        indoor = name.startswith(("indoor", "playground"))
        imageio.imwrite(args.out / f"{name.replace('/', '-')}.jpg", sheet(world, indoor), quality=82)
        if name in SCENES[:STRIP]:
            strip.append(picture(world, *along(world, way_through(world), 0.0, 0.65), STRIP_PX))
    if strip:
        imageio.imwrite(args.out / "strip.jpg", np.concatenate(strip, axis=1), quality=85)
    if LIT in args.scenes:
        world = flockstep.World.load(LIT)
        view = along(world, way_through(world), 0.0, 0.65)
        lights = [picture(look, *view, STRIP_PX) for look in flockstep.relight(world, LIGHTS, seed=3)]
        imageio.imwrite(args.out / "lights.jpg", np.concatenate(lights, axis=1), quality=85)
    if SOFTENED in args.scenes:
        world = flockstep.World.load(SOFTENED)
        halves = [picture(world, *LOUNGE, HALF_PX, samples_per_pixel=16, **fields) for fields in ({}, SOFT)]
        imageio.imwrite(args.out / "soft-light.jpg", np.concatenate(halves, axis=1), quality=85)
        readings = [sensed(world, errs=errs) for errs in (False, True)]
        imageio.imwrite(args.out / "sensors.jpg", np.concatenate(readings), quality=85)
    print(f"the gallery is in {args.out}/")


if __name__ == "__main__":
    main(tyro.cli(Args))
