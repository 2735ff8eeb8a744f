"""The Gymnasium vector environment over a `Batch`."""

from __future__ import annotations

import inspect
import operator
from collections.abc import Mapping, Sequence
from copy import copy as copied
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, TypeVar

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from flockstep import scenes, serialization, stepping
from flockstep._core import (
    Batch,
    BodyConfig,
    CameraConfig,
    ClockConfig,
    DodgeConfig,
    DroneModel,
    DynamicsConfig,
    EpisodeConfig,
    FormationConfig,
    HoverConfig,
    ImuConfig,
    LidarConfig,
    Light,
    NativeTask,
    NavigationConfig,
    PoseSensorConfig,
    PythonTask,
    RaceConfig,
    Recipe,
    SwapConfig,
    TrackConfig,
    World,
    _unexpected_keyword,
    engine_tasks,
    task_defaults,
)
from flockstep.drone_mesh import DroneMesh
from flockstep.errors import ClosedError
from flockstep.nearest_name import did_you_mean
from flockstep.pictures import views
from flockstep.pictures.flight_overlay import FlightOverlay, GoalOverlay, PlaceOverlay, RaceOverlay
from flockstep.pictures.frames import selected
from flockstep.stepping import AUTORESET_MODES, Array, BoolArray, Observation
from flockstep.task import DroneLike, Task, TaskCalls, native_task, settable_names
from flockstep.task_spaces import action_space, observation_space
from flockstep.world_pool import WorldPool

if TYPE_CHECKING:
    from typing import Literal

    from typing_extensions import TypedDict, Unpack

    from flockstep._core import ColorRange, NavigationReward, WindConfig
    from flockstep.pictures.drawing import Overlay
    from flockstep.pictures.trail import Trail

    class Fields(TypedDict, total=False):
        """Fields of the configurations that are keywords of the env."""

        # fields of EpisodeConfig, ClockConfig, DynamicsConfig, tasks
        episodes: Literal["team", "each", "last"]
        frame_skip: int
        stagger_first_episode: bool
        random_world: bool
        policy_hz: float
        physics_hz: float | None
        controller_hz: float | None
        motion: Literal["kinematic", "rotors"]
        control: Literal[
            "pose",
            "rotor_speeds",
            "rotor_thrusts",
            "body_rates",
            "attitude",
            "acceleration",
            "velocity",
            "heading_velocity",
            "position",
        ]
        integrator: Literal["automatic", "midpoint", "rk4"]
        on_contact: Literal["terminate", "stop", "bounce"]
        restitution: float
        friction: float
        rotor_lag: bool
        rotor_drag: bool
        body_drag: bool
        gyroscopic: bool
        ground_effect: bool
        downwash: bool
        wind: WindConfig
        max_speed_mps: float
        max_acceleration_mps2: float
        max_tilt_deg: float
        max_rate_dps: float
        max_yaw_rate_dps: float
        action: Literal["discrete", "displacement", "displacement_yaw", "discrete_forward"]
        step_m: float
        yaw_step_deg: float
        reward: NavigationReward
        random_start: bool
        color: ColorRange
        start_offset_m: float
        start_tilt_deg: float
        start_speed_mps: float
        start_rate_dps: float
        max_distance_m: float
        hold_m: float
        hold_s: float
        near_weight: float
        hold_weight: float
        speed_weight: float
        spin_weight: float
        change_weight: float
        crash_weight: float
        path: Literal["figure8", "random"]
        yaw: Literal["fixed", "along"]
        size_m: float
        speed_mps: float
        points: int
        ahead_s: float
        close_m: float
        close_weight: float
        yaw_weight: float
        laps: int
        gates_ahead: int
        max_thrust_to_weight: float
        start: Literal["between", "gate"]
        start_yaw_deg: float
        miss_m: float
        observation_scale: float
        speed_cap_mps: Sequence[float]
        cap_rise_mps: float
        cap_episodes: int
        cap_success: float
        progress_weight: float
        gate_weight: float
        rates_weight: float
        goal_distance_m: float
        goal_radius_m: float
        near_m: float
        goal_weight: float
        time_weight: float
        radius_m: float
        spacing_m: float
        jitter_m: float
        neighbors: int
        sight_m: float
        shape: Literal["line", "column", "v", "circle"]
        route: Literal["loop", "path"]
        loop_radius_m: float
        leader_speed_mps: float
        place_weight: float
        # end of fields


