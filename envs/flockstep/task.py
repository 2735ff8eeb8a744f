"""The base class for your own tasks, which define observations, rewards and the end of an episode.

A `Task` is one Python object for all N drones; its methods read and write arrays with a row per drone. The engine does
the rest, as in its built-in tasks: motion, sensing, autoreset, time limits, frame skip, episode statistics, seeding and
snapshots.
"""

from __future__ import annotations

import pickle
import weakref
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep._core import (
    Batch,
    BodyConfig,
    CameraConfig,
    ClockConfig,
    DroneModel,
    DynamicsConfig,
    LidarConfig,
    Light,
    World,
)
from flockstep.rotations import Array, rotate

if TYPE_CHECKING:
    from flockstep.pictures.drawing import Drawing
    from flockstep.scenes import WorldsLike
    from flockstep.world_pool import WorldPool

BoolArray: TypeAlias = npt.NDArray[np.bool_]
Target: TypeAlias = Array | tuple[Array, Array]
#: A drone: the object, its name or its path.
DroneLike: TypeAlias = DroneModel | str | PathLike[str]


#: The kinds of markers that a world may have.
MARKERS = ("start", "waypoints", "goal")


class Task:
    """Base class of tasks written in Python.

    Give the class an ``observation_space`` (a `gymnasium.spaces.Box`, or a `Dict` of them) and override `observe` and
    `step`. Everything else has defaults: actions are displacements of up to ``step_m`` metres per axis, flown with
    collision, and episodes begin at the start marker of the drone's world.

    Random numbers come from ``batch.random(stream, count)``, a row per env. They depend only on the env's seed, its
    episode and the stream, so env i behaves the same for any number of envs. Use a separate stream for each purpose.
    With several drones in an env, ``batch.random(stream, count, row_kind="drone")`` has a row per drone.

    Attributes
    ----------
    observation_space, action_space
        Spaces of one env. Actions are a `Discrete`, or a `Box` of floats.
    reward_terms
        Names of the reward terms, if `step` returns the reward as a mapping; ``batch.reward_terms`` has a column for
        each.
    lidar, camera
        The LiDAR and the camera that the task needs, if any, or a sequence of several.
    bodies, max_bodies
        Bodies in every env when an episode begins, one `BodyConfig` or a sequence, and the number of slots for bodies;
        see `Bodies`. Default: none.
    interaction
        How the drones of an env interact; see `Batch`.
    lights
        Lights of which each episode of an env draws one, a `Light` or a sequence. Default: the lights of the worlds.
    worlds
        Default worlds of envs with this task, in a form that `DroneVectorEnv` accepts. Default: none, so that envs need
        ``worlds``.
    drone, dynamics, clock
        Defaults of envs with this task: a `DroneModel` or an argument of `DroneModel.load`, a `DynamicsConfig` and a
        `ClockConfig`. Default: the 650-class quadrotor, kinematic, at 10 Hz.
    max_episode_steps
        Episodes are truncated after this many steps; 0 means never. The env's own limit takes precedence.
    frame_skip, random_world, episodes
        Defaults of envs with this task, as in `EpisodeConfig`.
    markers
        The world's markers that the task uses, among ``"start"``, ``"waypoints"`` and ``"goal"``. Default: all.
        Rendered pictures show only these. The drones' own cameras are not affected.
    step_m
        Length of a full displacement in the default `act`, in metres.
    row_kind
        Kind of the rows of actions, observations, rewards and flags if envs have several drones. ``"drone"``: one row
        per drone, N rows. ``"env"``: one row per env, E rows; one action commands all drones of an env. The result of
        `act` always has a row per drone. Arrays of the batch have N or E rows, as documented there.
    records_path
        True if `step` reads ``batch.path``: the positions of the drones before the step and after each of its ticks.
    steps
        (N,) int64: steps flown in the current episode; in `step`, the current step is included. Read-only.
    flying
        (N,) bool, for use in `act` and `step`: True if the row takes part in the current step. False if its episode was
        already over, as in the step that resets it. In False rows the drone does not move, the result of `step` is
        discarded, and any state of yours that affects the observation should stay unchanged. Read-only.
    success
        (N,) bool: write it in `step`; the infos of ended episodes report it. It ends no episode itself.
    truncated
        (N,) bool: set it in `step` to cut an episode off for a reason other than ``max_episode_steps``, without ending
        the task. It is all False when `step` is called.
    left_area
        (N,) bool: set it in `step` if the episode ends because the drone left the allowed area. The infos then report
        `EpisodeEnd.left_area`, otherwise `EpisodeEnd.task`. It is all False when `step` is called.
    info_names
        Names of further values in the infos of ended episodes; ``info`` has an array for each.
    info
        A (N,) float64 array for each name: write it in `step`, for example ``self.info["laps"] += lap``. Every episode
        begins with 0; the value at its end is reported.
    """

    observation_space: spaces.Box | spaces.Dict
    action_space: spaces.Space[Any] = spaces.Box(-1.0, 1.0, (3,), np.float32)
    reward_terms: tuple[str, ...] = ("reward",)
    lidar: LidarConfig | Sequence[LidarConfig] | None = None
    camera: CameraConfig | Sequence[CameraConfig] | None = None
    bodies: BodyConfig | Sequence[BodyConfig] | None = None
    max_bodies: int = 0
    interaction: Literal["none", "sense", "collide", "both"] = "none"
    lights: Light | Sequence[Light] | None = None
    worlds: WorldsLike | WorldPool | None = None
    drone: DroneLike | None = None
    dynamics: DynamicsConfig | None = None
    clock: ClockConfig | None = None
    max_episode_steps: int = 1000
    frame_skip: int = 1
    random_world: bool = False
    episodes: Literal["team", "each", "last"] = "team"
    info_names: tuple[str, ...] = ()
    markers: tuple[str, ...] = MARKERS
    step_m: float = 0.1
    row_kind: Literal["drone", "env"] = "drone"
    records_path: bool = False

    success: BoolArray
    truncated: BoolArray
    left_area: BoolArray
    info: dict[str, npt.NDArray[np.float64]]
    _batch: weakref.ref[Batch] | None = None  # the batch that owns this task
    _constants: dict[str, Any] | None = None  # values that other attributes than arrays and numbers had after setup

    @property
    def steps(self) -> npt.NDArray[np.int64]:
        """Steps flown in the current episode, (N,)."""
        return self._own_batch().steps

    @property
    def flying(self) -> BoolArray:
        """Mask of the drones that fly in the current step, (N,). The episodes of all others are over."""
        return self._own_batch().flying

    def _own_batch(self) -> Batch:
        batch = None if self._batch is None else self._batch()
        if batch is None:
            raise RuntimeError(
                f"{_name(self)}: this task belongs to no environment, or its environment has been closed"
            )
        return batch

    def __getstate__(self) -> dict[str, Any]:  # copies and pickles belong to no batch
        return {name: value for name, value in vars(self).items() if name not in ("_batch", "_constants")}

    def setup(self, batch: Batch) -> None:
        """Allocate state with a row per drone. Called once, before the first `reset`."""

    def reset(self, batch: Batch, mask: BoolArray) -> None:
        """Begin new episodes where ``mask`` (N,) is True: place those drones and reset their rows of your state.

        ``batch.rows`` has the indices of these rows. With ``rows=batch.rows``, `Batch.random`, `Batch.set_pose` and
        `Batch.set_velocity` take only these rows. With several drones per env, `Batch.random` takes indices of envs and
        the others take indices of drones; drone d belongs to env ``d // batch.drones_per_env``. With
        ``row_kind="drone"``, `Batch.random` takes indices of drones too.
        """
        level = np.zeros((batch.num_drones, 4), np.float32)
        level[:, 0] = 1
        drones = mask if self.row_kind == "drone" else np.repeat(mask, batch.drones_per_env)
        batch.set_pose(batch.terms.start(), level, drones)

    def curriculum(self, batch: Batch, rows: npt.NDArray[np.int64]) -> None:
        """Adapt the task to its results, for example raise the level of an env after a success.

        Called once at the end of each step in which episodes ended, with the indices of their rows, before these begin
        their next episodes. Their results are still available: ``batch.success``, ``batch.episode_end``,
        ``batch.episode_return``, ``batch.episode_length`` and your state. The last observation has already been made.
        Hold levels in arrays: snapshots contain these. An episode that the caller cuts off with a reset does not count.
        """

    def act(self, batch: Batch, actions: Array) -> Target:
        """Return a target for each drone: positions (N, 3) m, or a pair of positions and quaternions (N, 4).

        If the env's ``control`` is not ``"pose"``, return commands (N, 4), as described by `DynamicsConfig`.
        """
        displacement = np.float32(self.step_m) * np.clip(actions.astype(np.float32), -1, 1)
        return batch.position + rotate(batch.quat_wxyz, displacement)

    def step(self, batch: Batch) -> tuple[Array | Mapping[str, Array], BoolArray]:
        """Return the reward (N,) of the motion just flown and sensed, and a mask (N,) of the episodes that it ended.

        The reward may be a mapping from the names in ``reward_terms`` to arrays (N,); their sum is the reward.
        """
        raise NotImplementedError(f"{_name(self)}.step: every task has to define it")

    def observe(self, batch: Batch) -> Array | Mapping[str, Array]:
        """Return the observation of all drones, ``(N, *observation_space.shape)``, or a mapping of these."""
        raise NotImplementedError(f"{_name(self)}.observe: every task has to define it")

    def draw(self, batch: Batch, env: int, drawing: Drawing) -> None:
        """Add to the picture of one env: ``drawing`` draws points, lines, spheres, cells and text, in metres.

        Called for each picture of the views ``"top"``, ``"third_person"`` and ``"fleet"``, and of the view between two
        points. It is not called for ``"camera"``, which shows the drone's own frames. Change no state here: rendering
        must have no side effects.
        """

    def state(self) -> dict[str, Array]:
        """Return all your state that affects later steps, for `DroneVectorEnv.snapshot`.

        By default this is every attribute that is a NumPy array or a number. All other attributes must stay as `setup`
        left them. A changed one raises an error, because there is no general way to save it. Hold state in arrays, draw
        random numbers from ``batch.random``, or override `state` and `load`. The arrays must keep their names and
        shapes: a snapshot with other shapes is rejected.
        """
        state = {}
        for name, value in vars(self).items():
            if name in _NOT_STATE:
                continue
            if isinstance(value, (np.ndarray, np.generic, int, float)):
                state[name] = np.asarray(value)
                if not state[name].dtype.hasobject:
                    continue
            elif self._constants is None or _is_same(self._constants.get(name, _MISSING), _constant(value)):
                continue
            raise TypeError(
                f"{_name(self)}.state: the attribute {name!r} ({type(value).__name__}) has changed since setup; a "
                "snapshot keeps only arrays and numbers: use these for state, or override state and load"
            )
        return state

    def load(self, state: Mapping[str, Array]) -> None:
        """Restore the result of `state`; by default set the attributes of these names."""
        for name, value in state.items():
            present = getattr(self, name)
            if isinstance(present, np.ndarray) and present.flags.writeable and present.dtype == value.dtype:
                present[...] = value
            else:
                setattr(self, name, value if isinstance(present, np.ndarray) else type(present)(value.item()))


_PROVIDED = ("success", "truncated", "left_area", "info")  # attributes that flockstep provides
_SPACES = ("observation_space", "action_space")  # sampling changes their random state
_NOT_STATE = ("_batch", "_constants", *_PROVIDED, "max_episode_steps", *_SPACES)
_MISSING = object()


def _constant(value: Any) -> Any:
    """Return a fingerprint that reveals later changes of a value: its pickled bytes, or else the value itself."""
    if value is None or isinstance(value, (str, bytes, type, World)) or callable(value):
        return value
    try:
        return pickle.dumps(value)
    except Exception:  # pickling can raise anything; then only a different object counts as a change
        return value


def _is_same(before: Any, now: Any) -> bool:
    return before is now or (isinstance(before, (str, bytes)) and bool(before == now))


def _name(task: Task) -> str:
    return type(task).__name__
