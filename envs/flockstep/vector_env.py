"""The Gymnasium vector environment over a `Batch`."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from flockstep import scenes, serialization, stepping
from flockstep._core import Batch, NativeTask, ObservationConfig, Recipe, World
from flockstep.drone_mesh import DroneMesh
from flockstep.errors import ClosedError
from flockstep.keywords import autoreset_name, keywords_of, names_of_worlds, require_count, route, show_keywords
from flockstep.pictures import choice
from flockstep.pictures.frames import selected
from flockstep.pictures.shown import Shown, built_render_modes, require_render_mode
from flockstep.shared_attributes import SharedAttributes
from flockstep.stepping import AUTORESET_MODES, Array, BoolArray, Observation
from flockstep.task import DroneLike, Task
from flockstep.task_declarations import action_space, observation_space
from flockstep.world_pool import WorldPool

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from flockstep._core import _EngineTask
    from flockstep.env_keywords import EnvKeywords
    from flockstep.pictures.lines import Trail
    from flockstep.pictures.views import View


class DroneVectorEnv(VectorEnv[Observation, Array, Array], SharedAttributes, Shown):
    """Many drone envs stepped by one call, with a task of the engine or your own `Task`.

    The built-in tasks are navigation, which is the default, and those of the other ids of Gymnasium that begin with
    ``flockstep/``. Each has a configuration that describes it, whose class has its name and ends in ``Config``. The
    navigation tasks differ in their observations and therefore in their defaults: 35 beams over 270 degrees with a
    range of 3 m, or, for the two camera tasks, 20 beams over 180 degrees and a camera of 64 x 48 pixels over 90
    degrees, facing forward.

    - ``"goal"`` (``flockstep/LidarNavigation-v0``): float32 (3 + rays,), the unit direction to the current goal in the
      body frame, then the LiDAR ranges divided by the maximum range (1 on a miss).
    - ``"blob"`` (``flockstep/CameraNavigation-v0``): float32 (2 + rays,), the position and size of the goal in the
      camera's image, then the ranges. The goal's pixels are green, or have the ``color`` that you set.
      `flockstep.color_blob` computes the first two: the x offset of the blob's box from the image's centre, divided by
      half the width, and the box's area divided by the image's area. Both are 0 if the colour is not visible.
    - ``"pixels"`` (``flockstep/CameraPixels-v0``): a dict of ``image``, uint8 (3, height, width), and ``ranges``,
      float32 (rays,). The camera's layout is ``"chw"``.

    Env i flies in world i modulo the number of worlds, unless ``random_world`` is set or the worlds come from a
    `WorldPool`.

    Parameters
    ----------
    num_envs
        Number of envs, E; also the number of drones if ``drones_per_env`` is 1. With several drones per env the
        attribute of this name is another number, see there.
    worlds
        A set of `flockstep.scenes` (``"train"``, ``"validation"``), a scene name, a path, a `World`, or a sequence of
        these; or a `WorldPool`, from which each episode draws one. Default: ``"train"``, or ``"camera-train"`` for
        camera tasks; a `Task` declares its own.
    task
        The configuration of a built-in task, your own `Task` (an object, or its class), or a `NativeTask` in C++.
        Default: navigation, by keywords. With `gymnasium.make_vec`, the time limit registered for the env's id applies,
        unless ``max_episode_steps`` is also given.
    observation
        Observation of the navigation task: ``"goal"``, ``"blob"`` or ``"pixels"``.
    drone
        A `DroneModel`, the name of a bundled airframe, or the path of a JSON file. Default: the task's drone, which for
        navigation is the 650-class quadrotor.
    autoreset_mode
        ``"next_step"``, ``"same_step"``, ``"disabled"``, or the member of `gymnasium.vector.AutoresetMode`.
        Default: ``"next_step"``.
    copy
        True: every returned array is new. False: observation, reward and flags are views of two alternating buffers; a
        view stays valid during the next step or reset, and the one after that overwrites it.
    reward_scale
        `step` returns the rewards multiplied by this, for learning algorithms that need small rewards. The episode
        return in the infos and ``batch.reward_terms`` are not scaled.
    render_mode
        None; ``"human"``: the first reset opens `flockstep.view`; ``"rgb_array"``: `render` returns a picture of each
        env.
    render_view
        ``"top"``: the whole world from above, cut off above the drone, with LiDAR beams. ``"camera"``: the last frame
        of the drone's own camera; black if it is stale. ``"third_person"``: from behind and above the drone, with LiDAR
        beams, camera frustums and the trail. ``"fleet"``: the same, with the other drones of its world. Two points (m,
        world frame), such as ``((0, -8, 5), (4, 4, 1))``: the same as ``"fleet"``, seen from the first point towards
        the second. All show the lines of `Batch.set_move_line_visible` and the beams of `Batch.set_beams_visible`.
        Default: ``"third_person"`` for tasks in which attitude and height matter, otherwise ``"top"``.
    render_size
        Width and height of the pictures in pixels. Default: 256 x 256 for ``"top"``, the camera's own size for
        ``"camera"``, otherwise 640 x 480. With ``"camera"``, frames are scaled if the size is not the camera's own.
    render_camera
        The name of the camera that ``render_view="camera"`` shows. Default: the first.
    render_style
        ``"bright"``, ``"dark"``: perspective views in dark colours, shining beams, or ``"soft"``: soft shadows, slow.
    render_samples
        Samples per pixel of perspective views, 1, 4, 9 or 16: with 1, edges are jagged and a picture takes a third of
        the time.
    render_beams
        False: views show only the LiDAR beams of `Batch.set_beams_visible`.
    through
        ``"betaflight"``: this firmware flies the drones, each by a process of its own, in place of the built-in
        controller. Needs ``control="body_rates"`` or ``"attitude"``, and the extra ``betaflight``.
    drone_mesh
        A `DroneMesh`, or a `World` of triangles, that shows the drones in perspective views, from behind and from a
        fixed point, and to the cameras of other drones, if these see each other. Default: in views
        `DroneMesh.quadrotor`, for cameras its hull. LiDARs and collisions always use the hull of ``drone``.
    **keywords
        Fields of the env's `Recipe` and of its configurations, as follows. The task sets their defaults. One
        configuration stands for a list of one.

    Attributes
    ----------
    num_envs
        Number of rows of actions, observations and rewards: N = E M drones, or E envs for a task whose ``row_kind`` is
        ``"env"``. Gymnasium and trainers count these as envs. Drone m of env i has row i M + m. `num_rows` is the same.
    num_groups
        Number of envs, E, the argument ``num_envs``. Drones of a group share a world and a seed.
    drones_per_env
        Number of drones in each group, M.
    batch
        The `Batch` that simulates the drones; `close` releases it.
    task
        The given task, with fields set by keywords; None is the navigation task by keywords.
    lidar
        The first `LidarConfig` in use, or None.
    lidars
        The list of `LidarConfig` in use.
    cameras
        The list of `CameraConfig` in use.
    observation_space, action_space, single_observation_space, single_action_space
        Spaces of all envs, and of one.
    autoreset_mode
        A member of `gymnasium.vector.AutoresetMode`.
    copy
        True if returned arrays are new.
    reward_scale
        Factor of the returned rewards.
    render_mode
        None, ``"human"`` or ``"rgb_array"``.
    trail
        The past positions of the drones if the pictures show them, otherwise None.
    metadata
        Render modes, pictures per second and autoreset mode, for Gymnasium.
    spec
        The `gymnasium.envs.registration.EnvSpec` that made the env, or None.
    closed
        True once `close` was called.

    Infos
    -----
    Infos are empty unless an episode ended in the step. The keys are ``episode_return``, ``episode_length``,
    ``success``, ``crashed``, ``bad_state``, ``episode_end``, and the names in a `Task`'s ``info_names``. Each value is
    an array of length N, with a mask of the ended episodes under the key with a leading underscore. ``episode_terms``
    is a dict of such arrays and masks, with the sum of each reward term. With same-step autoreset these are inside
    ``final_info``, beside ``final_obs``. With autoreset disabled, a finished env repeats its flags and infos until it
    is reset. With ``episodes="last"``, ``finished`` is a mask of the rows that did not fly in the step: ignore them
    when learning. ``episode_end`` is the reason for the end, a value of `EpisodeEnd`. An episode ends with
    ``bad_state`` if a target, a reward or an observation was not finite; ``batch.bad_states`` counts these episodes.

    Raises
    ------
    ValueError
        A value is out of range; the message names it.
    TypeError
        A keyword does not exist, or belongs to another task.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": built_render_modes(),
        "render_fps": 10,  # pictures per second at the speed of the flight; each env sets its own
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    spec: Any = serialization.PlainSpec()

    def __init__(
        self,
        num_envs: int = 1,
        *,
        worlds: scenes.WorldsLike | WorldPool | None = None,
        task: Task | type[Task] | NativeTask | _EngineTask | None = None,
        observation: str = "goal",
        drone: DroneLike | None = None,
        autoreset_mode: str | AutoresetMode | None = None,
        copy: bool = True,
        reward_scale: float = 1.0,
        render_mode: str | None = None,
        render_view: str | npt.ArrayLike | None = None,
        render_size: tuple[int, int] | None = None,
        render_camera: str | None = None,
        render_style: str = "bright",
        render_samples: int = 4,
        render_beams: bool = True,
        drone_mesh: DroneMesh | World | None = None,
        through: Literal["betaflight"] | None = None,
        **keywords: Unpack[EnvKeywords],
    ) -> None:
        own = {name: value for name, value in locals().items() if name not in ("self", "keywords")}
        self._arguments: dict[str, Any] = {**own, **keywords}  # for copies and pickles
        worlds, task, drone, drone_mesh = (serialization.from_plain(x) for x in (worlds, task, drone, drone_mesh))
        given = {name: serialization.from_plain(value) for name, value in keywords.items()}
        require_render_mode(render_mode)
        if not isinstance(drone_mesh, (DroneMesh, World, type(None))):
            raise TypeError(f"drone_mesh: expected a flockstep.DroneMesh, a World or None, got {drone_mesh!r}")
        self.reward_scale = stepping.require_reward_scale(reward_scale)
        if autoreset_mode is not None:
            given["autoreset_mode"] = autoreset_name(autoreset_mode)
        self.num_groups = require_count("num_envs", num_envs)
        if given.get("drones_per_env") is not None:
            given["drones_per_env"] = require_count("drones_per_env", given["drones_per_env"])
        if given.get("max_episode_steps", 0) is None:
            del given["max_episode_steps"]  # the task's limit, or that of an `EpisodeConfig`

        routed = route(task() if isinstance(task, type) else task, observation, given, OWN_KEYWORDS)
        recipe, self.task = routed.recipe, routed.task
        recipe.num_envs = self.num_groups
        if drone is not None:
            recipe.drone = drone
        if recipe.interaction in ("sense", "both"):  # otherwise only pictures show it
            recipe._set(drone_mesh=drone_mesh)
        if worlds is None:
            worlds = self.task.worlds if isinstance(self.task, Task) else recipe.worlds
            if worlds is None:
                name = type(self.task).__name__
                raise ValueError(f"{name} declares no worlds: set {name}.worlds = 'train', or pass worlds=")
        recipe.worlds = names_of_worlds(worlds)
        if through is not None:
            from flockstep.bridges import betaflight  # few envs need what it imports

            betaflight.prepare(through, recipe)
        words = getattr(recipe.task, "_words", {})  # only a task of the engine has them
        view = words.get("view", "top") if render_view is None else render_view
        shown = choice.choose(view, render_size, render_camera, render_style, render_samples, render_beams)
        self._recipe = recipe
        self.copy, self._drone_mesh = copy, drone_mesh
        self.drones_per_env = recipe.drones_per_env
        self.lidars, self.cameras = recipe.lidars, recipe.cameras
        self.lidar = self.lidars[0] if self.lidars else None
        self.batch = Batch.from_recipe(recipe, worlds, routed.own_task, allow_files=True)
        if through is not None:
            betaflight.attach(self.batch)
        self._made_worlds: list[World] | None = getattr(self.batch, "worlds", None)  # None with a pool
        self._rows_per_env = self.drones_per_env if self.batch.spec.row == "drone" else 1
        self.num_envs = self.num_groups * self._rows_per_env
        episodes = recipe.episode.episodes if self.drones_per_env > 1 else "team"
        self._ends_rows, self._has_rests = episodes != "team", episodes == "last"
        self._task_calls, self._reward_terms = routed.calls, self.batch.spec.reward_terms
        if routed.calls is None:
            self.single_observation_space = observation_space(self.batch.spec)
            self.single_action_space = action_space(self.batch.spec)
        else:
            routed.calls.attach(self.batch)
            spec, adds = self.batch.spec, recipe.observed != ObservationConfig() or recipe.privileged
            self.single_observation_space = observation_space(spec) if adds else self.task.observation_space
            self.single_action_space = self.task.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

        self.render_mode = render_mode
        self.autoreset_mode = AUTORESET_MODES[recipe.episode.autoreset_mode]
        flown_hz = self.batch.clock.policy_hz / recipe.episode.frame_skip
        render_fps = max(1, round(flown_hz))  # one picture per step, at the speed of flight
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode, "render_fps": render_fps}
        self._seeded = False  # True once every env has a seed, and so an episode to continue
        self._view: View | None = None
        self.trail: Trail | None = None  # past positions of the drones, if the pictures show them
        if render_mode == "rgb_array":
            from flockstep.pictures import views  # what draws is not needed to fly

            overlay = self.task if isinstance(self.task, Task) else words.get("overlay", "")
            self._view, self.trail = views.make(shown, self.batch, self.cameras, overlay, drone_mesh)

    @classmethod
    def from_recipe(
        cls, recipe: Recipe | str, *, allow_files: bool = False, max_worlds: int = 10000, **keywords: Any
    ) -> DroneVectorEnv:
        """Make an env from a recipe, such as one that another program wrote as JSON.

        Parameters
        ----------
        recipe
            A `Recipe`, or its JSON text. It names your own task by the id that `register_task` registered in this
            process.
        allow_files
            Allow worlds and drone to be files outside the folder of bundled scenes.
        max_worlds
            What the worlds of the recipe may cost, in playgrounds: a forest counts as 30, an office, warehouse or city
            as 100, with moving objects as 200.
        **keywords
            Keywords of the env that a recipe lacks, such as ``copy`` and ``render_mode``; other keywords override the
            recipe.

        Raises
        ------
        ValueError
            The recipe is invalid, a path is not allowed, or an id is not registered.
        """
        recipe = Recipe.from_json(recipe) if isinstance(recipe, str) else recipe
        recipe.check_access(scenes.directory(), allow_files, max_worlds)
        return cls(**keywords_of(recipe, keywords))

    @property
    def num_rows(self) -> int:
        """Number of rows of actions, observations and rewards, the attribute `num_envs`."""
        return self.num_envs

    @property
    def recipe(self) -> Recipe:
        """A copy of the recipe from which the batch is built. Its worlds are empty if they were given as objects.

        If the env was made from a Gymnasium id, the recipe names your own task by this id, otherwise by its class.
        """
        recipe = Recipe.from_json(self._recipe.to_json())
        if isinstance(recipe.task, str) and self.spec is not None:
            recipe.task = self.spec.id
        return recipe

    def __getstate__(self) -> dict[str, Any]:
        """Return the arguments and a snapshot, so that a copy continues from here. Its pictures begin a new trail."""
        self._require_open()
        random = {"_np_random": self.np_random, "_np_random_seed": self.np_random_seed}  # draws a seed if there is none
        return {
            **random,
            "spec": self.spec,
            "arguments": {**self._arguments, **self._relit_worlds()},
            "snapshot": self.batch.snapshot() if self._seeded else None,
        }

    def _relit_worlds(self) -> dict[str, Any]:
        """Return the worlds as an argument if `Batch.set_light` has changed one of them."""
        if self._made_worlds is None or all(map(operator.is_, self.batch.worlds, self._made_worlds)):
            return {}
        return {"worlds": self.batch.worlds}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the env from its arguments and restore the snapshot."""
        arguments, snapshot = state.pop("arguments"), state.pop("snapshot")
        self.__init__(**arguments)  # type: ignore[misc] # unpickling does not call __init__
        self.spec = state.pop("spec")
        self.__dict__.update(state)
        if snapshot is not None:
            self.restore(snapshot)

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin new episodes.

        Parameters
        ----------
        seed
            One number s: env i gets the seed s + i. A sequence of E numbers: env i gets seed[i]. None: each env begins
            the next episode of its current seed; the first time, seeds are drawn from `np_random`.
        options
            ``{"reset_mask": mask}`` with a bool array, one flag per row, resets the envs whose flag is True. The drones
            of an env begin together, so a mask that selects only some of them is rejected. The dict is not changed.
            Without a seed, ``episodes="each"`` and ``"last"`` accept such masks. With ``"each"`` exactly these drones
            begin their next episodes, and their envs go on. With ``"last"`` the mask of the rows that have just ended
            is right: the env begins its next episode once all have ended.

        Returns
        -------
        observation, infos
            Values of all envs, including those that were not reset; infos is empty.
        """
        mask = stepping.reset(self, seed, options)
        if self.closed:
            raise ClosedError("the task closed this env during reset(): close it after reset() has returned")
        self._begun(mask)
        return stepping.returned(self, self.observation()), {}

    def step(self, actions: npt.ArrayLike) -> tuple[Observation, Array, BoolArray, BoolArray, dict[str, Any]]:
        """Fly one step in every env.

        Parameters
        ----------
        actions
            (N,) integers, or (N, k) floats in [-1, 1], according to `action_space`.

        Returns
        -------
        observation, reward, terminated, truncated, infos
            The observation is an array (N, ...) or a dict of such arrays. The reward is (N,) float32, and both flags
            are (N,) bool. The class documents the infos.

        Raises
        ------
        ValueError
            Actions have a wrong shape or dtype, or are not finite; nothing has changed.
        gymnasium.error.ResetNeeded
            `step` was called before the first `reset`.
        """
        stepping.step(self, actions)
        self._flown(actions)
        return stepping.results(self)

    def render(
        self, indices: int | Sequence[int] | npt.NDArray[np.integer[Any]] | None = None
    ) -> tuple[npt.NDArray[np.uint8], ...] | None:
        """Return pictures, (height, width, 3) uint8 each, or None, without a render mode with a warning as Gymnasium's.

        Parameters
        ----------
        indices
            Envs to show, in this order. Default: all. A picture takes milliseconds, so choose a few of many envs.

        Raises
        ------
        ValueError
            An index is not an integer from 0 to N - 1.
        """
        self._require_open()
        if self._view is None and self.render_mode is None:
            gymnasium.logger.warn("render() returns None: for pictures, make the env with render_mode='rgb_array'")
        if self._view is None:
            return None
        chosen = range(self.num_envs) if indices is None else selected(indices, self.num_envs)
        drones_per_row = self.drones_per_env // self._rows_per_env
        return tuple(self._view.frame(i * drones_per_row) for i in chosen)

    def snapshot(self) -> bytes:
        """Return everything that affects later steps, including the state of a `Task`."""
        self._require_open()
        if not self._seeded:
            raise ResetNeeded("call reset before snapshot")
        return self.batch.snapshot()

    def observation(self) -> Observation:
        """Return views of the current observations.

        They stay valid during the next step or reset, and the one after that overwrites them.
        """
        observation: Observation = self.batch.observation
        return observation

    def scaled_reward(self) -> npt.NDArray[np.float32]:
        """Return the last step's rewards (N,) times ``reward_scale``.

        If the scale is 1, they are a view, which is valid as long as those of `observation`.
        """
        return stepping.scaled_reward(self)

    def episode_infos(self, indices: npt.NDArray[np.intp] | None = None) -> dict[str, Any]:
        """Return the episode statistics of the envs ``indices`` (default: all) as a dict of new arrays.

        Unfinished episodes have their values so far.
        """
        task_infos = {} if self._task_calls is None else self._task_calls.infos()
        return stepping.episode_infos(self, indices, task_infos)

    def _last_infos(self, ended: npt.NDArray[np.intp]) -> dict[str, Any]:
        return self.episode_infos(ended)

    def _finished(self) -> BoolArray | None:
        return ~self.batch.flying if self._has_rests else None

    def _waiting(self) -> BoolArray:
        """Return a mask of the rows that will not fly in the next step, as `flockstep.PPO` needs it."""
        self._require_open()
        return self.batch.waiting

    def final_observations(self, indices: npt.NDArray[np.intp]) -> list[Observation]:
        """Return the last observation of the episode that ended in each of the envs ``indices``, as new arrays."""
        return stepping.final_observations(self, indices)

    def restore(self, blob: bytes) -> Observation:
        """Go back to a snapshot and return its observation (N, ...).

        Raises
        ------
        ValueError
            The snapshot belongs to an env with another configuration; nothing has changed.
        """
        self._require_open()
        self.batch.restore(blob)
        self._seeded = True
        self._begun(opens=False)  # copies, too, are restored
        return stepping.returned(self, self.observation())

    def close_extras(self, **kwargs: Any) -> None:
        """Release the batch. Arrays returned with ``copy=False`` stay valid."""
        if self._live is not None:
            self._live.close()
        self._seeded = False
        self._view = self.trail = None
        self.__dict__.pop("batch", None)

    def _require_open(self) -> None:
        stepping.require_open(self)


OWN_KEYWORDS = show_keywords(DroneVectorEnv)
