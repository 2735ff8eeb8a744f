"""The films of a race: three laps of the figure-8 by a trained policy, and by one that Betaflight flies.

It shows the flight of the first unseen seed that starts behind the blue gate, successful or not. The walls are left
out, and the drone is drawn larger than it is. The colour of the trail is the speed; the dark line on the floor is its
shadow.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

import flockstep
from flockstep.pictures.body import Body
from flockstep.pictures.depth_canvas import DepthCanvas
from flockstep.pictures.stage import Stage
from flockstep.registration import make_same_step
from flockstep.relight import DARK_LIGHT
from flockstep.rotations import rotate
from flockstep.trainings.varied import RACED
from tools.film import FINER, Color, Frame, Shot, add_floor, steps_of, write_captions
from tools.flight_film import beside

Array = npt.NDArray[Any]

TRACK = "race/figure-8"
POLICY_HZ = 50  # of the task
FILM_EVERY = 3  # steps of 1/50 s between pictures
HOLD_MS = 1500  # the last picture
ENLARGED = 2.2  # size of the drawn drone, over that of the model
VIEWER_M, TARGET_M, HFOV_DEG = np.array([-1.0, -17.5, 12.5]), np.array([0.0, -0.7, 1.6]), 58.0
TRAIL_S, SHADOW_S = 2.2, 0.5  # older parts of the trail and of its shadow are not drawn
COLORS: dict[str, tuple[float, float, float]] = {
    "floor": (0.020, 0.028, 0.045),
    "grid": (0.035, 0.048, 0.075),
    "gate": (0.75, 0.22, 0.03),
    "start": (0.03, 0.25, 0.85),
    "next": (0.05, 0.90, 0.30),
    "post": (0.10, 0.12, 0.15),
}
SLOW_MPS, FAST_MPS = 5.0, 12.0
INK, SHADOW, ALARM = (240, 243, 248), (10, 13, 20), (255, 110, 90)
RAMP = np.array([[60, 110, 255], [40, 220, 230], [250, 220, 60], [255, 80, 40]], float)  # from slow to fast


@dataclass
class Flight:
    """A flight, step by step, beginning with the start."""

    position: Array
    """(T, 3) m."""
    quat_wxyz: Array
    """(T, 4)."""
    speed_mps: Array
    """(T,)."""
    passed: Array
    """(T,): gates passed so far."""
    first: int
    """Index of the gate that is passed first."""
    success: bool
    """True if it flew all laps."""


def flown(policy: Any, seed: int, *, by_firmware: bool = False) -> Flight:
    """Fly the first episode from this seed on that starts behind gate 0."""
    through = "betaflight" if by_firmware else None
    envs = make_same_step("film", RACED, 1, ends_stay=True, worlds=TRACK, max_episode_steps=3000, through=through)
    for start in itertools.count(seed):
        envs.reset(seed=start)
        if envs.batch.task_state["target"][0] == 1:
            break
    states, batch = [], envs.batch
    for _ in steps_of(envs, policy, start):
        passed = int(batch.task_state["passed"][0])
        speed = float(np.linalg.norm(batch.velocity[0]))
        states.append((np.array(batch.position[0], float), np.array(batch.quat_wxyz[0], float), speed, passed))
    position, quat, speeds, passed_gates = (np.array(each) for each in zip(*states, strict=True))
    success = bool(batch.success[0])
    envs.close()
    return Flight(position, quat, speeds, passed_gates, 1, success)


class Scene:
    """The track and the drone, seen from a fixed place."""

    def __init__(self, size_px: tuple[int, int]) -> None:
        batch = flockstep.DroneVectorEnv(1, task=RACED, worlds=TRACK).batch
        self.world = batch.worlds[0]
        self.gates = list(self.world.gates)
        self.size_px = size_px
        self.body = Body(enlarged(batch.drone))
        self.stages: dict[int, Stage] = {}  # by the index of the next gate

    def picture(self, flight: Flight, step: int) -> Image.Image:
        """Return the drone after this many steps, and its trail."""
        canvas = self.canvas(flight, step)
        shadow = flight.position[max(0, step - round(SHADOW_S * POLICY_HZ)) : step + 1] * [1, 1, 0] + [0, 0, 0.02]
        canvas.lines(shadow[:-1], shadow[1:], SHADOW, width_px=4 * FINER)
        begin = max(0, step - round(TRAIL_S * POLICY_HZ))
        trail = flight.position[begin : step + 1]
        for index in range(len(trail) - 1):
            age = 1 - (index + 1) / (len(trail) - 1)
            color = speed_color(flight.speed_mps[begin + index])
            width_px = round(FINER * (4 - 2.5 * age))
            canvas.lines(trail[index], trail[index + 1], color, width_px=width_px, opacity=1 - 0.75 * age)
        return Image.fromarray(canvas.rgb)

    def canvas(self, flight: Flight, step: int) -> DepthCanvas:
        """Return the track with the drone to draw into, with the next gate in green."""
        following = (flight.first + int(flight.passed[step])) % len(self.gates)
        if following not in self.stages:
            self.stages[following] = Stage(self._drawn(following), 1.0, self.size_px, FINER**2, hfov_deg=HFOV_DEG)
        drone = self.body.at(flight.position[step], flight.quat_wxyz[step])
        return self.stages[following].seen_from(VIEWER_M, TARGET_M, [drone])

    def _drawn(self, following: int) -> flockstep.World:
        builder = flockstep.WorldBuilder("film")
        builder.light(**DARK_LIGHT)
        m = {name: builder.material(name, color, emissive=glow(name, color)) for name, color in COLORS.items()}
        add_floor(builder, *(np.asarray(self.world.bounds, float) * [1, 1, 0]), m["floor"], m["grid"])
        for index, gate in enumerate(self.gates):
            color = "next" if index == following else "start" if index == 0 else "gate"
            center = np.asarray(gate["center"], float)
            size = {"size_m": gate["size_m"], "bar_m": gate["bar_m"]}
            builder.gate(beside(center), m[color], gate["quat_wxyz"], shape=gate["shape"], **size)
            side = rotate(np.asarray(gate["quat_wxyz"], float), np.array([0.0, 0.5 * gate["size_m"] + 0.05, 0.0]))
            for foot in (center - side, center + side):
                top = foot[2] - 0.5 * gate["size_m"]
                builder.cylinder((foot[0], foot[1], top / 2), 0.03, top, m["post"])
        return builder.build()


def glow(name: str, color: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the light that a material emits."""
    share = {"next": 0.9, "gate": 0.35, "start": 0.45}.get(name, 0.0)
    return share * color[0], share * color[1], share * color[2]


