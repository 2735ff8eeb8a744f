"""The native module.

SI units. World frame: right-handed, z up. Body frame: x forward, y left, z up. Quaternions are ``(w, x, y, z)``, body
to world. Arrays are float32 unless their entry names another type. ``N`` is the number of drones of a batch.

Bad input raises `ValueError` {config.hpp: naming the field ... actual one}, before anything changes.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias, final

import numpy as np
import numpy.typing as npt

from flockstep.drone_mesh import DroneMesh
from flockstep.scenes import WorldLike, WorldsLike
from flockstep.world_pool import WorldPool

_F32: TypeAlias = npt.NDArray[np.float32]
_F64: TypeAlias = npt.NDArray[np.float64]
_I32: TypeAlias = npt.NDArray[np.int32]
_I64: TypeAlias = npt.NDArray[np.int64]
_U8: TypeAlias = npt.NDArray[np.uint8]
_U16: TypeAlias = npt.NDArray[np.uint16]
_Bool: TypeAlias = npt.NDArray[np.bool_]
_DroneLike: TypeAlias = DroneModel | str | PathLike[str]
# tasks
_MaybeNone: TypeAlias = Any  # None only if the world lacks the marker; Any spares callers a check

__version__: str
embree_version: str
"""Version of the Embree library that this module was built with, such as ``"4.3.0"``."""
simd_target: str
"""Instruction set that tracing uses on this machine, such as ``"AVX2"``."""
scene_sets: dict[str, tuple[str, ...]]
"""Names that stand for several scenes, with their scenes."""
scene_suffixes: tuple[str, ...]
"""Suffixes of the files that `World.load` reads, such as ``".json"``."""
batch_keywords: dict[str, str]
"""Fields of a `Recipe` by the keywords that set them, such as ``"lidar"`` for ``"lidars"``."""
parameter_names: tuple[str, ...]
"""Names of the columns of `Batch.params`, such as ``"mass_scale"`` or ``"stretch[2]"``."""
engine_tasks: dict[str, Any]
"""Configurations of the engine's tasks, by their names in recipes."""
generated_scenes: tuple[str, ...]
"""Names of the scenes that are generated instead of loaded."""
scene_generators: tuple[str, ...]
"""Names of the generators, which stand before ``/seed-7`` in the name of a scene."""
_renamed: dict[str, str]
"""Names that were renamed, with the present ones."""

# configurations

@final
class RangeErrors:
    """How the ranges of a LiDAR err: {range_errors.hpp: They apply in ... readings}."""

    # fields of RangeErrors

@final
class LidarConfig:
    """{lidar.hpp: A scanning LiDAR}: {lidar.hpp: a grid of ... beams}, or a beam pattern."""

    # fields of LidarConfig
    @property
    def shape(self) -> tuple[int, int]:
        """Shape (channels, beams) of one scan."""

    @staticmethod
    def preset(product: str) -> LidarConfig:
        """Return the LiDAR of a product, with its errors, named like it.

        Parameters
        ----------
        product
            Its name, such as ``"vlp-16"``.

        Raises
        ------
        ValueError
            There is none of this name. The message lists all.
        """

@final
class DepthErrors:
    """How the depth images of a camera err: {depth_errors.hpp: They apply in ... and image}."""

    # fields of DepthErrors

@final
class ColorErrors:
    """How the colours of a camera err: {color_errors.hpp: in linear light ... 12 bits}.

    {color_errors.hpp: They apply in ... channel and image}.
    """

    # fields of ColorErrors

@final
class EventPixels:
    """{event_pixels.hpp: The pixels of ... reference follows}."""

    # fields of EventPixels

@final
class CameraConfig:
    """A pinhole or fisheye camera.

    {camera.hpp: Camera frame ... centre of the image}.
    """

    # fields of CameraConfig
    def __eq__(self, other: object, /) -> bool: ...
    @property
    def fx(self) -> float:
        """Horizontal focal length in pixels."""

    @property
    def fy(self) -> float:
        """Vertical focal length in pixels."""

    @property
    def cx(self) -> float:
        """Distance in pixels from the left border to the optical axis."""

    @property
    def cy(self) -> float:
        """Distance in pixels from the upper border to the optical axis."""

    @property
    def image_size_px(self) -> tuple[int, int]:
        """Size (width, height) of the written images: ``resize`` if set, otherwise ``(width_px, height_px)``."""

    @staticmethod
    def preset(product: str) -> CameraConfig:
        """Return the depth camera of a product, with its errors, named like it.

        Parameters
        ----------
        product
            Its name, such as ``"d435"``.

        Raises
        ------
        ValueError
            There is none of this name. The message lists all.
        """

    def stereo_pair(self, baseline_m: float) -> list[CameraConfig]:
        """Return two cameras. This one is the left.

        {camera.hpp: Their names end ... and _right}.

        Parameters
        ----------
        baseline_m
            Distance of the right one, in (0, 10] m.

        Raises
        ------
        ValueError
            The distance or the camera is not valid.
        """

class Server:
    """{server.hpp: Lets other processes}.

    Make it by `flockstep.serve`. It runs on separate threads until `stop`, the end of a ``with`` block, or its
    deletion. {server.hpp: The program may go}.

    Parameters
    ----------
    batch
        The batch.
    config
        Addresses, limits and the rest.

    Raises
    ------
    RuntimeError
        {server.hpp: The port is ... be read}.
    """

    def __init__(self, batch: Batch, config: ServerConfig) -> None: ...
    def stop(self) -> None:
        """Close all connections and end the threads. {server.hpp: Clients get the ... first one}.

        Raises
        ------
        RuntimeError
            Called by a task that a client steps.
        """
    @property
    def config(self) -> ServerConfig:
        """The configuration as given."""
    @property
    def port(self) -> int:
        """Port on which it listens, also if the configuration says 0; 0 for a Unix socket."""
    @property
    def address(self) -> str:
        """Address for `flockstep.connect`: {server.hpp: "127.0.0.1 ... "unix:PATH"}."""
    @property
    def num_clients(self) -> int:
        """Number of clients that are connected now."""
    @property
    def num_requests(self) -> int:
        """Number of requests answered since the start."""
    @property
    def num_steps(self) -> int:
        """Number of steps that clients and the server's clock have made since the start."""
    def __enter__(self) -> Server: ...
    def __exit__(self, *exception: object) -> None: ...

class Learner:
    """Networks, optimiser and rollout of `flockstep.PPO`. R is the number of rows, k the size of an observation.

    Parameters
    ----------
    config
        Shape of the networks.
    num_threads
        0: one per physical core. Results are bit-identical for any number.
    seed
        Of initial weights, actions and minibatches.
    """

    def __init__(self, config: NetworkConfig, num_threads: int = 0, seed: int = 0) -> None: ...
    @property
    def config(self) -> NetworkConfig:
        """Shape of the networks."""
    @property
    def num_threads(self) -> int:
        """Actual number of threads."""
    @property
    def seed(self) -> int:
        """The seed as given."""
    @property
    def rows(self) -> int:
        """Rows of the current rollout."""
    @property
    def layout(self) -> list[tuple[str, tuple[int, ...], int]]:
        """Name, shape and first index of each group of parameters; {learner.hpp: names are those of}."""
    @property
    def parameters(self) -> _F32:
        """A copy of the parameters; setting it changes them."""
    @parameters.setter
    def parameters(self, values: npt.ArrayLike) -> None: ...
    @property
    def adam(self) -> tuple[_F32, _F32, int]:
        """Copies of Adam's first and second moments, in the order of the parameters, and its number of steps."""
    def set_adam(self, adam_m: npt.ArrayLike, adam_v: npt.ArrayLike, steps: int) -> None:
        """Set what `adam` returns."""
    @property
    def draws(self) -> int:
        """Number of draws so far: the state of the random numbers."""
    @draws.setter
    def draws(self, value: int) -> None: ...
    @property
    def observation_moments(self) -> tuple[_F64, _F64, float]:
        """Running mean and variance of the observations of rows that flew, (k,) each, and their weight."""
    @property
    def return_moments(self) -> tuple[_F64, _F64, float]:
        """Running mean and variance of the discounted returns, (1,) each, and their weight."""
    def set_moments(
        self,
        observation: tuple[npt.ArrayLike, npt.ArrayLike, float],
        returns: tuple[npt.ArrayLike, npt.ArrayLike, float],
    ) -> None:
        """Set the running moments."""
    @property
    def discounted_returns(self) -> _F64:
        """A copy of the discounted return of each row's episode so far, for normalised rewards."""
    @discounted_returns.setter
    def discounted_returns(self, values: npt.ArrayLike) -> None: ...
    def predict(self, observation: npt.ArrayLike) -> _F32:
        """Return {learner.hpp: the most probable ... indices}, for observations (R, k) or (R, k - critic_only)."""
    def sample(self, observation: npt.ArrayLike) -> _F32:
        """Return random actions, {learner.hpp: in the same form}."""
    def values(self, observation: npt.ArrayLike) -> _F32:
        """Return the values (R,) of observations (R, k)."""
    def begin(self, config: RolloutConfig, rows: int) -> None:
        """Begin a rollout of R rows."""
    def act(self, t: int, observation: npt.ArrayLike, skipped: npt.ArrayLike | None = None) -> _F32:
        """Draw and return the actions of step t from observations (R, k), and keep what the update needs.

        The running moments leave out the observations of rows that are ``skipped``, (R,) bool: those that will not fly
        in this step.
        """
    def record(
        self,
        t: int,
        reward: npt.ArrayLike,
        terminated: npt.ArrayLike,
        truncated: npt.ArrayLike,
        final_observation: npt.ArrayLike | None = None,
        skipped: npt.ArrayLike | None = None,
    ) -> None:
        """Keep the results of step t.

        Parameters
        ----------
        t
            Number of the step.
        reward, terminated, truncated
            As Gymnasium's vector envs return them, (R,).
        final_observation
            (R, k), read in rows that were truncated and not terminated.
        skipped
            (R,) bool: rows that have not flown in this step, so that nothing is learned from them.
        """
    def fly(self, t: int, batch: Batch, reward_scale: float = 1.0) -> None:
        """Draw the actions of step t within a step of a batch, on the threads that fly it, and keep the results.

        The actions are limited to the bounds of the task's action.
        """
    def read_observation(self, batch: Batch) -> _F32:
        """Return the current observations of a batch as rows of numbers, (R, k), its fields in the order of names."""
    def finish(self, observation: npt.ArrayLike) -> None:
        """Compute advantages and returns; the observations (R, k) are those after the last step."""
    def update(self, config: UpdateConfig, order: npt.ArrayLike | None = None) -> UpdateReport:
        """Learn from the rollout.

        Parameters
        ----------
        config
            Settings of this update.
        order
            Indices t R + r of the steps {learner.hpp: in the order of ... each epoch}. None: drawn.
        """
    def learn_window(self, config: GradientConfig, batch: Batch) -> GradientReport:
        """Learn once from ``config.horizon`` steps of a batch, which it flies."""

    def require_derivatives(self, config: GradientConfig, batch: Batch) -> None:
        """Raise ValueError if a part of a batch has no derivative. The message names it."""

    def window_gradient(self) -> _F32:
        """Return the gradient of the last window, not limited, in the order of the parameters."""

    def gradient(self, config: UpdateConfig, minibatch: npt.ArrayLike) -> _F32:
        """Return the gradient of the loss over some steps, given as indices t R + r, not limited."""
    @property
    def actions(self) -> _F32:
        """Actions of the rollout, (n_steps, R, action_size) numbers or (n_steps, R) indices."""
    @property
    def advantages(self) -> _F32:
        """Advantages (n_steps, R)."""
    @property
    def returns(self) -> _F32:
        """Returns (n_steps, R) that the values learn."""
    @property
    def rewards(self) -> _F32:
        """Rewards (n_steps, R) as learned from: {learner.hpp: normalised, with}."""
    @property
    def rollout_values(self) -> _F32:
        """Values (n_steps, R) when the actions were drawn."""
    @property
    def log_probs(self) -> _F32:
        """Logarithms (n_steps, R) of the probability densities of the actions when they were drawn."""

