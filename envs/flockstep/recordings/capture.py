"""Record envs while a program flies them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

from flockstep._core import World
from flockstep.drone_mesh import DroneMesh
from flockstep.recordings.moment import GATES, Array, Moments
from flockstep.recordings.recording import Contents, Recording, plain_paths
from flockstep.task import Task
from flockstep.vector_env import DroneVectorEnv


class Capture:
    """Collects a `Recording` from envs: call `add` after the reset and after each step.

    Parameters
    ----------
    envs
        The envs, which were reset.
    title
        Title of the recording. Default: the name of the task.
    num_envs
        Record only the first envs. None: all.
    paths
        As in `Recording.writer`.
    """

    def __init__(
        self,
        envs: DroneVectorEnv,
        *,
        title: str | None = None,
        num_envs: int | None = None,
        paths: Sequence[npt.ArrayLike] = (),
    ) -> None:
        self._envs = envs
        self._moments = Moments(envs.batch, num_envs)
        self._contents = contents_of(envs, self._moments, title, paths)
        self._steps: list[dict[str, Array]] = []
        self._images: dict[str, list[bytes]] = {}
        self._step_s = step_seconds(envs)

    def add(self, actions: npt.ArrayLike | None = None) -> None:
        """Add the present moment, with the actions that led to it."""
        arrays, images = self._moments.now()
        for name, files in images.items():
            self._images.setdefault(name, []).extend(files)
        arrays |= arrays_in(self._envs, self._moments, actions)
        self._steps.append(arrays)

    def recording(self) -> Recording:
        """Return what was added so far."""
        if not self._steps:
            raise RuntimeError("the capture is empty: call add after the reset and after each step")
        return Recording._of(
            replace(
                self._contents,
                arrays={name: np.stack([step[name] for step in self._steps]) for name in self._steps[0]},
                images={name: list(files) for name, files in self._images.items()},
                times_s=np.arange(len(self._steps)) * self._step_s,
            )
        )


def contents_of(
    envs: DroneVectorEnv, moments: Moments, title: str | None = None, paths: Sequence[npt.ArrayLike] = ()
) -> Contents:
    """Return all that a recording of envs holds beside its moments. Worlds and bodies appear in it as they are seen."""
    mesh = envs._drone_mesh
    return Contents(
        arrays={},
        images={},
        settings={**moments.settings(), "paths": plain_paths(paths)},
        worlds=moments.worlds,
        bodies=moments.bodies,
        drone=envs.batch.drone,
        look=DroneMesh._of_world(mesh) if isinstance(mesh, World) else mesh,
        recipe=envs.recipe.to_json(),
        times_s=np.zeros(0),
        title=title_of(envs) if title is None else title,
        repeats_ends=envs.autoreset_mode is AutoresetMode.DISABLED,
        units={name: array.unit for name, array in moments.arrays.items()},
    )


def arrays_in(envs: DroneVectorEnv, moments: Moments, actions: npt.ArrayLike | None) -> dict[str, Array]:
    """Return what envs add to the arrays of a moment.

    The actions (R, k) float32 of the rows that are read, NaN if there are none, and `GATES` if the task counts them.
    """
    width = int(np.prod(envs.single_action_space.shape or (1,)))
    found = {"actions": np.full((moments.rows, width), np.nan, np.float32)}
    if actions is not None:
        found["actions"] = np.asarray(actions, np.float32).reshape(envs.num_envs, width)[moments.slices["R"]]
    state = vars(envs.task) if isinstance(envs.task, Task) else envs.batch.task_state
    gates = {name: state[of] for name, of in GATES.items() if _is_count(state.get(of), envs.batch.num_drones)}
    if len(gates) == len(GATES):
        found |= {name: values[moments.slices["N"]].astype(np.int32) for name, values in gates.items()}
    return found


def _is_count(values: Any, rows: int) -> bool:
    return isinstance(values, np.ndarray) and values.shape == (rows,) and values.dtype.kind == "i"


def step_seconds(envs: DroneVectorEnv) -> float:
    """Return the simulated time of an env step, s."""
    return envs.recipe.episode.frame_skip / envs.batch.clock.policy_hz


def title_of(envs: DroneVectorEnv) -> str:
    """Return the name of the envs' task."""
    if envs.spec is not None and isinstance(envs.spec.id, str):
        return envs.spec.id.removeprefix("flockstep/")
    if isinstance(envs.task, Task):
        return type(envs.task).__name__
    return type(envs.task).__name__.removesuffix("Config") if envs.task is not None else "Navigation"
