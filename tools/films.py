"""The films and pictures of the documents, a row each; the command writes docs/images/NAME.webp.

.venv/bin/python -m tools.films race
.venv/bin/python -m tools.films dodge --policy out/dodge.zip --out out/dodge.webp
.venv/bin/python -m tools.films fan-slice

Neither training nor evaluation uses the filmed worlds and episodes, unless a row's module says so. A film is as fast as
the flight, unless its module says so. A row without a policy trains one first, unless `--policy` names a file.
"""

from __future__ import annotations

import colorsys
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from PIL import Image, ImageDraw
from tqdm import tqdm

import flockstep
from flockstep.trainings import TRAININGS as BUNDLED
from flockstep.trainings import UNSEEN_SEEDS, train
from tools import flight_film, formation_film, race_film, slice_picture, stills
from tools.film import FINER, INK, Array, Film, Frame, Shot, save_film, steps_of, write_captions
from training.board import TRAININGS
from training.forest_flight import FAR_M
from training.tasks import load_policy

STEP_MS = 100  # of the tasks below
INSET = 0.3  # width of the depth image, as a share of the film's


def chase(shot: Shot, name: str, world: str, hold_ms: int, **keywords: Any) -> Iterator[Frame]:
    """Fly a task once in a world; a picture from behind the drone before the first step and after each one."""
    width = shot.width_px // 4 * 4
    size = {"render_mode": "rgb_array", "render_view": "third_person", "render_size": (2 * width, 2 * width * 9 // 16)}
    worlds = flockstep.World.load(f"{world}/seed-{shot.seed}")
    envs = flockstep.DroneVectorEnv(1, worlds=worlds, autoreset_mode="disabled", **size, **keywords)
    last = shot.steps(STEP_MS)
    for step, (_, ended) in enumerate(itertools.islice(steps_of(envs, shot.model, shot.seed), last + 1)):
        ((frame),) = envs.render() or ()
        picture, seconds = Image.fromarray(frame).reduce(2), step * STEP_MS / 1000
        caption = f"{seconds:.1f} s"
        if name != "dodge":
            speed = float(np.linalg.norm(envs.batch.velocity[0]))
            caption += f": {speed:.1f} m/s, {envs.batch.terms.goal_distance()[0]:.0f} m to the goal"
        if name == "forest":  # what the policy sees of it
            inset = depth_picture(envs.batch.camera().depth[0], round(INSET * width))
            picture.paste(inset, (width - inset.width - 8, 8))
        write_captions(picture, [(8, 20, caption, INK)])
        yield picture, hold_ms if ended or step == last else STEP_MS
    print(f"{world}: {'at the goal' if envs.batch.success[0] else 'not at the goal'}")
    envs.close()


def depth_picture(depth: Array, width_px: int) -> Image.Image:
    """Return a depth image (H, W), enlarged without smoothing; near is bright."""
    rows, columns = depth.shape
    bright = 255 * (1 - np.log1p(np.minimum(depth, FAR_M)) / np.log1p(FAR_M))
    scale = width_px // columns
    return Image.fromarray(bright.astype(np.uint8)).resize((scale * columns, scale * rows), Image.Resampling.NEAREST)


def dodge(shot: Shot) -> Iterator[Frame]:
    """Fly Dodge in a playground, then in a warehouse, with bodies that move."""
    for world in ("living_playground", "living_warehouse"):
        yield from chase(shot, "dodge", world, 1000, task=flockstep.DodgeConfig())


def rotors(shot: Shot) -> Iterator[Frame]:
    """Fly past pillars by LiDAR."""
    return chase(shot, "lidar_rotors", "playground", 1000, task=TRAININGS["lidar_rotors"].env)


def forest(shot: Shot) -> Iterator[Frame]:
    """Fly through a forest by depth."""
    return chase(shot, "forest", "forest", 1000, task=TRAININGS["forest"].env)


def swap(shot: Shot, drones: int = 16) -> Iterator[Frame]:
    """Fly Swap, seen from above: drones as discs with trails, their goals as rings."""
    envs = flockstep.DroneVectorEnv(
        1, task=flockstep.SwapConfig(), drones_per_env=drones, max_episode_steps=300, autoreset_mode="disabled"
    )
    positions = [envs.batch.position[:, :2].copy() for _ in steps_of(envs, shot.model, shot.seed)]
    print(f"{drones} drones: {'all at their goals' if envs.batch.success.all() else 'not all at their goals'}")
    goals, radius = (
        envs.batch.task_state["goal"][:, :2].copy(),
        np.linalg.norm(envs.batch.drone.hull[:, :2], axis=1).max(),
    )
    envs.close()
    size = FINER * shot.width_px
    scale = size / (2 * (np.abs(goals).max() + radius + 1.0))
    colors = [colorsys.hsv_to_rgb(m / len(goals), 0.75, 0.85) for m in range(len(goals))]
    inks = [tuple(int(255 * part) for part in color) for color in colors]

    def pixels(points: Array) -> Array:
        return np.asarray(size / 2 + scale * points * [1, -1])

    for step in range(len(positions)):
        picture = Image.new("RGB", (size, size), (250, 250, 250))
        draw = ImageDraw.Draw(picture)
        for goal, ink in zip(pixels(goals), inks, strict=True):
            draw.circle(tuple(goal), scale * 0.3, outline=ink, width=FINER)
        for m, ink in enumerate(inks):
            trail = [tuple(point) for point in pixels(np.array(positions)[: step + 1, m])]
            draw.line(trail, fill=ink, width=FINER)
            draw.circle(trail[-1], scale * radius, fill=ink)
        picture = picture.reduce(FINER)
        write_captions(picture, [(8, 20, f"{step * STEP_MS / 1000:.1f} s", INK)])
        yield picture, STEP_MS if step < len(positions) - 1 else 1500


def by_firmware(shot: Shot) -> Iterator[Frame]:
    """Race by the motors of Betaflight."""
    return race_film.frames(shot, by_firmware=True)


def street(shot: Shot, car: int = 4, behind_s: float = 1.2, above_m: float = 2.8) -> Iterator[Frame]:
    """Follow a car through the streets of a living city.

    The controller is one line: it commands the place where the car was a while ago, some metres above the street. The
    engine would stop the drone at what it hits.
    """
    envs = flockstep.DroneVectorEnv(
        1,
        worlds=flockstep.World.load(f"living_city/seed-{shot.seed}"),
        max_episode_steps=100_000,
        autoreset_mode="disabled",
        render_mode="rgb_array",
        render_view="third_person",
        render_size=(2 * shot.width_px, 2 * (shot.width_px * 9 // 16)),
    )
    envs.reset(seed=0)
    batch = envs.batch

    def place() -> tuple[Array, Array]:
        above = batch.bodies.position[0, car] + np.array([0, 0, above_m], np.float32)
        return above[None], batch.bodies.quat_wxyz[0, car].copy()[None]

    way = [place()]
    batch.set_pose(*way[0])
    while len(way) * STEP_MS < 1000 * behind_s:  # the car drives off
        batch.move(*way[0])
        way.append(place())
    speed, touched = 0.0, False
    for step in range(shot.steps(STEP_MS) + 1):
        ((frame),) = envs.render() or ()
        picture = Image.fromarray(frame).reduce(2)
        write_captions(picture, [(8, 20, f"{step * STEP_MS / 1000:.1f} s, {speed:.1f} m/s", INK)])
        yield picture, STEP_MS
        before = batch.position[0].copy()
        batch.move(*way[step])
        way.append(place())
        speed = float(np.linalg.norm(batch.position[0] - before)) * 1000 / STEP_MS
        touched |= bool(batch.contact.hit[0])
    print("the drone touched something" if touched else "the drone touched nothing")
    envs.close()


LAST = UNSEEN_SEEDS.stop - 1
FILMS = {
    "dodge": Film(dodge, "policies/dodge.zip", LAST, width_px=400, quality=30, film_s=12),
    "swap": Film(swap, "policies/swap.zip", LAST, width_px=400, quality=60),
    "formation": Film(formation_film.frames, "policies/formation.zip", LAST - 14, width_px=352, quality=24),
    "race": Film(race_film.frames, "policies/race.zip", UNSEEN_SEEDS.start, width_px=800, quality=60, key_every=16),
    "gallery/betaflight": Film(
        by_firmware, None, UNSEEN_SEEDS.start, width_px=640, quality=40, training="race_betaflight_apg"
    ),
    "flight": Film(flight_film.frames, "policies/lidar.zip", 1_000_242, width_px=800, quality=50, key_every=100_000),
    "street": Film(street, None, 3, width_px=480, quality=34, film_s=9),
    "forest": Film(forest, None, LAST, width_px=480, quality=30, film_s=40, training="forest"),
    "rotors": Film(rotors, None, LAST, width_px=480, quality=30, film_s=40, training="lidar_rotors"),
}
#: Still pictures: their name, and a function that writes them into a folder.
STILLS: dict[str, Callable[[Path], object]] = {
    "camera-sheet": lambda folder: stills.draw_sheet(folder / "camera-sheet.png"),
    "camera-task": lambda folder: stills.draw_task(folder / "camera-task.jpg"),
    "fan-slice": lambda folder: slice_picture.draw(folder / "fan-slice.webp", slice_picture.Slice.scan()),
    "worlds": stills.draw_worlds,
}


@dataclass
class Args:
    """Options; those that are not given are the row's."""

    name: tyro.conf.Positional[str]
    """Film or still picture: a name of the tables."""
    policy: Path | None = None
    """File of the policy. One of Stable-Baselines3 runs code when it is loaded: load only policies you trust."""
    out: Path | None = None
    """The film, or the folder of still pictures; default: docs/images/NAME.webp, or docs/images."""
    seed: int | None = None
    """Seed of the world and the flight."""
    width_px: int | None = None
    """Width of the film, or of its main view."""
    quality: int | None = None
    """Quality of the pictures, 0 to 100."""
    film_s: float | None = None
    """Longest filmed time from the start of the flight."""


def main(args: Args) -> None:
    """Fly, draw and write the film."""
    if args.name in STILLS:
        folder = args.out or Path("docs/images")
        folder.mkdir(parents=True, exist_ok=True)
        STILLS[args.name](folder)
        print(f"{args.name}: in {folder}/")
        return
    if args.name not in FILMS:
        raise SystemExit(f"NAME: expected one of {', '.join([*FILMS, *STILLS])}, got {args.name!r}")
    film, out = FILMS[args.name], args.out or Path("docs/images") / f"{args.name}.webp"
    policy = args.policy or (None if film.policy is None else Path(film.policy))
    if policy is not None:
        model = load_policy(policy)
    else:
        model = None if film.training is None else train((BUNDLED | TRAININGS)[film.training])
    given = {name: getattr(args, name) for name in ("seed", "width_px", "film_s")}
    shot = Shot(model, **{name: getattr(film, name) if value is None else value for name, value in given.items()})
    frames = list(tqdm(film.frames(shot), "filming", unit=" pictures"))
    save_film(out, frames, film.quality if args.quality is None else args.quality, film.key_every)


if __name__ == "__main__":
    main(tyro.cli(Args))