@final
class DynamicsConfig:
    """{dynamics.hpp: The motion model}.

    With ``motion="rotors"`` a drone is a rigid body with four to eight rotors (docs/concepts/flight-model.md has the equations). A
    command is a number for each rotor, or four numbers, whose meaning depends on ``control``:

    - ``"rotor_speeds"``: rad/s of each rotor, in the order of the airframe.
    - ``"rotor_thrusts"``: N of each rotor, in still air.
    - ``"body_rates"``: {dynamics.hpp: total thrust of}, m/s^2; {dynamics.hpp: body rates about}. Also called CTBR.
    - ``"attitude"``: thrust, m/s^2; roll, pitch, yaw, rad.
    - ``"acceleration"``: m/s^2 in the world frame; yaw, rad.
    - ``"velocity"``: m/s in the world frame; yaw rate, rad/s.
    - ``"heading_velocity"``: m/s forward, left and up; yaw rate, rad/s.
    - ``"position"``: m in the world frame; yaw, rad.
    - ``"pose"``: the pose to reach at the end of the step, which is the command of tasks for kinematic motion. The
      drone flies it as a velocity and a yaw rate.
    """

    # fields of DynamicsConfig

@final
class NavigationReward:
    """The reward of the navigation task: the sum of these terms, each multiplied by its weight.

    l are the LiDAR ranges divided by the maximum range, |L| is their number, M is ``min_clearance``, R is
    ``goal_reward``.
    """

    # fields of NavigationReward

@final
class Light:
    """Sun, sky and fog of camera images. ``Light(**world.light)`` is the light of a world."""

    # fields of Light
    @staticmethod
    def at_hour(hour: float, latitude_deg: float = 48.0, day_of_year: int = 172) -> Light:
        """Return the light at a time of a clear day.

        {light.hpp: It is the default ... darker below}. At night only a faint bluish sky remains. x points east and y
        north.

        Parameters
        ----------
        hour
            Solar time, 0 to 24. At 12 the sun is highest.
        latitude_deg
            Latitude of the place, -90 to 90. The south is negative.
        day_of_year
            From 1 for January 1st. June 21st is 172.

        Raises
        ------
        ValueError
            An argument is outside its limits.
        """

@final
class NavigationConfig:
    # fields of NavigationConfig
    @staticmethod
    def observing(observation: str) -> NavigationConfig:
        """Return the thesis's task with this observation.

        Camera tasks (``"blob"``, ``"pixels"``) fly forward and sideways, and end when the drone passes the goal.
        """

@final
class Field:
    """A named array that a task declares, with the shape of one row. Bounds are one number, or one for each value."""

    def __init__(self, name: str, dtype: str, shape: Sequence[int], low: float, high: float) -> None: ...
    @property
    def name(self) -> str:
        """Name of the array, and its key in a dict of observations."""

    @property
    def dtype(self) -> str:
        """NumPy name of the type: ``"bool"``, ``"uint8"``, ``"int32"``, ``"int64"``, ``"float32"`` or ``"float64"``."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one row; () for a scalar."""

    @property
    def low(self) -> Any:
        """Minimum: a number, or an array of ``shape``."""

    @property
    def high(self) -> Any:
        """Maximum: a number, or an array of ``shape``."""

@final
class TaskSpec:
    """Action, observations and reward terms of a task."""

    def __init__(
        self,
        action: Field,
        observation: Sequence[Field],
        reward_terms: Sequence[str],
        row: Literal["drone", "env"] = "drone",
        records_path: bool = False,
    ) -> None: ...
    @property
    def row(self) -> str:
        """Kind of the rows of actions, observations and rewards: one per ``"drone"`` or one per ``"env"``."""

    @property
    def records_path(self) -> bool:
        """True if the task reads `Batch.path`."""

    @property
    def action(self) -> Field:
        """One row of the actions that `Batch.step` takes."""

    @property
    def observation(self) -> list[Field]:
        """Fields of the observation; {task.hpp: one field is}."""

    @property
    def reward_terms(self) -> list[str]:
        """Names of the terms whose sum is the reward: the columns of `Batch.reward_terms`."""

@final
class EpisodeEnd(IntEnum):
    """Reason for the end of an episode.

    {episode.hpp: If several reasons hold}.

    - ``none``: the episode goes on.
    - ``success``: success according to the task.
    - ``contact``: terminated while a drone was in contact with something.
    - ``left_area``: ended by the task because a drone left the task's area.
    - ``bad_state``: {batch.hpp: a setpoint, pose ... finite}, or a pose was outside the world; see `Batch.bad_state`.
    - ``time``: truncated at ``max_episode_steps``.
    - ``task``: {episode.hpp: terminated or truncated by}.
    - ``teammate``: truncated because {episode.hpp: the episode of another}.

    `Batch.episode_end` and the infos hold these as integers; ``EpisodeEnd(2).name`` is ``"contact"``.
    """

    none = 0
    success = 1
    contact = 2
    left_area = 3
    bad_state = 4
    time = 5
    task = 6
    teammate = 7

@final
class NativeTask:
    """A task written in C++: a shared library whose source ends with ``FLOCKSTEP_EXPORT_TASK(YourTask)``.

    Build it against the headers in `flockstep.include_dir`, with the compiler that flockstep was built with. The file
    is checked before it is loaded.

    Parameters
    ----------
    path
        Path of the shared library: a str or a Path.

    Raises
    ------
    TypeError
        The argument is not a path.
    FileNotFoundError
        There is no such file. It is also a `ValueError`.
    ValueError
        The file is not a regular file, is cut short, is not a shared library, exports no task, or was built for another
        version.
    """

    def __init__(self, path: str | PathLike[str]) -> None: ...
    @property
    def path(self) -> str:
        """Path of the shared library."""

@final
class PythonTask:
    """A task whose methods are written in Python; `flockstep.Task` makes these objects."""

    def __init__(self, spec: TaskSpec, identity: str, max_episode_steps: int, calls: object) -> None: ...

def _nearest_name(name: str, known: Sequence[str]) -> str: ...
def _scene_keys() -> str: ...
def _unexpected_keyword(callee: str, keyword: str, known: Sequence[str]) -> str: ...
def _unknown_scene(name: str, known: Sequence[str]) -> str: ...
def load_scene(name: str, folder: str | PathLike[str]) -> World:
    """Return the world of a name or path; ``folder`` holds the bundled scenes."""

def time_limit(task: _EngineTask | NativeTask | PythonTask) -> int:
    """Return the default time limit of a task in steps; 0 means none."""