if TYPE_CHECKING:
    _TaskConfig = NavigationConfig | HoverConfig | TrackConfig | RaceConfig | DodgeConfig | SwapConfig | FormationConfig
_Sensor = TypeVar("_Sensor")
_Config = TypeVar("_Config")

#: Configurations whose fields are keywords of the env: those for every task, then those for one task each.
_CONFIGS_OF_ALL: tuple[Any, ...] = (EpisodeConfig, ClockConfig, DynamicsConfig)
_CONFIGS_OF_TASKS: dict[Any, str] = {config: name for name, config in engine_tasks.items()}
_TASK_CONFIGS: tuple[Any, ...] = tuple(engine_tasks.values())


class DroneVectorEnv(VectorEnv[Observation, Array, Array]):
    """Many drone envs stepped by one call, with a task of the engine or your own `Task`.

    The built-in tasks are navigation, which is the default, hovering (`HoverConfig`, ``flockstep/Hover-v0``), path
    tracking (`TrackConfig`, ``flockstep/Track-v0``), racing (`RaceConfig`, ``flockstep/Race-v0``), dodging bodies
    (`DodgeConfig`, ``flockstep/Dodge-v0``), and two for several drones: exchanging places (`SwapConfig`,
    ``flockstep/Swap-v0``) and flying in formation (`FormationConfig`, ``flockstep/Formation-v0``). Hover, Track and
    Race simulate the rotors. The navigation tasks differ in
    their observations and therefore in their defaults:

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
        A `NavigationConfig`, `HoverConfig`, `TrackConfig`, `RaceConfig`, `DodgeConfig`, `SwapConfig` or
        `FormationConfig`, your own `Task` (an object, or its class), or a `NativeTask` in C++. Default: navigation, by
        keywords. With `gymnasium.make_vec`, the time limit registered for the env's id applies, unless
        ``max_episode_steps`` is also given.
    observation
        Observation of the navigation task: ``"goal"``, ``"blob"`` or ``"pixels"``.
    lidar
        One `LidarConfig` or a sequence; navigation observes the first. Default: 35 beams over 270 degrees with a range
        of 3 m; for camera tasks, 20 beams over 180 degrees; a `Task` declares its own.
    camera
        One `CameraConfig` or a sequence; a camera task observes the first. Default: 64 x 48 pixels over 90 degrees,
        facing forward, for camera tasks, otherwise none; a `Task` declares its own.
    camera_backend
        ``"raycast"``, which is bitwise reproducible, ``"gl"``, or ``"auto"`` for the faster of the two.
    tracer
        ``"auto"``, ``"tiles"``, ``"slices"`` or ``"embree"``: method of ray casting against triangles; see `Batch`.
    pose_sensor
        Default: an exact pose.
    imu
        One `ImuConfig` or a sequence. Default: none.
    bodies
        One `BodyConfig` or a sequence: solids that move in every env; see `Bodies`. Default: none; a `Task` declares
        its own.
    max_bodies
        Number of slots for bodies in each env, B; free slots are for ``batch.bodies.spawn``. Default: as many as an
        episode begins with.
    lights
        One `Light` or a sequence, of which each episode of an env draws one instead of its world's. Default: the lights
        of the worlds; a `Task` declares its own. `Batch.set_light` sets lights at run time.
    drone
        A `DroneModel`, the name of a bundled airframe, or the path of a JSON file. Default: the task's drone, which for
        navigation is the 650-class quadrotor.
    max_episode_steps
        Truncate episodes after this many flown steps; 0 means never. Default: the task's limit, which for navigation is
        3000.
    autoreset_mode
        ``"next_step"``, ``"same_step"``, ``"disabled"``, or the member of `gymnasium.vector.AutoresetMode`.
    copy
        True: every returned array is new. False: observation, reward and flags are views of two alternating buffers; a
        view stays valid during the next step or reset, and the one after that overwrites it.
    num_threads
        Number of threads; 0 means one per physical core that this process may use. Results do not depend on it.
    reward_scale
        `step` returns the rewards multiplied by this, for learning algorithms that need small rewards. The episode
        return in the infos and ``batch.reward_terms`` are not scaled.
    render_mode
        None, or ``"rgb_array"``: a picture of each env. For a window, wrap the env in
        `gymnasium.wrappers.vector.HumanRendering`.
    render_view
        ``"top"``: the whole world from above, cut off above the drone, with LiDAR beams. ``"camera"``: the last frame
        of the drone's own camera; black if it is stale. ``"third_person"``: from behind and above the drone, with LiDAR
        beams, camera frustums and the trail. ``"fleet"``: the same, with the other drones of its world. Two points (m,
        world frame), such as ``((0, -8, 5), (4, 4, 1))``: the same as ``"fleet"``, seen from the first point towards
        the second. Every view shows the lines of `Batch.set_move_line_visible`. Default: ``"third_person"`` for
        `HoverConfig`, `TrackConfig` and `RaceConfig`, because it shows attitude and height, otherwise ``"top"``.
    render_size
        Width and height of the pictures in pixels. Default: 256 x 256 for ``"top"``, the camera's own size for
        ``"camera"``, otherwise 640 x 480. With ``"camera"``, frames are scaled if the size is not the camera's own.
    render_camera
        The name of the camera that ``render_view="camera"`` shows. Default: the first.
    drones_per_env
        Number of drones in each env, M. They share a world; ``episodes`` says whether they share their episodes, and
        ``meet`` whether they see and touch each other. Gymnasium expects one env per row, so the attribute `num_envs`
        is N = E M, whereas the argument ``num_envs`` is E. Drone m of env i has row i M + m. Default: 1; for the swap
        task 8, for the formation task 4.
    meet
        How the drones of an env interact. ``"never"``: not at all. ``"seen"``: their LiDARs detect the hulls of the
        others, and their cameras see the others. ``"touched"``: they hit each other with their hulls. ``"both"``: both.
        Default: ``"never"``; for the swap task ``"touched"``, for the formation task ``"both"``; a `Task` declares its
        own.
    drone_mesh
        A `DroneMesh`, or a `World` of triangles, that shows the drones in perspective views, from behind and from a
        fixed point, and to the cameras of other drones, if these see each other. Default: in views a shape made from
        the drone's model, arms and rotors if it has rotors, otherwise its hull; for cameras its hull. LiDARs and
        collisions always use the hull of ``drone``.
    **fields
        Fields of configurations. The task sets their defaults; each configuration documents its fields.

        For every task, from `EpisodeConfig`: ``episodes``, ``frame_skip``, ``stagger_first_episode``, ``random_world``.
        From `ClockConfig`: ``policy_hz``, ``physics_hz``, ``controller_hz``. From `DynamicsConfig`: ``motion``,
        ``control``, ``integrator``, ``on_contact``, ``restitution``, ``friction``, ``rotor_lag``, ``rotor_drag``,
        ``body_drag``, ``gyroscopic``, ``ground_effect``, ``downwash``, ``wind``, ``max_speed_mps``,
        ``max_acceleration_mps2``, ``max_tilt_deg``, ``max_rate_dps``, ``max_yaw_rate_dps``.

        For the navigation task, from `NavigationConfig`: ``action`` (``"discrete"``, ``"displacement"``,
        ``"displacement_yaw"``, or ``"discrete_forward"``, the default for camera tasks), ``reward`` (for camera tasks,
        the default also ends the episode when the drone overshoots the goal), ``step_m``, ``yaw_step_deg``,
        ``random_start``, ``color``.

        For the hover task, from `HoverConfig`: ``start_offset_m``, ``start_tilt_deg``, ``start_speed_mps``,
        ``start_rate_dps``, ``max_distance_m``, ``hold_m``, ``hold_s``, ``near_weight``, ``hold_weight``,
        ``speed_weight``, ``spin_weight``, ``change_weight``, ``crash_weight``.

        For the track task, from `TrackConfig`: ``path``, ``yaw``, ``size_m``, ``speed_mps``, ``start_offset_m``,
        ``points``, ``ahead_s``, ``max_distance_m``, ``close_m``, ``near_weight``, ``close_weight``, ``yaw_weight``,
        ``spin_weight``, ``change_weight``, ``crash_weight``.

        For the race task, from `RaceConfig`: ``laps``, ``gates_ahead``, ``max_thrust_to_weight``, ``start``,
        ``start_offset_m``, ``start_yaw_deg``, ``start_tilt_deg``, ``start_speed_mps``, ``miss_m``, ``max_distance_m``,
        ``observation_scale``, ``speed_cap_mps``, ``cap_rise_mps``, ``cap_episodes``, ``cap_success``,
        ``progress_weight``, ``gate_weight``, ``rates_weight``, ``change_weight``, ``crash_weight``.

        For the dodge task, from `DodgeConfig`: ``step_m``, ``goal_distance_m``, ``goal_radius_m``, ``near_m``,
        ``progress_weight``, ``goal_weight``, ``crash_weight``, ``near_weight``, ``time_weight``.

        For the swap task, from `SwapConfig`: ``step_m``, ``radius_m``, ``spacing_m``, ``jitter_m``, ``goal_radius_m``,
        ``neighbors``, ``sight_m``, ``near_m``, ``progress_weight``, ``goal_weight``, ``crash_weight``, ``near_weight``,
        ``time_weight``.

        For the formation task, from `FormationConfig`: ``shape``, ``spacing_m``, ``route``, ``loop_radius_m``,
        ``leader_speed_mps``, ``step_m``, ``jitter_m``, ``neighbors``, ``sight_m``, ``max_distance_m``,
        ``close_m``, ``near_m``, ``place_weight``, ``crash_weight``, ``near_weight``, ``change_weight``.

    Attributes
    ----------
    num_envs
        Number of rows of actions, observations and rewards: N = E M drones, or E envs for a task whose ``row_kind`` is
        ``"env"``. Gymnasium and trainers count these as envs. `num_rows` is the same.
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
    observation_space, action_space
        Spaces of all envs.
    single_observation_space, single_action_space
        Spaces of one env.
    autoreset_mode
        A member of `gymnasium.vector.AutoresetMode`.
    copy
        True if returned arrays are new.
    reward_scale
        Factor of the returned rewards.
    render_mode
        None or ``"rgb_array"``.
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
    is reset. With ``episodes="last"``, ``resting`` is a mask of the rows that did not fly in the step: ignore them when
    learning. ``episode_end`` is the reason for the end, a value of `EpisodeEnd`. An episode ends with ``bad_state`` if
    a target, a reward or an observation was not finite; ``batch.bad_states`` counts these episodes.

    Raises
    ------
    ValueError
        A value is out of range; the message names it.
    TypeError
        A keyword does not exist, or belongs to another task.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 10,  # pictures per second at the speed of the flight; each env sets its own
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    spec: Any = serialization.PlainSpec()

    def __init__(
        self,
        num_envs: int = 1,
        *,
        worlds: scenes.WorldsLike | WorldPool | None = None,
        task: Task | type[Task] | NativeTask | _TaskConfig | None = None,
        observation: str = "goal",
        lidar: LidarConfig | Sequence[LidarConfig] | None = None,
        camera: CameraConfig | Sequence[CameraConfig] | None = None,
        camera_backend: str = "raycast",
        tracer: str = "auto",
        pose_sensor: PoseSensorConfig | None = None,
        imu: ImuConfig | Sequence[ImuConfig] | None = None,
        bodies: BodyConfig | Sequence[BodyConfig] | None = None,
        max_bodies: int | None = None,
        lights: Light | Sequence[Light] | None = None,
        drone: DroneLike | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = "next_step",
        copy: bool = True,
        num_threads: int = 0,
        reward_scale: float = 1.0,
        render_mode: str | None = None,
        render_view: str | npt.ArrayLike | None = None,
        render_size: tuple[int, int] | None = None,
        render_camera: str | None = None,
        drone_mesh: DroneMesh | World | None = None,
        drones_per_env: int | None = None,
        meet: Literal["never", "seen", "touched", "both"] | None = None,
        **fields: Unpack[Fields],
    ) -> None:
        given = {name: value for name, value in locals().items() if name not in ("self", "fields")}
        self._arguments: dict[str, Any] = {**given, **fields}  # for copies and pickles
        worlds, task, lidar, camera, pose_sensor, imu, bodies, lights, drone, drone_mesh = (
            serialization.from_plain(value)
            for value in (worlds, task, lidar, camera, pose_sensor, imu, bodies, lights, drone, drone_mesh)
        )
        own_fields = {name: serialization.from_plain(value) for name, value in fields.items()}
        require_render_mode(render_mode, "gymnasium.wrappers.vector.HumanRendering")
        is_flight = isinstance(task, (HoverConfig, TrackConfig))  # the overlay draws the observed target of these two
        if render_view is None:
            render_view = "third_person" if is_flight or isinstance(task, RaceConfig) else "top"
        shown = views.choose(render_view, render_size, render_camera)
        if not isinstance(drone_mesh, (DroneMesh, World, type(None))):
            raise TypeError(f"drone_mesh: expected a flockstep.DroneMesh, a World or None, got {drone_mesh!r}")
        self.reward_scale = stepping.require_reward_scale(reward_scale)
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode = render_mode
        self.num_groups = _count(num_envs)
        drones_per_env = None if drones_per_env is None else _members(drones_per_env)
        self.copy = copy
        self.task = task = task() if isinstance(task, type) else task
        if isinstance(task, Task):
            _refuse_keywords_on(task)

        mode = next(name for name, member in AUTORESET_MODES.items() if member is self.autoreset_mode)
        episode = {"autoreset_mode": mode, "max_episode_steps": max_episode_steps}
        recipe, self.task, own_task, calls = _recipe_for(task, observation, episode, _by_config(own_fields, task))
        _set_given(recipe, num_envs=self.num_groups, drones_per_env=drones_per_env, num_threads=num_threads)
        self.drones_per_env = recipe.drones_per_env
        _set_given(recipe, camera_backend=camera_backend, tracer=tracer, pose_sensor=pose_sensor, drone=_drone(drone))
        if lidar is not None:
            recipe.lidars = _listed(lidar, LidarConfig, "lidar")
        if camera is not None:
            recipe.cameras = _listed(camera, CameraConfig, "camera")
        recipe.imus = _listed(imu, ImuConfig, "imu")
        if bodies is not None:
            recipe.bodies = _listed(bodies, BodyConfig, "bodies")
        _set_given(recipe, max_bodies=max_bodies, meet=meet)
        if recipe.meet in ("seen", "both") and drone_mesh is not None:
            recipe.drone_mesh = drone_mesh.world() if isinstance(drone_mesh, DroneMesh) else drone_mesh
        if lights is not None:
            recipe.lights = _listed(lights, Light, "lights")
        if worlds is None:
            worlds = self.task.worlds if isinstance(self.task, Task) else recipe.worlds
            if worlds is None:
                name = type(self.task).__name__
                raise ValueError(f"{name} declares no worlds: set {name}.worlds = 'train', or pass worlds=")
        recipe.worlds = _names(worlds)
        self._recipe = recipe
        self.lidars, self.cameras = recipe.lidars, recipe.cameras
        self.lidar = self.lidars[0] if self.lidars else None
        self.batch = Batch.from_recipe(recipe, worlds, own_task, allow_files=True)
        self._made_worlds: list[World] | None = getattr(self.batch, "worlds", None)  # None with a pool
        self._rows_per_env = self.drones_per_env if self.batch.spec.row == "drone" else 1
        self.num_envs = self.num_groups * self._rows_per_env
        episodes = recipe.episode.episodes if self.drones_per_env > 1 else "team"
        self._ends_rows, self._has_rests = episodes != "team", episodes == "last"
        flown_hz = self.batch.clock.policy_hz / recipe.episode.frame_skip
        self.metadata["render_fps"] = max(1, round(flown_hz))  # one picture per step, at the speed of flight
        self._task_calls = calls
        self._reward_terms = self.batch.spec.reward_terms
        if calls is None:
            self.single_observation_space = observation_space(self.batch.spec)
            self.single_action_space = action_space(self.batch.spec)
        else:
            assert isinstance(task, Task)
            calls.attach(self.batch)
            self.single_observation_space, self.single_action_space = task.observation_space, task.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

        self._seeded = False  # True once every env has a seed, and so an episode to continue
        self._view: views.View | None = None
        self.trail: Trail | None = None  # past positions of the drones, if the pictures show them
        if render_mode is not None:
            overlay: Overlay | None = task if isinstance(task, Task) else None
            if is_flight:
                overlay = FlightOverlay(height=shown.view != "top")
            elif isinstance(task, RaceConfig):
                overlay = RaceOverlay()
            elif isinstance(task, (DodgeConfig, SwapConfig)):
                overlay = GoalOverlay()
            elif isinstance(task, FormationConfig):
                overlay = PlaceOverlay()
            mesh = DroneMesh._of_world(drone_mesh) if isinstance(drone_mesh, World) else drone_mesh
            self._view, self.trail = views.make(shown, self.batch, self.cameras, overlay, mesh)

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
        task = recipe.task
        given: dict[str, Any] = {"task": task} if isinstance(task, _TASK_CONFIGS) else {}
        if isinstance(task, str):
            given = {"task": _registered(task)}
        for config in (recipe.episode, recipe.clock, recipe.dynamics):
            given |= {name: getattr(config, name) for name in config.__match_args__}
        given |= {
            name: getattr(recipe, name)
            for name in (
                "num_envs",
                "drones_per_env",
                "num_threads",
                "worlds",
                "drone",
                "pose_sensor",
                "camera_backend",
            )
        }
        given |= {"lidar": recipe.lidars, "camera": recipe.cameras, "imu": recipe.imus, "tracer": recipe.tracer}
        given |= {"bodies": recipe.bodies, "max_bodies": recipe.max_bodies, "lights": recipe.lights}
        given |= {"meet": recipe.meet, "drone_mesh": recipe.drone_mesh}
        return cls(**{**given, **keywords})

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
        if self.trail is not None:
            self.trail.record(True if mask is None else np.repeat(mask, self.batch.num_drones // len(mask)))
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
        if self.trail is not None:
            self.trail.record()
        return stepping.results(self)

    def render(
        self, indices: int | Sequence[int] | npt.NDArray[np.integer[Any]] | None = None
    ) -> tuple[npt.NDArray[np.uint8], ...] | None:
        """Return pictures, (height, width, 3) uint8 each; without a render mode None, with a warning as Gymnasium's.

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
        if self._view is None:
            gymnasium.logger.warn("render() returns None: for pictures, make the env with render_mode='rgb_array'")
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

    def _resting(self) -> BoolArray | None:
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
        if self.trail is not None:
            self.trail.record(True)
        return stepping.returned(self, self.observation())

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of this env or its `Task` once, or read an attribute, and return the result for each env."""
        value = getattr(self._owner_of(name), name)
        return self._per_env(value(*args, **kwargs) if callable(value) else value)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of this env or its `Task` for each env: its rows if it has N rows, otherwise N copies."""
        return self._per_env(getattr(self._owner_of(name), name))

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of this env, or of its `Task` if only the task has it. All drones share it.

        Raises
        ------
        ValueError
            A list or tuple does not hold the same value N times.
        AttributeError
            Neither has the attribute, or it is only read when an env is made, such as a task's ``reward_terms``.
        """
        if isinstance(values, (list, tuple)):
            if len(values) != self.num_envs or any(value != values[0] for value in values):
                raise ValueError(f"{name}: expected one value, or {self.num_envs} equal values: the envs share it")
            values = values[0]
        owner = self._owner_of(name)
        settable = ["reward_scale"]
        if isinstance(self.task, Task):
            settable += sorted(settable_names(self.task))
        if not hasattr(owner, name) or (owner is self.task and name not in settable):
            expected = f"the name of an attribute that can be set ({', '.join(settable)})"
            raise AttributeError(f"set_attr: expected {expected}, got {name!r}{did_you_mean(name, settable)}")
        setattr(owner, name, values)

    def close_extras(self, **kwargs: Any) -> None:
        """Release the batch. Arrays returned with ``copy=False`` stay valid."""
        self._seeded = False
        self._view = self.trail = None
        self.__dict__.pop("batch", None)

    def _owner_of(self, name: str) -> Any:
        """Return the task if only it has the attribute, otherwise this env."""
        is_of_task = not hasattr(self, name) and isinstance(self.task, Task) and hasattr(self.task, name)
        return self.task if is_of_task else self

    def _per_env(self, value: Any) -> tuple[Any, ...]:
        if isinstance(value, (np.ndarray, list, tuple)) and len(value) == self.num_envs:
            return tuple(value)
        return (value,) * self.num_envs

    def _require_open(self) -> None:
        stepping.require_open(self)


def _recipe_for(
    task: Any, observation: str, episode: dict[str, Any], chosen: dict[type, dict[str, Any]]
) -> tuple[Recipe, Any, NativeTask | PythonTask | None, TaskCalls | None]:
    """Return the recipe with all chosen fields, the task, the object that `Batch` takes for it, and its `TaskCalls`.

    The last two are None for tasks of the engine, which a recipe describes completely.
    """
    own_task: NativeTask | PythonTask | None = None
    calls: TaskCalls | None = None
    if task is not None and observation != "goal":
        if isinstance(task, NavigationConfig):
            raise TypeError("observation: the NavigationConfig has its own: set NavigationConfig.observation")
        raise TypeError("observation: a keyword of the navigation task, but another task is given")
    if task is None:
        recipe = Recipe(_changed(NavigationConfig.observing(observation), chosen.get(NavigationConfig)))
    elif isinstance(task, _TASK_CONFIGS):
        kind: Any = type(task)
        task = kind(**{name: getattr(task, name) for name in kind.__match_args__} | chosen.get(kind, {}))
        recipe = Recipe(task)
    elif isinstance(task, Task):
        if episode["max_episode_steps"] is not None:
            task.max_episode_steps = episode["max_episode_steps"]
        own_task, calls = native_task(task)
        episode = {**episode, "frame_skip": task.frame_skip, "random_world": task.random_world}
        episode["episodes"] = task.episodes
        recipe = Recipe(f"{type(task).__module__}/{type(task).__qualname__}")
        _set_given(recipe, drone=_drone(task.drone), dynamics=task.dynamics, clock=task.clock)
        recipe.lidars = _listed(task.lidar, LidarConfig, "lidar")
        recipe.cameras = _listed(task.camera, CameraConfig, "camera")
        recipe.bodies = _listed(task.bodies, BodyConfig, "bodies")
        recipe.max_bodies = task.max_bodies
        recipe.meet = task.meet
        recipe.lights = _listed(task.lights, Light, "lights")
    elif isinstance(task, NativeTask):
        own_task = task
        recipe = Recipe(f"library/{task.path}")
        defaults = task_defaults(task)
        recipe.worlds = [defaults["worlds"]]
        names = ("drone", "lidars", "cameras", "dynamics", "clock", "drones_per_env", "meet")
        _set_given(recipe, **{name: defaults[name] for name in names})
    else:
        kinds = ", ".join(config.__name__ for config in _TASK_CONFIGS)
        hint = ". gymnasium.make_vec makes an env of an id" if isinstance(task, str) else ""
        raise TypeError(f"task: expected a flockstep.Task, a NativeTask or one of {kinds}, got {task!r}{hint}")
    recipe.episode = EpisodeConfig(**episode | chosen.get(EpisodeConfig, {}))
    recipe.clock = _changed(recipe.clock, chosen.get(ClockConfig))
    recipe.dynamics = _changed(recipe.dynamics, chosen.get(DynamicsConfig))
    return recipe, task, own_task, calls


def _registered(env_id: str) -> Any:
    """Return the task that is registered with Gymnasium under an id."""
    spec = gymnasium.registry.get(env_id)
    if spec is None or "task" not in spec.kwargs:
        raise ValueError(
            f"task.name: expected an id registered by flockstep.register_task (import the module that registers it), "
            f"got {env_id!r}{did_you_mean(env_id, gymnasium.registry)}"
        )
    return serialization.from_plain(spec.kwargs["task"])


def _set_given(recipe: Recipe, **values: Any) -> None:
    """Set the fields of a recipe whose values are not None."""
    for name, value in values.items():
        if value is not None:
            setattr(recipe, name, value)


def _drone(drone: Any) -> DroneModel | str | None:
    """Return a drone in the form for a recipe."""
    if drone is None or isinstance(drone, DroneModel):
        return drone
    if isinstance(drone, (str, PathLike)):
        return fspath(drone)
    raise TypeError(f"drone: expected a flockstep.DroneModel, the name or path of one, or None, got {drone!r}")


def _names(worlds: Any) -> list[str]:
    """Return the names or paths of worlds; an empty list for worlds given as objects, which a recipe cannot name."""
    listed = [worlds] if isinstance(worlds, (str, PathLike)) else worlds
    are_names = isinstance(listed, Sequence) and all(isinstance(name, (str, PathLike)) for name in listed)
    return [fspath(name) for name in listed] if are_names else []


def _changed(config: _Config, fields: Mapping[str, Any] | None) -> _Config:
    """Return a copy of a configuration with some fields changed; the engine checks the fields together."""
    copy = copied(config)
    for name, value in (fields or {}).items():
        setattr(copy, name, value)
    return copy


def _by_config(fields: dict[str, Any], task: Any) -> dict[type, dict[str, Any]]:
    """Group the keywords by the configuration that has a field of this name.

    Raises
    ------
    TypeError
        A name is not a keyword, or it belongs to another task.
    """
    kind = NavigationConfig if task is None else type(task)
    configs = [*_CONFIGS_OF_ALL, *(config for config in _CONFIGS_OF_TASKS if config is kind)]
    chosen: dict[type, dict[str, Any]] = {}
    for name, value in fields.items():
        owner = next((config for config in configs if name in config.__match_args__), None)
        if owner is not None and name not in ("autoreset_mode", "max_episode_steps"):
            chosen.setdefault(owner, {})[name] = value
            continue
        others = [title for config, title in _CONFIGS_OF_TASKS.items() if name in config.__match_args__]
        if others and owner is None:
            *first, last = others
            tasks = f"{', '.join(first)} and {last} tasks" if first else f"{last} task"
            raise TypeError(f"{name}: a keyword of the {tasks}, but another task is given")
        known = [*inspect.signature(DroneVectorEnv).parameters, *(n for c in configs for n in c.__match_args__)]
        text = _unexpected_keyword("DroneVectorEnv.__init__", name, known)
        raise TypeError(f"{text}: pass it to reset(seed=...)" if name == "seed" else text)
    return chosen


def _refuse_keywords_on(task: Task) -> None:
    """Raise TypeError if a task's class sets a keyword of the env that envs do not read from tasks."""
    kind = type(task)
    config_of = dict.fromkeys(ClockConfig.__match_args__, "clock")
    config_of |= dict.fromkeys(DynamicsConfig.__match_args__, "dynamics")
    keywords = {*config_of, *EpisodeConfig.__match_args__, *inspect.signature(DroneVectorEnv).parameters, "cameras"}
    keywords -= {"self", "fields", "task", "observation", "copy"}  # useless on a class, or too common as names
    for name in sorted(name for name in keywords if not hasattr(Task, name)):
        value = inspect.getattr_static(kind, name, None)
        if value is None or callable(value) or hasattr(value, "__get__"):  # own methods and properties
            continue
        config = config_of.get(name)
        said: Any = None if config is None else getattr(getattr(task, config), name, None)
        if said is not None and np.array_equal(said, value):
            continue  # another name for the same value of the configuration
        advice = "give it to the env"
        if name == "cameras":
            advice = "write camera = ..., one or a sequence"
        elif config is not None:
            advice = f"write {config} = flockstep.{config.title()}Config({name}=...), or give it to the env"
        raise TypeError(f"{kind.__name__}.{name}: envs do not read it from a task: {advice}")


