"""The tasks for training: their envs and their worlds."""

from __future__ import annotations

import difflib
import importlib
import os
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import EnvSpec
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm

import flockstep
from flockstep.serialization import from_plain
from flockstep.trainings.table import CAMERA_SIDEWAYS_M, goal_is_ahead, level_playground

#: The bundled tasks and their observations.
OBSERVATIONS = {"lidar": "goal", "camera": "blob", "pixels": "pixels"}

#: Gymnasium ids of the bundled tasks.
IDS = {
    "flockstep/LidarNavigation-v0": "lidar",
    "flockstep/CameraNavigation-v0": "camera",
    "flockstep/CameraPixels-v0": "pixels",
}

EXPECTED = f"{', '.join(OBSERVATIONS)}, an id of flockstep's, module:id or module:Class of a flockstep.Task"

# Pillars that block a leg: their distance from markers and, at first, from other pillars is as in the generator. They
# stand at most BESIDE_M from the leg along x and y.
MARKER_CLEARANCE_M = 0.9
PILLAR_GAP_M = 1.4
BESIDE_M = 0.3
PILLAR_TRIES = 200

#: Warning of every program here that loads a policy.
TRUST = "Loading a policy file runs code that is in it (it holds pickled Python objects): load only policies you trust."


def load_policy(path: Path) -> Any:
    """Load a model of `flockstep.PPO` or, with a warning that this runs code from the file, of Stable-Baselines3."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
        if "model.json" in names:
            return flockstep.PPO.load(path)
    print(f"{path}: {TRUST}", file=sys.stderr, flush=True)
    return PPO.load(path, device="cpu")


def env_keywords(task: str) -> dict[str, Any]:
    """Return the keywords of `DroneVectorEnv` that make a task's env.

    Parameters
    ----------
    task
        ``"lidar"``, ``"camera"`` or ``"pixels"``; an id that flockstep registered with Gymnasium, or ``"module:id"`` if
        your own module registers it; or ``"module:Class"`` of a `flockstep.Task`. The working directory is also
        searched for modules.

    Raises
    ------
    ValueError
        The module, id or class does not exist or is of another kind; the message lists the closest names.
    """
    if task in OBSERVATIONS:
        return {"observation": OBSERVATIONS[task]}
    module_name, colon, name = task.rpartition(":")
    module = _imported(task, module_name) if colon else None
    found = getattr(module, name, None)
    if _is_task(found):
        return {"task": found}
    if found is None:
        found = gymnasium.registry.get(name)
        if found is not None and _is_ours(found):
            limit = found.max_episode_steps
            return {**found.kwargs, **({} if limit is None else {"max_episode_steps": limit})}
    what = "is not there" if found is None else f"is a {type(found).__name__}"
    if isinstance(found, type):
        what = "does not derive from flockstep.Task"
    elif isinstance(found, EnvSpec):
        what = "is not an env of flockstep's"
    ids = [name for name, spec in gymnasium.registry.items() if _is_ours(spec)]
    classes = [name for name, value in vars(module).items() if _is_task(value)] if module else []
    known = [f"{module_name}:{name}" for name in classes + ids] if module else [*OBSERVATIONS, *ids]
    nearest = difflib.get_close_matches(task, known, cutoff=0) or known
    raise ValueError(f"task: expected {EXPECTED}, got {task!r}, which {what}. The nearest are {', '.join(nearest)}")


def own_defaults(task: str) -> dict[str, Any]:
    """Return the training defaults that your own task declares, for a task name as in `env_keywords`.

    These are ``max_episode_steps`` from its registration, and ``frame_skip`` and ``worlds`` from its registration or
    its class; worlds only if they are names.
    """
    keywords = env_keywords(task)
    own = from_plain(keywords.get("task"))
    keywords = {name: getattr(own, name) for name in ("frame_skip", "worlds") if hasattr(own, name)} | keywords
    found = {name: keywords[name] for name in ("frame_skip", "max_episode_steps") if name in keywords}
    worlds = keywords.get("worlds")
    names = (worlds,) if isinstance(worlds, str) else tuple(worlds) if isinstance(worlds, (list, tuple)) else ()
    return {**found, "worlds": names} if names and all(isinstance(name, str) for name in names) else found


def _imported(task: str, name: str) -> ModuleType:
    if not all(part.isidentifier() for part in name.split(".")):
        raise ValueError(f"task: expected {EXPECTED}, got {task!r}, where {name!r} is not the name of a module")
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if not f"{name}.".startswith(f"{error.name}."):  # the module exists, but one of its imports fails
            raise
        where = f"neither installed nor in {os.getcwd()}"
        raise ValueError(f"task: expected {EXPECTED}, got {task!r}, whose module is {where}") from None


def _is_task(value: Any) -> bool:
    return isinstance(value, type) and issubclass(value, flockstep.Task) and value is not flockstep.Task


def _is_ours(spec: EnvSpec) -> bool:
    return spec.vector_entry_point == "flockstep.vector_env:DroneVectorEnv"


@dataclass(frozen=True)
class Setup:
    """A task and the settings of its observation and worlds, saved with the policy."""

    task: str = "lidar"
    width_px: int = 64
    height_px: int = 48
    samples_per_pixel: int = 1
    frame_skip: int = 1
    worlds: tuple[str, ...] = ()  # for training, as for flockstep.scenes.load; default: the task's own
    evaluation_worlds: tuple[str, ...] = ()
    lidar_channels: int = 1  # of the built-in tasks' LiDAR; below, the angle between the highest and the lowest
    lidar_vfov_deg: float = 0.0

    @property
    def is_own(self) -> bool:
        """True if the task is not bundled with flockstep."""
        return self.task not in OBSERVATIONS

    @property
    def has_camera(self) -> bool:
        """True if the task is bundled with flockstep and has a camera."""
        return self.task in ("camera", "pixels")

    @property
    def training_worlds(self) -> tuple[str, ...]:
        """Names of the training worlds, in addition to generated ones."""
        return self.worlds or ("camera-train" if self.has_camera else "train",)

    @property
    def playgrounds(self) -> tuple[str, ...]:
        """Names of the training and validation worlds."""
        validation = () if self.is_own else ("camera-validation" if self.has_camera else "validation",)
        return tuple(dict.fromkeys((*self.training_worlds, *(self.evaluation_worlds or validation))))

    def make(self, num_envs: int, **keywords: Any) -> flockstep.DroneVectorEnv:
        """Make the env."""
        if self.has_camera:
            keywords["camera"] = flockstep.CameraConfig(
                width_px=self.width_px,
                height_px=self.height_px,
                samples_per_pixel=self.samples_per_pixel,
                layout="chw",
            )
        if self.lidar_channels > 1:
            keywords["lidar"] = flockstep.LidarConfig(channels=self.lidar_channels, vfov_deg=self.lidar_vfov_deg)
        return flockstep.DroneVectorEnv(
            num_envs, **{**env_keywords(self.task), "frame_skip": self.frame_skip, **keywords}
        )

    def make_limited(self, num_envs: int, max_episode_steps: int | None, **keywords: Any) -> flockstep.DroneVectorEnv:
        """Make the env with a time limit: this many steps, or the task's own limit.

        Raises
        ------
        ValueError
            Neither the argument nor the task has a limit.
        """
        if max_episode_steps is not None:
            keywords["max_episode_steps"] = max_episode_steps
        envs = self.make(num_envs, **keywords)
        if not max_episode_steps and getattr(envs.task, "max_episode_steps", None) == 0:
            envs.close()
            raise ValueError(f"max_episode_steps: expected a number, since {self.task} has none, got none")
        return envs

    def route(self, world: flockstep.World) -> npt.NDArray[np.float32] | None:
        """Return a world's start and goal with the waypoints between them, (K, 3) m; your own tasks have no waypoints.

        None if the world lacks start or goal.
        """
        if world.start is None or world.goal is None:
            return None
        return np.stack([world.start, *([] if self.is_own else world.waypoints), world.goal])

    @property
    def generated_note(self) -> str:
        """The differences between `generated` and ordinary generated playgrounds, to be stated with success rates."""
        if not self.has_camera:
            return ""
        return (
            f"Generated playgrounds have their goal at most {CAMERA_SIDEWAYS_M:g} m to the side of the start; "
            "their waypoints are removed, and start and goal are set to the same height."
        )

    def generated(self, seeds: range, count: int, ahead: bool = True, blocked: bool = False) -> list[flockstep.World]:
        """Return this many suitable playgrounds, generated from the first of these seeds.

        Parameters
        ----------
        seeds, count
            Seeds to generate from, and the number of playgrounds.
        ahead
            For camera tasks, leave out goals that are far to the side of the start.
        blocked
            Add pillars, so that the straight flight of every leg crashes.

        Raises
        ------
        ValueError
            There are not enough seeds.
        """
        worlds: list[flockstep.World] = []
        for seed in seeds:
            if len(worlds) == count:
                break
            world = level_playground(seed) if self.has_camera else flockstep.World.playground(seed=seed)
            if self.has_camera and ahead and not goal_is_ahead(world):
                continue
            if (found := with_blocked_legs(world, seed) if blocked else world) is not None:
                worlds.append(found)
        if len(worlds) < count:
            raise ValueError(f"count: expected at most {len(worlds)}, as many as {seeds} give, got {count}")
        return worlds


def with_blocked_legs(world: flockstep.World, seed: int) -> flockstep.World | None:
    """Return a playground with a further pillar on each leg that can be flown straight, or None if one does not fit."""
    scene, random = world.to_dict(), np.random.default_rng(seed)
    pillars = scene["cylinders"]
    route = np.stack([world.start, *world.waypoints, world.goal])
    legs = np.stack([route[:-1], route[1:]], axis=1)
    for leg in legs[fly_routes([world] * len(legs), list(legs))]:
        for gap_m in np.linspace(PILLAR_GAP_M, 0, PILLAR_TRIES):
            flat = leg[0, :2] + random.random() * (leg[1] - leg[0])[:2] + random.uniform(-BESIDE_M, BESIDE_M, 2)
            apart = np.linalg.norm([each["center"][:2] - flat for each in pillars], axis=1) - 2 * pillars[0]["radius"]
            clear = np.linalg.norm(route[:, :2] - flat, axis=1) - pillars[0]["radius"]
            if apart.min() < gap_m or clear.min() < MARKER_CLEARANCE_M:
                continue
            pillar = {**pillars[0], "center": [*np.round(flat, 2).tolist(), pillars[0]["center"][2]]}
            made = flockstep.World.from_dict({**scene, "cylinders": [*pillars, pillar]})
            if not fly_routes([made], [leg])[0] and flockstep.plan(made, route[0], route[1:]) is not None:
                pillars.append(pillar)
                break
        else:
            return None
    return flockstep.World.from_dict(scene)


def fly_routes(worlds: Sequence[flockstep.World], routes: Sequence[npt.NDArray[np.float32] | None]) -> list[bool]:
    """Fly straight along a route (K, 3) in each world; return True for each arrival without a collision.

    A missing route counts as a failure.
    """
    batch = flockstep.Batch(list(worlds), len(worlds))
    points = [world.start[None] if route is None else route for world, route in zip(worlds, routes, strict=True)]
    count = max(map(len, points))  # shorter ones stay at their end
    targets = np.stack([np.pad(p, ((0, count - len(p)), (0, 0)), mode="edge") for p in points]).astype(np.float32)
    safe = np.array([route is not None for route in routes])
    batch.set_pose(targets[:, 0])
    for leg in range(1, count):
        safe &= ~batch.move(targets[:, leg]).hit
    return [bool(came) for came in safe]


def remember(model: BaseAlgorithm, setup: Setup) -> None:
    """Store the setup in a model, which saves and loads it."""
    model.setup = asdict(setup)  # type: ignore[attr-defined]


def setup_of(model: BaseAlgorithm) -> Setup:
    """Return the setup that a model was trained for; the LiDAR task if the model has none."""
    noted = getattr(model, "setup", {})
    return Setup(**{name: tuple(value) if isinstance(value, list) else value for name, value in noted.items()})