@final
class World:
    """{world.hpp: Immutable geometry}."""

    @staticmethod
    def load(
        source: str | PathLike[str],
        *,
        meshes_anywhere: bool = False,
        scale: float = 1.0,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        up: Literal["y", "z"] | None = None,
    ) -> World:
        """Load a bundled scene by its name, or a ``.json``, ``.gltf``, ``.glb``, ``.obj`` or ``.ply`` file by its path.

        Files that it names must be in its folder or below it, unless ``meshes_anywhere`` is set. Points are turned so
        that the axis ``up`` points up (None: ``"y"`` for glTF, ``"z"`` for others), multiplied by ``scale`` (m per unit
        of the file), and moved so that the file's origin is at ``origin`` (m). A `UserWarning` lists content of the
        file that flockstep does not read. See `flockstep.scenes`.
        """

    @staticmethod
    def from_dict(
        scene: Mapping[str, Any], base_dir: str | PathLike[str] = "", *, meshes_anywhere: bool = False
    ) -> World:
        """Make a world from the content of a scene file; ``base_dir`` is its folder, empty for the current one.

        A `UserWarning` lists content of the scene's files that flockstep does not read.
        """

    @staticmethod
    def playground(**fields: Arguments[PlaygroundConfig]) -> World:
        """Generate {generators.hpp: a room with ... a goal}.

        The default drone can fly from the start via the waypoints to the goal. The same arguments make the same world.
        """

    @staticmethod
    def forest(**fields: Arguments[ForestConfig]) -> World:
        """Generate a forest of textured meshes on rolling terrain: trees, rocks, a start and a goal at opposite ends.

        The default drone can fly from the start to the goal. The same arguments make the same world.
        """

    @staticmethod
    def city(**fields: Arguments[CityConfig]) -> World:
        """Generate a city: {generators.hpp: blocks of houses ... cables}, a start and a goal far apart.

        The default drone can fly from the start to the goal {generators.hpp: along the streets ... above them}. The
        same arguments make the same world.
        """

    @staticmethod
    def office(**fields: Arguments[OfficeConfig]) -> World:
        """Generate one textured floor of an office building: furnished rooms, corridors, and lounges with windows.

        Start and goal are in rooms at opposite ends of x. {generators.hpp: The default drone ... to the other} through
        doors, but not in a straight line. The same arguments make the same world.
        """

    @staticmethod
    def warehouse(**fields: Arguments[WarehouseConfig]) -> World:
        """Generate a textured warehouse: a hall with skylights, rows of racks with pallets, forklifts and more.

        Start and goal are at opposite ends of x. {generators.hpp: The default drone ... to the other} around racks and
        through empty bays, but not in a straight line. The same arguments make the same world.
        """

    def __copy__(self) -> World: ...
    def __deepcopy__(self, memo: dict[int, Any]) -> World: ...
    @staticmethod
    def race_track(**fields: Arguments[RaceTrackConfig]) -> World:
        """Generate a race track: {generators.hpp: a closed loop of}.

        From each gate to the next it is 4.5 to 12 m, with turns of at most 120 degrees and climbs of at most 40 %.
        {generators.hpp: A racer5 can fly ... that of the next}. {generators.hpp: The start is before}. The same
        arguments make the same world.
        """

    @property
    def name(self) -> str:
        """Name given in the scene file, otherwise the name of the file."""

    @property
    def bounds(self) -> _F32:
        """(2, 3) m: minimum and maximum corner of all geometry."""

    @property
    def start(self) -> _F32 | _MaybeNone:
        """(3,) m, or None if the world has no start marker."""

    @property
    def waypoints(self) -> _F32:
        """(K, 3) m, in flight order."""

    @property
    def goal(self) -> _F32 | _MaybeNone:
        """(3,) m, or None if the world has no goal marker."""

    @property
    def spawn_box(self) -> _F32 | _MaybeNone:
        """(2, 3) m: minimum and maximum corner of the region of random starts, or None."""

    @property
    def marker_radius_m(self) -> float:
        """Radius of the drawn markers, m."""

    @property
    def materials(self) -> list[dict[str, Any]]:
        """The materials, one dict each. Values have the same limits as in a scene file.

        - ``name``
        - ``base_color``: (3,) linear RGB.
        - ``semantic``: semantic id in camera images. The default is the index in this list plus 1.
        - ``emissive``: (3,) linear RGB, emitted independently of the lighting.
        - ``alpha_cutoff``: meshes are transparent to cameras wherever the texture's alpha is below this value.
        """

    @property
    def light(self) -> dict[str, Any]:
        """Sun and sky of camera images: the fields of `Light` by name, colours and directions as tuples."""

    @property
    def primitives(self) -> list[dict[str, Any]]:
        """The primitives, one dict each.

        - ``kind``: ``"room"``, ``"box"``, ``"cylinder"``, ``"sphere"``, ``"capsule"``, ``"plane"`` or ``"disc"``.
        - ``center``: (3,) m.
        - ``quat_wxyz``: (4,).
        - ``half_extents``: (3,) m; for round primitives radius, radius, half height.
        - ``material``, ``visible`` and ``solid``.

        They are ordered by kind. {world.hpp: The bars of}.
        """

    @property
    def gates(self) -> list[dict[str, Any]]:
        """The gates in the order of flight, one dict each.

        - ``shape``: of the opening, ``"square"`` or ``"ring"``.
        - ``center``: (3,) m, the middle of the opening.
        - ``quat_wxyz``: (4,); drones pass the gate along its local x, and its local z is up.
        - ``size_m``: inside width of a square, inside diameter of a ring.
        - ``bar_m``: thickness of the bars of the frame.
        - ``material``, ``visible`` and ``solid``: of the frame, whose bars are among the `primitives`.
        """

    @property
    def bodies(self) -> list[BodyConfig]:
        """{world.hpp: Bodies that every ... with}; queries of the world do not find them."""

    def with_bodies(self, bodies: BodyConfig | Sequence[BodyConfig] | None) -> World:
        """Return {world.hpp: the same world with these bodies}."""

    def to_dict(self) -> dict[str, Any]:
        """Return the content that `save` writes to a ``.json`` file; triangle meshes are inline."""

    def save(self, path: str | PathLike[str]) -> None:
        """Write {world.hpp: a scene file (.json) ... .gltf)} that `load` reads as an equal world.

        Any viewer can show the glTF file: primitives are tessellated in it, and ``extras`` describe them. {world.hpp:
        The file is written}.

        Raises
        ------
        ValueError
            The suffix is not one of these, the path cannot be written, or the world exceeds the glTF limit of 1 GiB.
        """

    def to_glb(self) -> bytes:
        """Return the bytes of a ``.glb`` file, which `from_glb` reads back as an equal world."""

    @staticmethod
    def from_glb(data: bytes) -> World:
        """Read the bytes of a ``.glb`` file, which must not refer to other files.

        Raises
        ------
        ValueError
            The bytes are not such a file.
        """

    def mesh(self, chord_error_m: float = 1e-3) -> dict[str, npt.NDArray[Any]]:
        """Return all geometry as triangles.

        {world.hpp: Round primitives are}.

        Returns
        -------
        - ``vertices``: (V, 3) m.
        - ``triangles``: (T, 3) int32, vertex indices, counter-clockwise seen from outside a solid and from inside a
          room.
        - ``uv``: (V, 2) float32, texture coordinates; (0, 0) is the upper left corner. Vertices without a texture have
          (0, 0).
        - ``materials``: (T,) int32, index into `materials`.
        - ``objects``: (T,) int32, row in the result of `World.objects`: the primitives come first, then the meshes.
          This is the camera output ``instance`` minus 1.
        """

    def objects(self) -> dict[str, npt.NDArray[Any]]:
        """Return the objects of camera images: the primitives, then the meshes. Row i has ``instance`` i + 1.

        Returns
        -------
        - ``boxes``: (K, 2, 3) float32 m, minimum and maximum corner of the smallest box around each object.
        - ``materials``: (K,) int32, index into `materials`; -1 if an object has several.
        - ``visible``: (K,) bool, True if sensors detect the object.
        - ``solid``: (K,) bool, True if drones hit the object.
        """

    def point_cloud(self, spacing_m: float) -> dict[str, npt.NDArray[Any]]:
        """Return points spread evenly over all surfaces, about one for each ``spacing_m`` x ``spacing_m`` of area.

        The points lie on ``mesh(spacing_m / 100)``. The result is deterministic.

        Returns
        -------
        - ``points``: (N, 3) float32 m.
        - ``normals``: (N, 3) float32 unit, out of a solid and into a room.
        - ``semantic``: (N,) uint16, semantic id as in camera images.
        - ``objects``: (N,) int32, row in the result of `World.objects`.

        Raises
        ------
        ValueError
            There would be more than 50,000,000 points.
        """

    def occupancy(self, cell_m: float, box: npt.ArrayLike | None = None) -> dict[str, Any]:
        """Return the occupied cells of a grid.

        A cell is occupied if it touches a surface, or if its {survey.hpp: centre is inside ... the room}. {survey.hpp:
        For this test, cells}. {survey.hpp: Closed meshes are}.

        Parameters
        ----------
        cell_m
            Edge of a cell, in [0.001, 100] m.
        box
            (2, 3) m, region that the cells cover, starting at its minimum corner. None: `bounds`.

        Returns
        -------
        - ``occupied``: (nx, ny, nz) bool. Cell (i, j, k) is centred at ``origin + cell_m * (i + 0.5, j + 0.5, k +
          0.5)``.
        - ``origin``: (3,) float32 m, minimum corner.
        - ``cell_m``: as given.

        Raises
        ------
        ValueError
            There would be more than 134,217,728 cells.
        """

    def distance(self, cell_m: float, box: npt.ArrayLike | None = None) -> dict[str, Any]:
        """Return the distance from the centre of each cell of a grid to the nearest surface.

        Arguments and errors are those of `occupancy`.

        Returns
        -------
        - ``distance_m``: (nx, ny, nz) float32; 0 inside a solid and outside the room.
        - ``origin`` and ``cell_m``: as in `occupancy`.
        """

    def nearest(self, points: npt.ArrayLike) -> tuple[_F32, _F32, npt.NDArray[np.int32]]:
        """Return the nearest surface that drones hit, for each of K points (K, 3) m.

        Returns
        -------
        - points (K, 3): {survey.hpp: m, world frame; the point itself ... room}.
        - distances (K,), m.
        - objects (K,): numbers as in `objects`.
        """

    def with_markers(
        self,
        *,
        start: npt.ArrayLike | None = None,
        goal: npt.ArrayLike | None = None,
        waypoints: npt.ArrayLike | None = None,
        spawn_box: npt.ArrayLike | None = None,
    ) -> World:
        """Return {world.hpp: the same world with these markers}.

        ``start`` and ``goal`` are (3,) m, ``waypoints`` (K, 3) m, and ``spawn_box`` (2, 3) m, minimum and maximum
        corner.
        """

    def with_light(
        self,
        *,
        tint: npt.ArrayLike | None = None,
        **fields: Changes[Light],
    ) -> World:
        """Return the same world in another light, with other colours.

        The copy shares geometry, textures and all acceleration structures with this world. If cameras use it, it takes
        16 bytes per triangle, 120 per primitive, 2 kB per material and 12 kB in addition; OpenGL keeps a separate copy
        of the geometry for each world. `relight` makes many such copies with random light. All arguments except
        ``tint`` are those of `WorldBuilder.light`; None leaves a value unchanged.

        Parameters
        ----------
        tint
            Linear RGB factors in [0, 10], (3,) for the base colours of all materials or (M, 3) for each of `materials`.
            They also apply to textures. Base colours are limited to 1.
        """

    def free_places(
        self,
        count: int,
        seed: int = 0,
        *,
        clearance_m: float | None = None,
        max_height_m: float = 5.0,
        box: npt.ArrayLike | None = None,
        reachable_from: npt.ArrayLike | None = None,
        drone: _DroneLike | None = None,
        cell_m: float = 0.2,
    ) -> _F32:
        """Draw ``count`` places (count, 3) m at which a drone, level and facing +x, touches nothing.

        {planning.hpp: Each place has ... a closed mesh}. {planning.hpp: With a larger count}.

        Parameters
        ----------
        count
            Number of places.
        seed
            Seed of the draws. The same arguments give the same places.
        clearance_m
            {planning.hpp: Minimum distance from the ... any orientation}.
        max_height_m
            Maximum height, {planning.hpp: m above the nearest}.
        box
            (2, 3) m, sampling region. None: `bounds`, {planning.hpp: extended upwards}.
        reachable_from
            (3,) m, {planning.hpp: a place from which ... drawn places}.
        drone
            A `DroneModel`, or the name or path of one. None: the default drone.
        cell_m
            Spacing of the lattice on which paths from ``reachable_from`` are searched, m.

        Raises
        ------
        ValueError
            100,000 draws in a row gave no place; the message gives the reasons.
        """

    def with_drawn_markers(
        self,
        seed: int = 0,
        *,
        distance_m: float | None = None,
        clearance_m: float | None = None,
        max_height_m: float = 5.0,
        box: npt.ArrayLike | None = None,
        drone: _DroneLike | None = None,
        cell_m: float = 0.2,
        waypoints: bool = False,
    ) -> World:
        """Return the same world with a start and a goal drawn by `free_places`, and no other markers but ``waypoints``.

        {planning.hpp: The drone can fly ... the other}. The other arguments are those of `free_places`.

        Parameters
        ----------
        distance_m
            Minimum distance from start to goal. {planning.hpp: None: a third}.
        waypoints
            Also set waypoints: the corners of the path of `plan` from start to goal. A policy without memory then finds
            its way around walls.

        Raises
        ------
        ValueError
            No such pair was found.
        """

    def check(self, drone: _DroneLike | None = None) -> dict[str, Any]:
        """Return a report of {world_report.hpp: properties to check}.

        Returns
        -------
        - ``name``
        - ``size_m``: (3,) size of `bounds`.
        - ``primitives``, ``triangles`` (of meshes) and ``objects``: how many there are.
        - ``open_edges``: number of edges that belong to one triangle. A closed mesh has none; open ground has them
          along its border.
        - ``crowded_edges``: number of edges that belong to more than two triangles. Vertices at the same place are
          merged.
        - ``materials`` and ``textures``: how many there are.
        - ``texture_bytes``: memory of the textures.
        - ``start``, ``goal`` and ``spawn_box``: True if the world has one.
        - ``waypoints``: how many there are.
        - ``not_read``: texts that describe content of the file that was not read, including triangles without area.
        - ``not_navigable``: why the navigation tasks cannot be flown in this world with ``drone``; None if they can. If
          ``drone`` is None, the default drone is checked.
        """

    def raycast(
        self, origins: npt.ArrayLike, directions: npt.ArrayLike, max_range_m: float
    ) -> dict[str, npt.NDArray[Any]]:
        """Return the nearest hit of each of R rays.

        Parameters
        ----------
        origins, directions
            (R, 3), world frame; origins in m. Directions need not be unit, but must not be zero.
        max_range_m
            Maximum distance of a hit, m.

        Returns
        -------
        - ``t_hit``: {raycast.hpp: (R,) m along}.
        - ``normal``: (R, 3) {raycast.hpp: unit, facing}.
        - ``u`` and ``v``: {raycast.hpp: (R,) weights of ... was hit}; 0 on primitives and on a miss.
        - ``primitive``: (R,) int32, index into `primitives`, or the number of primitives plus the index of a triangle;
          -1 on a miss.
        - ``material``: (R,) int32, index into `materials`; -1 on a miss.
        """

