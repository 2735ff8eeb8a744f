"""The tasks that are trained here: what env each is, and in which worlds it is flown."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

from stable_baselines3.common.base_class import BaseAlgorithm

import flockstep

TaskName = Literal["lidar", "camera", "pixels"]

OBSERVATIONS: dict[TaskName, str] = {"lidar": "goal", "camera": "blob", "pixels": "pixels"}

#: Seeds of generated playgrounds. Training flies in the first; the model is chosen, and training stops, by the second;
#: what is reported is flown in the third, once, at the end. No seed is in two of them.
TRAINING_SEEDS = range(0, 500_000)
CHOOSING_SEEDS = range(500_000, 1_000_000)
UNSEEN_SEEDS = range(1_000_000, 1_500_000)

# The camera playgrounds have start and goal at one height, and no farther apart sideways than this: the goal is before
# the drone, in view unless a pillar hides it.
CAMERA_HEIGHT_M = 3.12
CAMERA_SIDEWAYS_M = 2.5


@dataclass(frozen=True)
class Setup:
    """A task and what the policy was trained to see of it; saved with the policy."""

    task: TaskName = "lidar"
    width_px: int = 64
    height_px: int = 48
    samples_per_pixel: int = 1
    frame_skip: int = 1

    @property
    def playgrounds(self) -> tuple[str, str]:
        """The sets of shipped playgrounds to train in and to validate in."""
        return ("train", "validation") if self.task == "lidar" else ("camera-train", "camera-validation")

    def make(self, num_envs: int, **keywords: Any) -> flockstep.DroneVectorEnv:
        """Make the env."""
        if self.task != "lidar":
            keywords["camera"] = flockstep.CameraConfig(
                width_px=self.width_px,
                height_px=self.height_px,
                samples_per_pixel=self.samples_per_pixel,
                layout="chw",
            )
        return flockstep.DroneVectorEnv(
            num_envs, observation=OBSERVATIONS[self.task], frame_skip=self.frame_skip, **keywords
        )

    @property
    def generated_note(self) -> str:
        """What `generated` leaves out or changes of generated playgrounds, to be said where a success in them is."""
        if self.task == "lidar":
            return ""
        return (
            "Generated playgrounds of the camera tasks are only those whose goal lies at most "
            f"{CAMERA_SIDEWAYS_M:g} m to the side of the start; they have no waypoints, and one height throughout."
        )

    def generated(self, seeds: range, count: int) -> list[flockstep.World]:
        """Return so many playgrounds generated from the first of these seeds, without what does not suit the task.

        Raises
        ------
        ValueError
            The seeds do not suffice.
        """
        worlds: list[flockstep.World] = []
        for seed in seeds:
            if len(worlds) == count:
                break
            world = flockstep.World.playground(seed=seed)
            if self.task == "lidar":
                worlds.append(world)
            elif abs(world.goal[1] - world.start[1]) <= CAMERA_SIDEWAYS_M:
                worlds.append(without_waypoints(world))
        if len(worlds) < count:
            raise ValueError(f"count: expected at most {len(worlds)}, as many as {seeds} give, got {count}")
        return worlds


def without_waypoints(world: flockstep.World) -> flockstep.World:
    """Return a generated playground as the camera task has them: straight to the goal, at one height."""
    scene = world.to_dict()
    markers = scene["markers"]
    markers.pop("waypoints", None)
    for place in (markers["start"], markers["goal"]):
        place[2] = CAMERA_HEIGHT_M
    for corner, side in (("min", -1), ("max", 1)):
        markers["spawn_box"][corner][2] = CAMERA_HEIGHT_M + 0.25 * side
    return flockstep.World.from_dict(scene)


def remember(model: BaseAlgorithm, setup: Setup) -> None:
    """Note the setup in a model: it is saved and loaded with it."""
    model.setup = asdict(setup)  # type: ignore[attr-defined]


def setup_of(model: BaseAlgorithm) -> Setup:
    """Return the setup a model was trained for; the LiDAR task where nothing is noted."""
    return Setup(**getattr(model, "setup", {}))


def task_names() -> tuple[TaskName, ...]:
    """Return the names of all tasks."""
    return get_args(TaskName)