def _listed(given: Any, kind: type[_Sensor], name: str) -> list[_Sensor]:
    """Return copies of the given sensor configurations: none, one or several."""
    if given is None:
        return []
    configs = list(given) if isinstance(given, Sequence) and not isinstance(given, str) else [given]
    for config in configs:
        if not isinstance(config, kind):
            hint = ""
            if isinstance(config, dict):
                fields = ", ".join(f"{field}={value!r}" for field, value in config.items())
                hint = f": write flockstep.{kind.__name__}({fields})"
            raise TypeError(f"{name}: expected a flockstep.{kind.__name__} or a sequence of them, got {config!r}{hint}")
    return [copied(config) for config in configs]


def require_render_mode(mode: str | None, window: str) -> None:
    """Raise ValueError for an unknown render mode; for ``"human"`` name the wrapper that shows a window."""
    modes = DroneVectorEnv.metadata["render_modes"]
    if mode is None or mode in modes:
        return
    advice = f"; for a window, wrap an env with render_mode='rgb_array' in {window}" if mode == "human" else ""
    raise ValueError(f"render_mode: expected None or {', '.join(map(repr, modes))}, got {mode!r}{advice}")


def _count(num_envs: Any) -> int:
    if not isinstance(num_envs, (int, np.integer)) or isinstance(num_envs, bool) or num_envs < 1:
        advice = ""
        if isinstance(num_envs, str):
            advice = f"; for an env by its id, call gymnasium.make_vec({num_envs!r}, num_envs=...)"
        raise ValueError(f"num_envs: expected an integer >= 1, got {num_envs!r}{advice}")
    return int(num_envs)


def _members(drones_per_env: Any) -> int:
    if not isinstance(drones_per_env, (int, np.integer)) or isinstance(drones_per_env, bool) or drones_per_env < 1:
        raise ValueError(f"drones_per_env: expected an integer >= 1, got {drones_per_env!r}")
    return int(drones_per_env)


def _autoreset_mode(mode: str | AutoresetMode) -> AutoresetMode:
    if mode in tuple(AutoresetMode) or mode in tuple(member.value for member in AutoresetMode):
        return AutoresetMode(mode)  # Gymnasium's own members and their values, such as "SameStep"
    if mode not in AUTORESET_MODES:
        hint = did_you_mean(mode, AUTORESET_MODES)
        raise ValueError(
            f"autoreset_mode: expected {', '.join(map(repr, AUTORESET_MODES))} or an AutoresetMode, got {mode!r}{hint}"
        )
    return AUTORESET_MODES[mode]