@final
class WorldBuilder:
    """Builds a world in code, piece by piece; `build` returns it.

    Lengths and positions are in metres, world frame. Quaternions are (w, x, y, z) and rotate from the piece's own frame
    to the world. Materials and textures are given by the numbers that `material` and `texture` return. Invalid input
    raises `ValueError` in the call itself or in `build`. Cameras, LiDARs and rays detect ``visible`` pieces; drones hit
    ``solid`` pieces and planners avoid them. Every piece is at least one of the two.

    Parameters
    ----------
    name
        Name of the world.
    """

    def __init__(self, name: str = "unnamed") -> None: ...
    def texture(
        self,
        name: str,
        pixels: npt.NDArray[np.uint8],
        wrap: Sequence[Literal["repeat", "mirror", "clamp"]] = ("repeat", "repeat"),
    ) -> int:
        """Add an image (height, width, 3 or 4) in sRGB, row 0 at the top; return its number.

        The fourth channel is alpha, by default 255; only ``alpha_cutoff`` of a material uses it. ``wrap`` says how the
        image continues beyond its borders, horizontally and vertically.
        """

    def material(
        self,
        name: str,
        base_color: Sequence[float] = (1.0, 1.0, 1.0),
        *,
        semantic: int = 0,
        texture: int | None = None,
        emissive: Sequence[float] = ...,
        alpha_cutoff: float = 0.0,
    ) -> int:
        """Add a material and return its number.

        Values have the same limits as in a scene file. ``base_color`` is linear RGB; on meshes and height fields it is
        multiplied by the texture's colours. ``semantic`` is the semantic id in camera images; 0 means the material's
        number plus 1. ``emissive`` is linear RGB, emitted independently of the lighting, by default 0. Meshes and
        height fields are {world.hpp: transparent to cameras ... is below} ``alpha_cutoff``. LiDAR rays and collisions
        hit whole triangles.
        """

    def room(self, min: Sequence[float], max: Sequence[float], material: int) -> None:
        """Add the room, the inside of a box given by two corners."""

    def box(
        self,
        center: Sequence[float],
        size: Sequence[float],
        material: int,
        quat_wxyz: Sequence[float] | None = None,
        *,
        visible: bool = True,
        solid: bool = True,
    ) -> None:
        """Add a box with a size along its own x, y, z."""

    def cylinder(
        self,
        center: Sequence[float],
        radius: float,
        height: float,
        material: int,
        quat_wxyz: Sequence[float] | None = None,
        *,
        visible: bool = True,
        solid: bool = True,
    ) -> None:
        """Add a cylinder with flat caps; its axis is its own z."""

    def capsule(
        self,
        center: Sequence[float],
        radius: float,
        height: float,
        material: int,
        quat_wxyz: Sequence[float] | None = None,
        *,
        visible: bool = True,
        solid: bool = True,
    ) -> None:
        """Add a capsule whose axis is its own z; ``height`` includes the round caps."""

    def sphere(
        self, center: Sequence[float], radius: float, material: int, *, visible: bool = True, solid: bool = True
    ) -> None:
        """Add a sphere."""

    def plane(
        self,
        center: Sequence[float],
        size: Sequence[float],
        material: int,
        quat_wxyz: Sequence[float] | None = None,
        *,
        visible: bool = True,
        solid: bool = True,
    ) -> None:
        """Add a rectangle with a size along its own x and y; rays and drones hit it from both sides."""

    def disc(
        self,
        center: Sequence[float],
        radius: float,
        material: int,
        quat_wxyz: Sequence[float] | None = None,
        *,
        visible: bool = True,
        solid: bool = True,
    ) -> None:
        """Add a disc normal to its own z; rays and drones hit it from both sides."""

    def gate(
        self,
        center: Sequence[float],
        material: int,
        quat_wxyz: Sequence[float] | None = None,
        *,
        shape: Literal["square", "ring"] = "square",
        size_m: float = 1.5,
        bar_m: float = 0.1,
        visible: bool = True,
        solid: bool = True,
    ) -> None:
        """Add a gate after the gates so far, with a frame around its opening; drones pass it along its local x.

        ``size_m`` is the inside width of a square or the inside diameter of a ring, ``bar_m`` the thickness of the
        bars. Without a rotation it is passed along x.
        """

    def body(self, body: BodyConfig) -> None:
        """Add a body, a solid that moves, after the bodies so far; every env in the world has it."""

    def mesh(
        self,
        vertices: npt.ArrayLike,
        triangles: npt.ArrayLike,
        material: int,
        uv: npt.ArrayLike | None = None,
        colors: npt.ArrayLike | None = None,
        *,
        visible: bool = True,
        solid: bool = True,
    ) -> None:
        """Add triangles (T, 3) of vertices (V, 3) as a separate object.

        ``uv`` (V, 2) are texture coordinates: (0, 0) is the upper left corner of the texture, (1, 1) the lower right
        one. ``colors`` (V, 3), linear RGB, are multiplied by the colour of the material.
        """

    def heightfield(
        self,
        heights: npt.ArrayLike,
        material: int,
        *,
        corner: Sequence[float] = (0.0, 0.0),
        cell_m: float = 1.0,
        texture_m: float = 4.0,
        visible: bool = True,
        solid: bool = True,
    ) -> None:
        """Add ground as triangles from heights (rows, columns) m; row r, column c is at ``corner + cell_m * (c, r)``.

        A texture repeats every ``texture_m``.
        """

    def light(
        self,
        **fields: Fields[Light],
    ) -> None:
        """Set the light, with the keys of `World.light`; omitted values have their defaults."""

    def start(self, place: Sequence[float]) -> None:
        """Set the start of the drones."""

    def waypoint(self, place: Sequence[float]) -> None:
        """Append a waypoint."""

    def goal(self, place: Sequence[float]) -> None:
        """Set the goal."""

    def spawn_box(self, min: Sequence[float], max: Sequence[float]) -> None:
        """Set the region of random starts (``random_start``), a box given by two corners."""

    def build(self) -> World:
        """Return the world built so far. You can add more afterwards and build another one."""