def enlarged(drone: flockstep.DroneModel) -> flockstep.DroneModel:
    """Return a larger drone for the pictures."""
    return drone.scaled(size=ENLARGED)


def speed_color(speed_mps: float) -> Color:
    """Return the colour of a speed."""
    place = np.clip((speed_mps - SLOW_MPS) / (FAST_MPS - SLOW_MPS), 0, 1) * (len(RAMP) - 1)
    red, green, blue = (round(np.interp(place, np.arange(len(RAMP)), column)) for column in RAMP.T)
    return red, green, blue


def captioned(scene: Scene, flight: Flight, step: int) -> Image.Image:
    """Return a picture with the time and the speed, and the times of finished laps."""
    picture = scene.picture(flight, step)
    laps = lap_ends(flight, len(scene.gates))
    lines = [(20, f"{flight.speed_mps[step]:.1f} m/s", speed_color(flight.speed_mps[step]))]
    for index, end in enumerate(laps):
        if end <= step:
            begin, note = (laps[index - 1], "") if index > 0 else (0, ", from rest")
            lines.append((14, f"lap {index + 1}: {(end - begin) / POLICY_HZ:.2f} s{note}", INK))
    if step == len(flight.position) - 1 and not flight.success:
        lines.append((14, "crashed", ALARM))
    tops = 12 + 1.35 * np.cumsum([0, *(size for size, _, _ in lines)])
    write_captions(picture, [(top, *line) for top, line in zip(tops, lines, strict=False)], edged=False)
    return picture


def lap_ends(flight: Flight, gates: int) -> list[int]:
    """Return the steps after which laps were finished."""
    return [int(np.argmax(flight.passed >= gates * lap)) for lap in range(1, int(flight.passed[-1]) // gates + 1)]


def frames(shot: Shot, *, by_firmware: bool = False) -> Iterator[Frame]:
    """Fly, and draw every few steps."""
    flight = flown(shot.model, shot.seed, by_firmware=by_firmware)
    scene = Scene((shot.width_px, shot.width_px * 9 // 16))
    last = shot.steps(1000 / POLICY_HZ, len(flight.position) - 1)
    for step in [*range(0, last, FILM_EVERY), last]:
        yield captioned(scene, flight, step), HOLD_MS if step == last else round(1000 * FILM_EVERY / POLICY_HZ)
    end = "success" if flight.success else "crash"
    steps, gates = len(flight.position) - 1, flight.passed[-1]
    print(f"{end} after {steps} steps, {gates} gates, at most {flight.speed_mps.max():.1f} m/s")
