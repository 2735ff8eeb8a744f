"""Pictures of the generated worlds for docs/own-world.md: drones on their way, and a city from above.

.venv/bin/python -m tools.world_pictures --out docs
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import tyro

import flockstep
from flockstep.pictures.third_person_view import ThirdPersonView
from flockstep.pictures.trail import Trail
from tools.gallery import Image, View, picture, way_through

SIZE_PX = (1120, 630)
LIDAR = flockstep.LidarConfig(beams=60, hfov_deg=360.0, max_range_m=5.0)


@dataclass(frozen=True)
class Flight:
    """A flight along the path of a scene, and the moment of its picture."""

    scene: str
    share: float
    """Fraction of the path that the drone has flown."""
    view: View | None = None
    """Viewer and target, m. None: from behind the drone."""


def view(position: tuple[float, float, float], target: tuple[float, float, float]) -> View:
    """Return a view from a position towards a target, m."""
    return np.array(position, np.float32), np.array(target, np.float32)


#: The flights by the name of their picture.
FLIGHTS = {
    "forest": Flight("outdoor/forest", 0.2),
    "office": Flight("indoor/office", 0.46, view((15, 7, 2.3), (18.7, 11.5, 1.2))),
    "warehouse": Flight("indoor/warehouse", 0.12, view((4, 14, 3.0), (11, 18.9, 1.6))),
}
#: The scene of city.jpg, and a view across its square.
CITY, ACROSS_THE_SQUARE = "outdoor/city", view((34, 18, 36), (62, 64, 6))


def fly(flight: Flight, size_px: tuple[int, int] = SIZE_PX) -> Image:
    """Return a picture of a drone on its way, with its LiDAR beams and its trail."""
    world = flockstep.World.load(flight.scene)
    batch = flockstep.Batch([world], lidar=LIDAR)
    way, trail = way_through(world), Trail(batch)
    for position in way[: round(flight.share * len(way))]:
        batch.move(position[None])
        trail.record()
    batch.sense()
    return ThirdPersonView(batch, trail=trail, size_px=size_px, place=flight.view, markers=()).frame(0)


@dataclass
class Args:
    """Draw forest.jpg, city.jpg, office.jpg and warehouse.jpg."""

    out: Path = Path("out/worlds")
    """Folder for the pictures."""
    width_px: int = SIZE_PX[0]
    """Width of the pictures."""


def main(args: Args) -> None:
    """Draw, and print the location."""
    args.out.mkdir(parents=True, exist_ok=True)
    size_px = args.width_px, args.width_px * SIZE_PX[1] // SIZE_PX[0]
    images = {name: fly(flight, size_px) for name, flight in FLIGHTS.items()}
    images["city"] = picture(flockstep.World.load(CITY), *ACROSS_THE_SQUARE, size_px)
    for name, image in images.items():
        imageio.imwrite(args.out / f"{name}.jpg", image, quality=85)
    print(f"{', '.join(f'{name}.jpg' for name in images)} are in {args.out}/")


if __name__ == "__main__":
    main(tyro.cli(Args))