@final
class DroneModel:
    """{drone_model.hpp: The body and flight}.

    {drone_model.hpp: The convex hull is ... flight model}.

    Parameters
    ----------
    hull
        (V, 3) m in the body frame: 4 to 32 points whose convex hull has a volume. Such a drone has no airframe and
        supports only kinematic motion. Default: the 650-class quadrotor ``"t650"``, {drone_model.hpp: 0.93 ... 0.20 m},
        with its airframe.
    """

    def __init__(self, hull: npt.ArrayLike | None = None) -> None: ...
    @property
    def hull(self) -> _F32:
        """(V, 3) m, body frame."""

    @staticmethod
    def load(name_or_path: str | PathLike[str]) -> DroneModel:
        """Load a bundled airframe by its name, or {drone_model.hpp: a JSON file by}."""

    @staticmethod
    def names() -> list[str]:
        """Return the names of the bundled airframes."""

    @staticmethod
    def from_dict(data: dict[str, Any]) -> DroneModel:
        """Make a drone from the content of its JSON file; docs/reference/drone-files.md describes the format.

        Numbers that are probably in another unit raise a ``UserWarning``: moments of inertia beyond the mass times the
        hull's squared radius, a thrust-to-weight beyond 20, propeller tips faster than sound.
        """

    def to_dict(self) -> dict[str, Any]:
        """Return a dict from which `from_dict` makes an equal drone."""

    def scaled(self, *, size: float = 1.0, mass: float = 1.0) -> DroneModel:
        """Return a drone with size and mass multiplied by these factors, and a flight model that matches.

        Lengths are multiplied by ``size``. Inertia, thrust, drag and lags follow Froude's law: {airframe.hpp: speeds
        and times are}.
        """

    @property
    def name(self) -> str:
        """Name of the airframe, empty if it has none."""

    @property
    def mass_kg(self) -> float:
        """Mass of the airframe, kg."""

    @property
    def thrust_to_weight(self) -> float:
        """Thrust of all rotors at full speed, divided by the weight."""

    @property
    def max_thrust_n(self) -> float:
        """Thrust of one rotor at full speed, N."""

    @property
    def hover_speed_radps(self) -> float:
        """Rotor speed in hover if all rotors carry the same share of the weight, rad/s."""

    @property
    def num_rotors(self) -> int:
        """Number of rotors, 4 to 8."""

@final
class Contact:
    """Contacts of the last motion of each drone. Views into the batch, cleared by a teleport or a reset."""

    # arrays of Contact

@final
class Bodies:
    """The bodies of a batch, in B slots of each env; `Batch.bodies` returns it.

    Its arrays are read-only views into the batch. Every episode begins with the bodies of the configuration in the
    first slots, and no others. {batch.hpp: An object that ... next episode}. Sensors see changes at their next reading. A
    body that leaves the world is removed.

    Masks are bool: (E, B) for bodies, or (E,) for all bodies of envs; None selects all. Slots without a body are skipped.
    """

    def __len__(self) -> int:
        """Number of slots in each env, B."""

    # arrays of Bodies
    def spawn(
        self,
        body: BodyConfig,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> _I64:
        """Put {batch.hpp: an object into ... slot of each} env with True in ``mask`` (E,).

        Parameters
        ----------
        body
            Its configuration.
        position, quat_wxyz, velocity, angular_velocity
            (E, 3) m, (E, 4), (E, 3) m/s in the world frame and (E, 3) rad/s in the body frame; they {batch.hpp: replace
            those of}.
        mask
            The envs; None selects all.

        Returns
        -------
        (E,) The slots; -1 for other envs.

        Raises
        ------
        ValueError
            An env has no free slot, or a value is invalid. No body was added.
        """

    def remove(self, mask: npt.ArrayLike | None = None) -> None:
        """Remove bodies until the next episode."""

    def set_pose(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> None:
        """Teleport bodies to positions (E, B, 3) m and quaternions (E, B, 4); None leaves a value unchanged.

        A drone that is then inside a body may only leave it.
        """

    def set_velocity(
        self,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> None:
        """Set velocities (E, B, 3) in m/s, world frame, and angular velocities (E, B, 3) in rad/s, body frame.

        None leaves a value unchanged. Limits: 10,000 m/s and 1,000 rad/s along each axis.
        """

    def config(self, env: int, body: int) -> BodyConfig | None:
        """Return a copy of the configuration of the body in a slot; None for a free slot."""

@final
class Camera:
    """One camera of every drone of a batch; `Batch.camera` returns it.

    Images are read-only views that keep the batch alive; the next call that renders overwrites them. An output that the
    camera does not write raises `ValueError`. Pixels without a hit (sky, or beyond ``far_m``) have depth inf, normal 0
    and ids 0.
    """

    @property
    def config(self) -> CameraConfig:
        """Configuration of the batch, with the current capture mode."""

    def config_of(self, index: int) -> CameraConfig:
        """Return the configuration of one drone, including changes by `Batch.set_camera`."""

    # arrays of Camera
    def jpeg(self, index: int, quality: int = 90) -> bytes:
        """Return a JPEG file of one drone's frame, rgb or otherwise grey; quality from 1 to 100.

        Raises
        ------
        ValueError
            The camera writes neither output, the frame is stale, or the index or quality is out of range.
        """

    def save_frames(
        self,
        folder: str | PathLike[str],
        indices: int | Sequence[int] | npt.NDArray[np.integer[Any]] | None = None,
        outputs: Sequence[str] | None = None,
    ) -> list[Path]:
        """Write PNG files ``<camera>-<drone>-<output>.png`` and return their paths; needs Pillow.

        ``rgb``, ``grey`` and ``hsv`` have 8 bits; the channels of ``hsv`` are stored as red, green and blue.
        ``semantic`` and ``instance`` are the ids, 16 bits. ``depth`` has 16 bits, in millimetres, and is 0 for a miss
        or beyond 65.535 m. ``normal`` is 127.5 * (n + 1), 8 bits, and 0 for a miss. ``events`` has ON events in red
        and OFF events in blue. Use `numpy.save` on the arrays to keep depth and normal exact.

        Image viewers show 16-bit ids or millimetres as almost black. Therefore ``depth``, ``semantic`` and ``instance``
        each get a second file in colour, ``<camera>-<drone>-<output>-color.png``: depth from bright (nearest) to dark
        (farthest) on a logarithmic scale shared by all frames of the call, and a fixed colour per id. A miss is black.

        Parameters
        ----------
        folder
            Output folder, created if it is missing; files of the same names are replaced.
        indices
            Indices of the drones. None: all drones that have a frame.
        outputs
            Outputs to write. None: all outputs of the camera.

        Raises
        ------
        ValueError
            The camera does not write an output, or the frame of a drone is stale. Nothing is written then.
        ModuleNotFoundError
            Pillow is not installed.
        """

@final
class Lidar:
    """One LiDAR of every drone of a batch; `Batch.lidar` returns it. Views keep the batch alive.

    An output that the LiDAR does not write raises `ValueError`. Readings raise `RuntimeError` before the first scan.
    """

    @property
    def config(self) -> LidarConfig:
        """Configuration of the batch."""

    def config_of(self, index: int) -> LidarConfig:
        """Return the configuration of one drone, including changes by `Batch.set_lidar`."""

    # arrays of Lidar
    @property
    def directions(self) -> _F32:
        """Directions of the reading's beams, (N, channels, beams, 3) unit, body frame; a copy."""

    @property
    def points(self) -> _F32:
        """{batch.hpp: (N, channels ... miss}; a copy.

        The points are exact only if the drone has not moved since the scan.
        """

@final
class Terms:
    """Current reward and observation terms of the engine's tasks, for every env; `Batch.terms` returns it.

    ``goal_index`` (N,) is the index of the waypoint that is the current goal, from 0. Beyond the last waypoint, and by
    default, the goal is the goal marker of the world. All results are new arrays, except `action_changed`.
    """

    def goal(self, goal_index: npt.ArrayLike | None = None) -> _F32:
        """Return the goals, (N, 3) m, world frame."""

    def start(self) -> _F32:
        """Return the start markers of the drones' worlds, (N, 3) m, world frame."""

    def goal_distance(self, goal_index: npt.ArrayLike | None = None) -> _F64:
        """Return the distances from the drones to their goals, (N,) m."""

    def goal_direction(self, goal_index: npt.ArrayLike | None = None) -> _F32:
        """Return the directions to the goals, (N, 3) unit, in the body frame as measured by the pose sensor."""

    def to_body(self, points: npt.ArrayLike) -> _F32:
        """Return points of the world in the body frame, in m: (N, 3), or (N, K, 3) for K points per drone.

        The pose is that of the pose sensor, as in the observations of the engine's tasks.
        """

    def rotate_to_body(self, vectors: npt.ArrayLike) -> _F32:
        """Return vectors of the world, such as velocities, in the body frame: (N, 3), or (N, K, 3) for K per drone.

        The orientation is that of the pose sensor.
        """

    def body_velocity(self) -> _F32:
        """Return the velocities, (N, 3) m/s, in the body frame as measured by the pose sensor."""

    def neighbors(self, count: int, velocity: npt.ArrayLike | None = None) -> _F32:
        """Return the nearest other drones of each drone's env, (N, count, 7), the nearest first.

        Each has its position (3, m) and velocity (3, m/s) relative to the drone, in the body frame, and 1. If there are
        fewer, the rest is 0. Poses are those of the pose sensor. Removed and finished drones are no neighbours.

        Parameters
        ----------
        count
            Number of neighbours, at least 1.
        velocity
            (N, 3) m/s, world frame, the velocities of the drones. None: those of rotor-driven drones; with kinematic
            motion, which has none, relative velocities are 0.
        """

    def command(self, actions: npt.ArrayLike, *, max_thrust_to_weight: float | None = None) -> _F32:
        """Return the commands (N, C) of `DynamicsConfig.control` for actions (N, C) in [-1, 1], for `Task.act`.

        These are the actions of the engine's flight tasks. 0 hovers, and 1 and -1 are the limits:

        - rotor speeds, rotor thrusts and collective thrust: the slowest speed and the fastest one;
        - rates, roll, pitch, velocities and accelerations: the maxima in `DynamicsConfig`, in both directions;
        - positions: 1 m from the current one along each axis of the world; yaw: half a turn from the current one.

        Actions beyond [-1, 1] are clipped.

        Parameters
        ----------
        actions
            (N, C) in [-1, 1]: a number for each rotor, or else C = 4.
        max_thrust_to_weight
            Limit of the commanded thrust of all rotors over the weight. None: only the rotors limit it.
        """

    def rotor_levels(self) -> _F32:
        """Return the rotor speeds, (N, R): -1 is the slowest commanded speed, 0 hovers, 1 is the fastest."""

    def crossed(self, gate: npt.ArrayLike, *, miss_m: float | None = None) -> tuple[_I32, _Bool]:
        """Return how many gates each drone passed in this step, (N,), and if it missed one, (N,).

        It follows the path through the ticks of the step (`Batch.path`, so the task declares ``records_path``). Passed
        gates count in the order of `World.gates`, from ``gate`` on, and the first follows the last. After the step, the
        next gate is ``(gate + passed) % len(world.gates)``. Nothing is counted after a miss. Rows that do not fly have
        passed and missed none.

        Parameters
        ----------
        gate
            (N,) index of the next gate in `World.gates` of the drone's world.
        miss_m
            A drone misses the gate if it crosses its plane forwards outside the opening, at most this far from its
            centre; None: at any distance. Crossing it backwards counts as neither.
        """

    def displaced(self, displacement_m: npt.ArrayLike) -> _F32:
        """Return the drones' positions, (N, 3) m, world frame, after a displacement (N, 3) m in their body frames."""

    def ranges(self) -> _F32:
        """Return the LiDAR's ranges divided by its maximum range, (N, rays); 1 on a miss."""

    def clearance(self) -> _F64:
        """Return the minimum of `ranges`, (N,)."""

    def free_space(self, min_clearance: float) -> _F64:
        """Return the free space, (N,): 1 in the open, 0 if all ranges are ``min_clearance``, a number in (0, 1)."""

    @property
    def action_changed(self) -> _Bool:
        """(N,): True if the action differs from the previous one; a view for use in `Task.step`.

        The first action of an episode counts as a change.
        """

@final
class Recipe:
    """{recipe.hpp: Everything that ... and back}, in Python and C++.

    {recipe.hpp: The JSON text ... members} {recipe.hpp: "task" (null ... "drone"} and the fields of the batch.
    {recipe.hpp: Missing members}. `DroneVectorEnv.recipe` returns the recipe of an env; `DroneVectorEnv.from_recipe`
    makes an env from one.

    Parameters
    ----------
    task
        A configuration of one of the engine's tasks or a `NativeTask`, whose defaults the recipe takes; the id of your
        own task; or None for a batch without a task.
    """

    task: _EngineTask | str | None
    worlds: list[str]
    @property
    def drone(self) -> str | DroneModel:
        """{recipe.hpp: The name of a ... file}, or a `DroneModel`."""

    @drone.setter
    def drone(self, drone: _DroneLike) -> None: ...
    # fields of Recipe
    def __init__(
        self,
        task: _EngineTask | NativeTask | str | None = None,
    ) -> None: ...
    @staticmethod
    def from_json(text: str) -> Recipe:
        """Return the recipe of a JSON text; no file is opened.

        Raises
        ------
        ValueError
            A member is unknown or misspelt, or has a wrong type or value. The message names its place.
        """

    def to_json(self) -> str:
        """Return a JSON text from which `from_json` makes an equal recipe."""

    def _set(self, **fields: Any) -> None: ...
    def check_access(self, scenes: str | PathLike[str], allow_files: bool = False, max_worlds: int = 10000) -> None:
        """Raise `ValueError` if the recipe may not be built: see `Batch.from_recipe`. ``scenes``: the bundled ones."""

class Batch:
    """Steps E envs together. Each has M drones and is in one of W worlds. There are N = E M drone slots.

    Arrays that are properties are read-only views unless documented as copies. The next call overwrites them, and they
    keep their memory alive. When the batch grows (see `spawn`, `set_lidar`, `set_camera`), its arrays move: properties
    then return views of the new arrays, and older views keep their last values. `generation` counts this. Drone d
    belongs to env d // M. Masks are bool: (E,) for calls about envs (`reset`, `seed`, `begin_episode`, `set_world`),
    (N,) for all others. None selects every active drone or env. R, the number of rows of actions and rewards, is N or
    E, depending on the task's `TaskSpec.row`. Only one thread may call a batch at a time. A batch does not survive a
    fork: in a child process it raises `RuntimeError`.

    ``tracer="auto"`` chooses for each sensor, and results differ only by rounding. Fans of at least 6 beams that are at
    most 1 m apart on average at the end of their range are traced as slices of the world. A fan is a channel whose
    beams lie in a plane, of a LiDAR with at most three channels, or a column of channels with one beam each. Cameras
    and dense LiDARs of at least 256 rays go through a tree of triangles in tiles of 16 x 16 rays, in worlds of at most
    1,024 triangles per ray; in larger worlds packets are faster. A LiDAR is dense if it has at least four rows, and any
    sixteen neighbouring beams of a row span at most about 50 degrees. The tree takes about 65 bytes per triangle.
    Embree traces all other rays, in packets.

    Parameters
    ----------
    worlds
        A `World`, the name or path of one, a set of `flockstep.scenes` such as ``"train"``, or a sequence of at least
        one of these; or a `WorldPool`, from which each `reset` and each new episode draws a world. A pool requires a
        task; until their first reset all drones are in world 0 of the pool. With a pool, ``camera_backend="gl"`` is
        refused.
    num_drones
        N, up to 2**20, a multiple of ``drones_per_env``. 0 without a task: the batch begins with no drone, and `spawn`
        adds them. Each then has its own env, or all share one env with ``drones_per_env=0``.
    task
        The task that `reset` and `step` run. The navigation task requires a LiDAR, and a camera if it observes one.
    drone
        A `DroneModel`, the name of a bundled airframe, or the path of a JSON file. Default: the 650-class quadrotor.
    world_index
        (E,) integers: the world of each env. Default: env i is in world i modulo W.
    """

    def __init__(
        self,
        worlds: WorldsLike | WorldPool,
        num_drones: int = 1,
        *,
        task: _EngineTask | NativeTask | PythonTask | None = None,
        drone: _DroneLike | None = None,
        world_index: npt.ArrayLike | None = None,
        **fields: Changes[Batch],
    ) -> None: ...
    @staticmethod
    def from_recipe(
        recipe: Recipe,
        worlds: WorldsLike | WorldPool | None = None,
        task: NativeTask | PythonTask | None = None,
        *,
        allow_files: bool = False,
        max_worlds: int = 10000,
    ) -> Batch:
        """Make a batch from a recipe.

        Parameters
        ----------
        recipe
            The recipe.
        worlds, task
            Objects that replace the recipe's worlds and task.
        allow_files
            Allow worlds and drones from files outside the folder of bundled scenes.
        max_worlds
            What the worlds of the recipe may cost, in playgrounds: a forest counts as 30, an office, warehouse or city
            as 100, with moving objects as 200.

        Raises
        ------
        ValueError
            The recipe is invalid, a path is not allowed, or there are too many worlds.
        RuntimeError
            The system refuses the threads. The message names its limits.
        """

    @property
    def num_envs(self) -> int:
        """Number of envs, E."""

    @property
    def drones_per_env(self) -> int:
        """Number of drones per env, M."""

    @property
    def num_drones(self) -> int:
        """Number of drones, N."""

    @property
    def num_rotors(self) -> int:
        """Number of columns of `rotor_speed`: that of the airframe with most rotors, at least 4."""

    @property
    def dynamics(self) -> DynamicsConfig:
        """Motion model and meaning of the commands; a copy."""

    @property
    def clock(self) -> ClockConfig:
        """The rates, with defaults filled in; a copy."""

    @property
    def variations(self) -> list[Variation]:
        """Laws of the numbers that differ from drone to drone; a copy."""

    @property
    def airframes(self) -> list[str]:
        """Drones whose airframes an episode draws from, empty for that of ``drone`` alone; a copy."""

    @property
    def generation(self) -> int:
        """Number of times that the arrays have moved, from 0; older views no longer change."""

    @property
    def num_threads(self) -> int:
        """Number of threads that step the batch, the caller's included."""

    @property
    def embree_rays(self) -> int:
        """Number of rays traced against triangles with Embree since the batch was made, shadow rays included.

        It counts rays of LiDARs and of cameras rendered by ``raycast``. Rays that are tested only against primitives
        are not counted.
        """

    @property
    def embree_packets(self) -> int:
        """Number of packets in which the rays of `embree_rays` were traced; it may depend on the number of threads."""

    @property
    def worlds(self) -> list[World]:
        """The W worlds, indexed by `world_index`. With a `WorldPool` it raises `AttributeError`: use `world_of`."""

    def world_of(self, index: int) -> World:
        """Return the world of a drone, in the light of its env."""

    @property
    def drone(self) -> DroneModel:
        """The model of all drones."""

    # arrays of Batch
    @property
    def rotation(self) -> _F32:
        """(N, 3, 3): rotation matrices of `quat_wxyz`, as a new array; the columns are the body's axes in the world frame.

        Row 2 is the world's up in the body frame: ``batch.rotation[:, 2]``.
        """

    @property
    def sensed_rotation(self) -> _F32:
        """(N, 3, 3): rotation matrices of `sensed_quat_wxyz`, as a new array."""

    @property
    def bodies(self) -> Bodies:
        """The bodies of all envs."""

    @property
    def contact(self) -> Contact:
        """Contacts of the last motion."""

    @property
    def lidars(self) -> list[LidarConfig]:
        """Configurations of the LiDARs of each drone; copies. `Lidar.config_of` has the changes for one drone."""

    @property
    def cameras(self) -> list[CameraConfig]:
        """Configurations of the cameras of each drone; copies. `Camera.config_of` has the changes for one drone."""

    # lists of sensors

    @property
    def lidar_name(self) -> str | None:
        """Name of the first LiDAR; None without one."""

    def lidar(self, name: str | None = None) -> Lidar:
        """Return a LiDAR by name, by default the first one. Raises `ValueError` if there is none."""

    def sensor(self, name: str) -> dict[str, Any]:
        """Return the arrays that a sensor publishes: read-only views by their names, such as ``"accelerometer"``.

        Sensors have the name of their configuration; the pose sensor is ``"pose"``. If sensors of two kinds share a
        name, write the kind before it: ``"imu.front"``.
        """

    def set_pose(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
        *,
        rows: npt.ArrayLike | None = None,
    ) -> None:
        """Teleport to positions (N, 3) m and quaternions (N, 4), at rest, without a collision check.

        One row, such as ``[1, 2, 3]``, places all drones. Without positions they stay in place. Without quaternions,
        drones with simulated rotors are level and face +x (yaw 0), so that no episode begins with the tilt of the last
        crash; kinematic drones keep their attitude. With ``rows`` (K,), the indices of drones, the arrays have K rows,
        for these drones.
        """

    def is_free(
        self,
        position: npt.ArrayLike,
        quat_wxyz: npt.ArrayLike | None = None,
        *,
        rows: npt.ArrayLike | None = None,
    ) -> _Bool:
        """Test poses: True (K,) {batch.hpp: if the drone would ... nor a body} nor another drone.

        Other drones count if the drones of an env touch each other, except those that begin an episode in the same
        step and have not been placed yet.

        Positions are (K, 3) m; quaternions (K, 4) are level, facing +x, by default. ``rows`` (K,) are the indices of
        drones, by default all.
        """

    def move(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> Contact:
        """Fly to positions (N, 3) m and quaternions (N, 4) in a straight line and along the shortest arc.

        None leaves a value unchanged. One row is for all drones. A drone that touches something stops at its last free pose.
        """

    def set_velocity(
        self,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        rotor_speed: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
        *,
        rows: npt.ArrayLike | None = None,
    ) -> None:
        """Set velocities (N, 3) m/s, angular velocities (N, 3) rad/s and rotor speeds (N, R) rad/s.

        R is `num_rotors`. Velocities are in the world frame, angular velocities in the body frame. None leaves a value unchanged. One row
        is for all drones. A drone may turn by at most half a turn per tick: angular velocities above pi times
        `physics_hz` raise `ValueError`. After `set_pose` {batch.hpp: a drone is at rest}. With ``rows`` (K,), the
        indices of drones, the arrays have K rows, for these drones.
        """

    def set_params(self, params: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> None:
        """Set what differs from drone to drone: rows (N, P) like `params`, whose columns are `parameter_names`.

        They last until the next draw. One row is for all drones. Only parameters in ``variations`` may be other than
        their defaults; otherwise, and for a drone that cannot be integrated, `ValueError` names the parameter, and
        nothing changes.
        """

    def set_variations(self, variations: list[Variation]) -> None:
        """{batch.hpp: Replaces the laws}.

        {batch.hpp: The list has to be}. Otherwise `ValueError` names the parameter, and nothing changes.
        """

    def fly(
        self,
        command: npt.ArrayLike,
        ticks: int | None = None,
        mask: npt.ArrayLike | None = None,
        control: str | None = None,
    ) -> Contact:
        """Fly {batch.hpp: a command ... number of ticks}, by default for one step.

        ``control`` defines what the command means, for this call; None means `DynamicsConfig.control`. The flight
        is bit-identical to one of a batch configured with this control. Drones can hit obstacles; see
        `DynamicsConfig.on_contact`. Sensors are not read. Gusts and the controller follow each env's clock. Splitting a flight into several calls
        changes the result only by rounding, unless `DynamicsConfig.downwash` is True: each call computes the wash
        again. A drone that becomes too fast to integrate stays at its last position until the call ends, at rest, with
        a `RuntimeWarning`; in a task its episode ends as a bad state.

        Ctrl-C ends a long flight between two ticks. Drones near obstacles may then have flown fewer ticks than others,
        and `tick` does not count the interrupted part.

        Raises
        ------
        ValueError
            A number is beyond +-2e6, a roll or pitch beyond +-pi, or a yaw beyond +-10,000 rad; or ``control="pose"``.
            A yaw of more than two turns, which may be in degrees, gives a `RuntimeWarning` once.
        RuntimeError
            The motion is kinematic; or ``control`` is None and the batch was made with ``control="pose"``.
        """

    @property
    def flown(self) -> _F32:
        """A copy of what a flight changes, (N, 24): {batch.hpp: position, velocity ... rotor speeds}.

        Setting it {batch.hpp: Puts drones whose ... check}.
        """

    @flown.setter
    def flown(self, rows: npt.ArrayLike) -> None: ...
    def pullback(
        self, before: npt.ArrayLike, command: npt.ArrayLike, d_after: npt.ArrayLike, ticks: int = 1
    ) -> tuple[_F32, _F32]:
        """Return derivatives by a state and by the command that `fly` takes from there, one step back.

        ``d_after`` (N, 24) are its derivatives by the state after the step; states are rows like `flown`. {batch.hpp:
        The equations of flight are differentiated ... no part}. `flockstep.torch.fly` calls it in a backward pass.

        Raises
        ------
        ValueError
            The control has no derivative, commands may be late, or a number is not finite.
        RuntimeError
            The motion is kinematic.
        """

    def sense(self, mask: npt.ArrayLike | None = None) -> None:
        """Read the sensors at the current poses. Cameras render if their capture mode requires it."""

    def spawn(
        self,
        indices: npt.ArrayLike | None = None,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        world_index: npt.ArrayLike | None = None,
        *,
        env: npt.ArrayLike | None = None,
    ) -> npt.NDArray[np.int64]:
        """Activate slots (K,) at positions (K, 3) m, quaternions (K, 4), in worlds (K,), and `sense` there.

        The drones are new and placed there as by `set_pose`. Their slots are ``indices``, {batch.hpp: or else the lowest
        inactive ... the batch}. {batch.hpp: Missing slots are ... d = e M + m}. With a task, the drones of an env begin
        their episodes together, except with ``episodes="each"``: name all that are active or finished.

        Returns
        -------
        (K,) the indices of the drones.
        """

    def remove(self, indices: npt.ArrayLike) -> None:
        """Deactivate slots (K,). Later calls spend no time on them.

        Their ranges become inf, and they keep their last pose. Their frames are stale and black, with depths of inf.
        """

    def set_world(self, world_index: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> None:
        """Put envs into worlds (E,); their drones keep their coordinates.

        With a `WorldPool`, this method and ``world_index`` of `spawn` raise an error.
        """

    def set_light(
        self,
        light: int | Light | None = None,
        envs: npt.ArrayLike | None = None,
        *,
        world_index: int | None = None,
        tint: npt.ArrayLike | None = None,
        **fields: Changes[Light],
    ) -> None:
        """Change the light of some envs, or that of one of the `worlds`.

        ``set_light(light, envs)`` gives envs a `Light` of their own, ``set_light(envs=..., gamma=1.5)`` changes fields
        of their current ones, and ``set_light(envs=...)`` lets them show the lights of their worlds again. An own light
        stays until the next call: `reset` and `set_world` keep it, and `snapshot` holds it. If the batch has
        ``lights``, it stays until the next episode draws one. ``world_of(i).light`` is the current light of drone i's
        env.

        ``set_light(k, gamma=1.5)``, with the index of a world, changes its light for all envs in it that have no light
        of their own: ``worlds[k]`` becomes ``worlds[k].with_light(...)``; the original world object and other batches
        that use it do not change. This light is part of the configuration that `restore` checks: it refuses a snapshot
        that was taken in another light of the worlds.

        Frames of these envs are stale until they are rendered again; nothing else changes. With the camera backend
        ``gl``, every new pair of world and light is copied to the device.

        Parameters
        ----------
        light
            A `Light`, or the index of a world, also as ``world_index``.
        envs
            A bool mask (E,), indices of envs, or one index. None: all envs.
        **fields
            Fields of `Light` that change, as in `World.with_light`; None leaves one unchanged.
        tint
            Factors of the current colours of the world's materials, as in `World.with_light`; only for a world.

        Raises
        ------
        ValueError
            A value is out of its limits, there is no such world or env, or ``light`` is the index of a world and the
            worlds come from a `WorldPool`, because the next episode would draw a world with its own light.
        RuntimeError
            The call comes from a task while its batch steps or resets.
        """

    def set_lidar(
        self,
        mask: npt.ArrayLike | None = None,
        lidar: str | None = None,
        **fields: Changes[LidarConfig],
    ) -> None:
        """Change a LiDAR of some drones from the next `sense` on; None leaves a value unchanged.

        ``errors`` replaces all errors. A width of beams is refused if the LiDAR was made without one, and errors that
        depend on surfaces if it was made without any and without outputs: they need memory.

        ``beams`` and ``channels`` concern all drones, so the mask must not leave one out, and move the arrays (see
        `generation`). The LiDAR has then not scanned yet. They are refused with a task or a pattern of beams.
        """

    def camera(self, name: str | None = None) -> Camera:
        """Return one camera: its images and configuration.

        If there is only one camera, this and the following methods need no name. Raises `ValueError` if there is no
        camera of this name, or if there are several and no name is given.
        """

    def capture(self, mask: npt.ArrayLike | None = None, camera: str | None = None) -> None:
        """Render now, whatever the capture mode is."""

    def set_capture_mode(self, mode: str, camera: str | None = None) -> None:
        """Change the capture mode: ``"every_step"``, ``"on_movement"`` or ``"on_demand"``.

        Raises `ValueError` for ``"on_demand"`` if the task observes the camera.
        """

    def set_camera(
        self,
        mask: npt.ArrayLike | None = None,
        camera: str | None = None,
        **fields: Changes[CameraConfig],
    ) -> None:
        """Change one camera of some drones; None leaves a value unchanged.

        Their frames are stale until they are rendered again. {camera.hpp: Setting only one}. ``width_px`` and
        ``height_px`` concern all drones, so the mask must not leave one out, and move the arrays (see `generation`).
        They are refused with a task.
        """

    def set_move_line_visible(self, visible: bool, mask: npt.ArrayLike | None = None) -> None:
        """Show or hide the move lines of drones: the paths that they fly.

        While a drone's line is visible, the batch records the drone's position after each `step`, `fly` and `move`, and
        `picture` and `DroneVectorEnv.render` draw the line in green. Hiding a line discards it, and so does `remove`.
        Observations do not change, and a snapshot contains no lines.
        """

    def set_beams_visible(self, visible: bool, mask: npt.ArrayLike | None = None) -> None:
        """Show or hide the beams of the LiDARs of drones, in `picture` and the views of `DroneVectorEnv.render`.

        `picture` takes a new scan, and draws each beam in orange up to its hit, or as long as the LiDAR's range.
        Observations do not change. `remove` hides the beams, and a snapshot does not contain the flags.
        """

    def move_line(self, index: int) -> _F32:
        """Return the visible move line of a drone: positions (K, 3) m, world frame, oldest first, as a new array.

        A row of NaN separates two pieces of the line. A new piece begins wherever the drone is placed: by `set_pose`, a
        reset or the automatic reset in a `step`, `spawn` or `restore`. A drone that comes into another world begins a
        new line. K is at most 4096. A line that needs more rows first loses its oldest pieces; a line of one piece
        loses every other row, and is then recorded half as often. The last row is always the newest position.
        """

    def picture(self, index: int, camera: str | None = None) -> _U8:
        """Return the frame of one drone, rgb or otherwise grey, with lines: (height, width, 3), as a new array.

        The visible move lines and beams of all drones of its env are drawn wherever the world does not hide them, two pixels wide in
        an image of 640 pixels. The camera's own images do not change.

        Raises
        ------
        ValueError
            The camera writes neither output, the frame is stale, or the index is out of range.
        """

    def camera_backend_report(self) -> str:
        """Return the camera backend in use and the reason for it."""

    def seed(self, seeds: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> None:
        """Set the env seeds (E,) uint64 and set the episode counters to 0. With a task, `reset` does this."""

    def begin_episode(self, mask: npt.ArrayLike | None = None) -> None:
        """Advance the episode counters. With a task, `reset` and `step` do this."""

    def random(
        self, stream: int, count: int, rows: npt.ArrayLike | None = None, row_kind: Literal["env", "drone"] = "env"
    ) -> _F32:
        """Return uniform numbers in [0, 1), (E, count), as a new array.

        They depend only on the env's seed, its episode and the stream (from 0 to 2**31 - 1). Drawing does not change
        any state. With ``rows`` (K,), the indices of envs, it draws only the numbers of these envs, (K, count).

        With ``row_kind="drone"`` the rows are drones: (N, count), or (K, count) with the indices of drones. Each drone
        of an env then has other numbers; those of the first are the env's. In `Task.reset` with ``episodes="each"``,
        draw these: the numbers of an env stay the same while its drones begin their episodes one by one.
        """

    @property
    def rows(self) -> npt.NDArray[np.int64]:
        """Indices of the rows whose episodes begin, in `Task.reset`: those of its mask, sorted. Elsewhere all rows."""

    def reset(self, seeds: npt.ArrayLike | None = None, mask: npt.ArrayLike | None = None) -> None:
        """Begin new episodes of the task.

        With ``seeds`` (E,) uint64, each env begins the first episode of its new seed. Without, each begins its next
        episode.

        With ``episodes="each"`` and without seeds, the mask may have a flag for each drone (N,): {batch.hpp: the
        selected drones begin}. With ``episodes="last"`` it may too: {batch.hpp: an env begins its next}.

        Raises
        ------
        RuntimeError
            The batch has no task.
        """

    def step(self, actions: npt.ArrayLike) -> None:
        """Fly one step of the task, or ``frame_skip`` steps, with actions (R, ...) as declared by `spec`.

        Two slots of outputs alternate: the arrays of one step, such as `observation`, stay intact during the next step.

        Raises
        ------
        RuntimeError
            The batch has no task, or `reset` has not been called.
        """

    def set_controller(self, controller: Callable[[_F32, int], npt.ArrayLike] | None) -> None:
        """Let a function command the rotors in `step`; None: the built-in controller again.

        {batch.hpp: Before each tick it ... rad/s}. The function may read the batch. If it raises, reset every env.
        {batch.hpp: A snapshot does not hold}.

        Raises
        ------
        ValueError
            The control is ``"pose"``, or commands may be late.
        RuntimeError
            The batch has no task, or the motion is kinematic.
        """

    @property
    def waiting(self) -> _Bool:
        """(R,), a new array: True if the row takes no part in the next step.

        Either that step only begins the row's next episode, or the drone has finished, with ``episodes="last"``.
        """

    @property
    def spec(self) -> TaskSpec:
        """The declarations of the task."""

    @property
    def path(self) -> _F32:
        """(N, ticks + 1, 3) m: positions {batch.hpp: before the last ... ticks}, as a new array.

        Between two of them a drone moves almost straight. Recorded for tasks that declare ``records_path``.
        """

    @property
    def observation(self) -> Any:
        """(R, ...): observation after any resets, or a dict of arrays if the task observes several fields.

        You may overwrite it; the batch never reads it.
        """

    @property
    def final_observation(self) -> Any:
        """Last observation of an episode, with the layout of `observation`; valid if `terminated` or `truncated`."""

    @property
    def terms(self) -> Terms:
        """Terms of the engine's tasks, such as distance to the goal and clearance."""

    @property
    def task_state(self) -> dict[str, Any]:
        """The arrays of the task by their names, read-only views.

        For example ``goal_index`` of the navigation tasks, or ``phase`` (N, 9) of Track, as fractions of a full turn.
        """

    def snapshot(self) -> bytes:
        """Return the complete state of the batch, from which `restore` continues."""

    def restore(self, blob: bytes) -> None:
        """Restore a snapshot.

        Raises `ValueError` and changes nothing if the snapshot is corrupt or belongs to another configuration.
        """

@final
class GreenBlob:
    """The green pixels of an image and the box around them."""

    @property
    def found(self) -> bool:
        """True if any pixel is green."""

    @property
    def x(self) -> int:
        """Column of the box's first pixel, from the left."""

    @property
    def y(self) -> int:
        """Row of the box's first pixel, from the top."""

    @property
    def width(self) -> int:
        """Width of the box in pixels. All numbers are 0 if no pixel is green."""

    @property
    def height(self) -> int:
        """Height of the box in pixels; 0 if no pixel is green."""

    @property
    def offset(self) -> float:
        """Horizontal offset of the box's centre from the image's centre, in [-1, 1], positive to the right.

        The unit is half the image's width.
        """

    @property
    def area(self) -> float:
        """Area of the box divided by that of the image."""

    @property
    def mask(self) -> _Bool:
        """(height, width): True for green pixels."""

def green_blob(image: npt.NDArray[np.uint8], layout: str = "hwc") -> GreenBlob:
    """Find the green pixels as in the camera task, G > 1.25 * max(R, B) + 16, and the box around them.

    Parameters
    ----------
    image
        uint8 of shape (height, width, 3), or (3, height, width) with the layout ``"chw"``.
    """

@final
class ColorBlob:
    """Position of a colour in images: the box around all pixels of this colour.

    Each array has the images' leading shape: () for one image, (N,) for N. All numbers are 0 if no pixel has the
    colour.
    """

    @property
    def found(self) -> _Bool:
        """True if any pixel has the colour."""

    @property
    def x(self) -> npt.NDArray[np.int32]:
        """Column of the box's first pixel, from the left."""

    @property
    def y(self) -> npt.NDArray[np.int32]:
        """Row of the box's first pixel, from the top."""

    @property
    def width(self) -> npt.NDArray[np.int32]:
        """Width of the box in pixels."""

    @property
    def height(self) -> npt.NDArray[np.int32]:
        """Height of the box in pixels."""

    @property
    def offset(self) -> _F32:
        """Horizontal offset of the box's centre from the image's centre, in [-1, 1], positive to the right.

        The unit is half the image's width.
        """

    @property
    def area(self) -> _F32:
        """Area of the box divided by that of the image."""

    @property
    def mask(self) -> _Bool:
        """(..., height, width): True for pixels of the colour."""

def formation_places(shape: str, count: int, spacing_m: float = 1.5) -> _F32:
    """Return the places of the drones of a formation relative to a leader that flies in direction +x, (count, 3) m.

    Parameters
    ----------
    shape
        ``"line"``: abreast of the leader, alternately left and right. ``"column"``: one behind the other. ``"v"``:
        behind the leader, alternately left and right, on two lines at 45 degrees. ``"circle"``: around the leader, the
        first in front of it.
    count
        Number of drones. The leader is not one of them.
    spacing_m
        Distance between neighbouring places, and minimum distance to the leader. On a circle of fewer than six drones
        the places are farther apart.
    """

def color_blob(image: npt.NDArray[np.uint8], color: ColorRange, layout: str = "hwc") -> ColorBlob:
    """Find a colour in images, as the camera task does: the box around all pixels of this colour.

    Parameters
    ----------
    image
        rgb, uint8 of shape (..., height, width, 3), or (..., 3, height, width) with the layout ``"chw"``: one image, or
        many, as ``batch.camera().rgb``.
    color
        The colour.

    Raises
    ------
    ValueError
        The image has another dtype or shape, the layout is unknown, or the range is outside [0, 255].
    """

@final
class ColorComponents:
    """The K connected components of a colour in an image, in the order of their labels."""

    @property
    def box(self) -> npt.NDArray[np.int32]:
        """(K, 4): x and y of the first pixel from the upper left, width, height; pixels."""

    @property
    def centroid(self) -> npt.NDArray[np.float64]:
        """(K, 2): x, y in pixels from the upper left corner; mean of the pixels' centres, which are at + 1/2."""

    @property
    def area_px(self) -> npt.NDArray[np.int32]:
        """(K,): number of pixels."""

    @property
    def labels(self) -> npt.NDArray[np.int32]:
        """(height, width): 0 for pixels without the colour, k + 1 in component k."""

def color_components(image: npt.NDArray[np.uint8], color: ColorRange, layout: str = "hwc") -> ColorComponents:
    """Find the connected components of a colour in an image with OpenCV; pixels that touch at a corner are connected.

    Parameters
    ----------
    image
        rgb, uint8 of shape (height, width, 3), or (3, height, width) with the layout ``"chw"``.
    color
        The colour.

    Raises
    ------
    ValueError
        The same conditions as in `color_blob`.
    """

def plan(
    world: WorldLike,
    start: npt.ArrayLike,
    goals: npt.ArrayLike,
    drone: _DroneLike | None = None,
    cell_m: float = 0.1,
    progress: Callable[[float], object] | None = None,
) -> _F32 | None:
    """Plan a path as `flockstep.plan` does.

    ``progress`` is called ten times a second with the finished share, in [0, 1].
    """
