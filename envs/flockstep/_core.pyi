"""The native module.

SI units; the world frame is right-handed with z up, the body frame x forward, y left, z up; quaternions are
``(w, x, y, z)``, body to world. Arrays are float32 unless said otherwise. ``N`` is the number of drones of a batch.

Bad input raises `ValueError` naming the field, what was expected and what came, before anything changes.
"""

from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias, final

import numpy as np
import numpy.typing as npt

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
_MaybeNone: TypeAlias = Any  # a marker is None only if the world lacks it, and who passes one on knows that it has it

__version__: str
embree_version: str
"""Of the Embree library this module was built with, such as ``"4.3.0"``."""
simd_target: str
"""The instruction set that tracing runs on here, such as ``"AVX2"``."""
scene_sets: dict[str, tuple[str, ...]]
"""The names that stand for several scenes, and their scenes."""
scene_suffixes: tuple[str, ...]
"""The suffixes of files that `World.load` reads, such as ``".json"``."""
engine_tasks: dict[str, type]
"""The configurations of the engine's tasks, by the names that recipes use."""
generated_scenes: tuple[str, ...]
"""The names of scenes that are generated instead of loaded."""
scene_generators: tuple[str, ...]
"""The words that may stand before ``/seed-7`` in the name of a scene."""

@final
class LidarConfig:
    """A scanning LiDAR: a grid of channels x beams, or a beam pattern.

    Parameters
    ----------
    name
        Name for `Batch.lidar`, unique among the LiDARs. Values: letters, digits, _ and -. Default: 'lidar'.
    channels
        Rows, spread over ``vfov_deg`` from -vfov/2 to +vfov/2, both ends included; a single one has elevation 0.
        Values: [1, 262144]. Default: 1.
    beams
        Beams of a channel, counter-clockwise from -hfov/2 to +hfov/2, both ends included (at 360 the end is left out).
        A drone has at most 262144 beams in all channels. Values: [1, 262144]. Default: 35.
    hfov_deg
        Horizontal field of view. Values: (0, 360] deg. Default: 270.0.
    vfov_deg
        Vertical field of view. Values: [0, 180] deg. Default: 0.0.
    max_range_m
        Maximum range. Anything farther is a miss: inf in metres, 1 when normalised. Values: > 0 m. Default: 3.0.
    offset_m
        Position of the sensor (x, y, z) in the body frame. Values: within +-100 m. Default: [0.0, 0.0, 0.0].
    quat_wxyz
        Rotation (w, x, y, z) from the sensor's frame to the body frame; normalised if it is close to a unit quaternion.
        Values: a unit quaternion. Default: [1.0, 0.0, 0.0, 0.0].
    azimuth_deg
        Azimuths of a pattern of beams, which replaces the grid; a scan then has the shape (1, length). ``channels``,
        ``hfov_deg`` and ``vfov_deg`` keep their defaults, ``beams`` may also be the length. Values: within +-360 deg.
        Default: [].
    elevation_deg
        Elevations of the pattern, as many as azimuths. Values: within +-90 deg. Default: [].
    rate_hz
        Readings per second of simulated time; it has to divide the ticks per second of the `ClockConfig`. None: one
        reading after every flown step. Values: > 0 Hz. Default: None.
    """

    # fields of LidarConfig
    __match_args__: ClassVar[tuple[str, ...]]
    name: str
    channels: int
    beams: int
    hfov_deg: float
    vfov_deg: float
    max_range_m: float
    offset_m: Sequence[float]
    quat_wxyz: Sequence[float]
    azimuth_deg: Sequence[float]
    elevation_deg: Sequence[float]
    rate_hz: float | None
    def __init__(
        self,
        *,
        name: str = "lidar",
        channels: int = 1,
        beams: int = 35,
        hfov_deg: float = 270.0,
        vfov_deg: float = 0.0,
        max_range_m: float = 3.0,
        offset_m: Sequence[float] = (0.0, 0.0, 0.0),
        quat_wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        azimuth_deg: Sequence[float] = (),
        elevation_deg: Sequence[float] = (),
        rate_hz: float | None = None,
    ) -> None: ...
    # end of fields
    @property
    def shape(self) -> tuple[int, int]:
        """(channels, beams) of one scan."""

@final
class CameraConfig:
    """A pinhole camera. Its frame: x along the optical axis, y left, z up; the centre of the image is where the axis is.

    Parameters
    ----------
    name
        Name for `Batch.camera`, unique among the cameras. Values: letters, digits, _ and -. Default: 'front'.
    width_px
        Width of the rendered image. Values: [1, 8192] px. Default: 640.
    height_px
        Height of the rendered image. Values: [1, 8192] px. Default: 480.
    hfov_deg
        Horizontal field of view. If only one of the two is given, pixels are square and the other follows; it has to be
        below 179, too. If neither is given, this one is 90. Values: [0.1, 179] deg. Default: None.
    vfov_deg
        Vertical field of view. Values: [0.1, 179] deg. Default: None.
    offset_m
        Position of the sensor (x, y, z) in the body frame. Values: within +-100 m. Default: [0.0, 0.0, 0.0].
    quat_wxyz
        Rotation (w, x, y, z) from the sensor's frame to the body frame; normalised if it is close to a unit quaternion.
        Values: a unit quaternion. Default: [1.0, 0.0, 0.0, 0.0].
    near_m
        Planar depth below which nothing is seen; less than ``far_m``. Values: > 0 m. Default: 0.05.
    far_m
        Planar depth beyond which the sky is seen. Values: (0, 1000000] m. Default: 100.0.
    outputs
        Images to write: names among ``"rgb"``, ``"depth"``, ``"semantic"``, ``"instance"``, ``"normal"``, ``"grey"``,
        ``"hsv"``; at least one. Default: ('rgb',).
    depth_kind
        ``"planar"``: along the optical axis. ``"range"``: from the camera. Default: 'planar'.
    layout
        Shape of rgb, hsv and normal images. ``"hwc"``: (N, H, W, 3). ``"chw"``: (N, 3, H, W). Default: 'hwc'.
    capture_mode
        ``"every_step"``: rendered at every step or `Batch.sense`, or at ``rate_hz``. ``"on_movement"``: at those where
        the drone's pose or world differs from what its frame shows. ``"on_demand"``: by `Batch.capture` only. A reset
        and a change of the camera always render; on demand, the frame is stale until the next capture. Default:
        'every_step'.
    samples_per_pixel
        Samples of a pixel, in a grid, averaged. Only for colours; other outputs show the pixel's centre. Values: 1, 4,
        9 or 16. Default: 1.
    shadows
        Hard shadows of the sun, cast by everything except markers. A room lets the sun in. Default: False.
    rate_hz
        Readings per second of simulated time; it has to divide the ticks per second of the `ClockConfig`. None: one
        reading after every flown step. Values: > 0 Hz. Default: None.
    resize
        (width, height) of the written images, at most ``width_px`` and ``height_px``. None: as rendered. ``fx``,
        ``fy``, ``cx`` and ``cy`` stay those of the rendered image. Not with the outputs semantic, instance and normal,
        which have no mean; hsv is computed from the resized rgb. Unit: px. Default: None.
    pool
        With ``resize``, a pixel of the rendered pixels that it covers. ``"mean"``: weighted by covered area, as
        OpenCV's INTER_AREA. ``"min"``, ``"max"``: the least or greatest of each channel. Depth: mean and max are inf if
        one covered pixel is a miss, min only if all are. Default: 'mean'.
    """

    # fields of CameraConfig
    __match_args__: ClassVar[tuple[str, ...]]
    name: str
    width_px: int
    height_px: int
    hfov_deg: float | None
    vfov_deg: float | None
    offset_m: Sequence[float]
    quat_wxyz: Sequence[float]
    near_m: float
    far_m: float
    outputs: Sequence[str]
    depth_kind: Literal["planar", "range"]
    layout: Literal["hwc", "chw"]
    capture_mode: Literal["every_step", "on_movement", "on_demand"]
    samples_per_pixel: int
    shadows: bool
    rate_hz: float | None
    resize: Sequence[int] | None
    pool: Literal["mean", "min", "max"]
    def __init__(
        self,
        *,
        name: str = "front",
        width_px: int = 640,
        height_px: int = 480,
        hfov_deg: float | None = None,
        vfov_deg: float | None = None,
        offset_m: Sequence[float] = (0.0, 0.0, 0.0),
        quat_wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        near_m: float = 0.05,
        far_m: float = 100.0,
        outputs: Sequence[str] = ["rgb"],
        depth_kind: Literal["planar", "range"] = "planar",
        layout: Literal["hwc", "chw"] = "hwc",
        capture_mode: Literal["every_step", "on_movement", "on_demand"] = "every_step",
        samples_per_pixel: int = 1,
        shadows: bool = False,
        rate_hz: float | None = None,
        resize: Sequence[int] | None = None,
        pool: Literal["mean", "min", "max"] = "mean",
    ) -> None: ...
    # end of fields
    def __eq__(self, other: object, /) -> bool: ...
    @property
    def fx(self) -> float:
        """Pixels per unit of slope, across."""

    @property
    def fy(self) -> float:
        """Pixels per unit of slope, down."""

    @property
    def cx(self) -> float:
        """Pixels from the left border to the optical axis."""

    @property
    def cy(self) -> float:
        """Pixels from the upper border to the optical axis."""

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height) of the images that are written: ``resize``, or else ``(width_px, height_px)``."""

@final
class ColorRange:
    """Which colours count: each channel of a pixel is in [low, high]. By default, green as the goal is.

    Parameters
    ----------
    space
        The three channels, 8 bits each, of a pixel as written. ``"rgb"``: red, green, blue. ``"hsv"``: hue in [0, 179],
        half of the degrees (red 0, green 60, blue 120); saturation and value in [0, 255]. ``"excess"``: by how much
        red, green and blue each exceed 1.25 times the larger of the other two, rounded up; 0 if they do not. Light
        scales the channels equally, so ``"excess"`` finds a hue in most light: ``low=(17, 0, 0)`` is red. Default:
        'excess'.
    low
        Least value of each channel. Values: [0, 255]. Default: [0, 17, 0].
    high
        Greatest value of each channel, at least ``low``. A hue wraps around: from 170 to 10 is red. Values: [0, 255].
        Default: [255, 255, 255].
    """

    # fields of ColorRange
    __match_args__: ClassVar[tuple[str, ...]]
    space: Literal["rgb", "hsv", "excess"]
    low: Sequence[int]
    high: Sequence[int]
    def __init__(
        self,
        *,
        space: Literal["rgb", "hsv", "excess"] = "excess",
        low: Sequence[int] = (0, 17, 0),
        high: Sequence[int] = (255, 255, 255),
    ) -> None: ...
    # end of fields
    def __eq__(self, other: object, /) -> bool: ...

class PoseSensorConfig:
    """Exact pose, with optional Gaussian noise.

    Parameters
    ----------
    position_noise_std_m
        Standard deviation of the position along each axis. Values: >= 0 m. Default: 0.0.
    orientation_noise_std_deg
        Standard deviation of each component of the rotation vector. Values: >= 0 deg. Default: 0.0.
    rate_hz
        Readings per second of simulated time; it has to divide the ticks per second of the `ClockConfig`. None: one
        reading after every flown step. Values: > 0 Hz. Default: None.
    """

    # fields of PoseSensorConfig
    __match_args__: ClassVar[tuple[str, ...]]
    position_noise_std_m: float
    orientation_noise_std_deg: float
    rate_hz: float | None
    def __init__(
        self,
        *,
        position_noise_std_m: float = 0.0,
        orientation_noise_std_deg: float = 0.0,
        rate_hz: float | None = None,
    ) -> None: ...
    # end of fields

class EpisodeConfig:
    """When episodes begin and end; the same for every task.

    Parameters
    ----------
    autoreset_mode
        ``"next_step"``: the step after the last one of an episode ignores the action and returns the reset observation,
        reward 0 and flags False. ``"same_step"``: the last step returns the reset observation, and its own is the final
        observation. ``"disabled"``: the caller resets with a mask; a finished env does not change until then. As
        `gymnasium.vector.AutoresetMode`. Default: 'next_step'.
    max_episode_steps
        Time limit in flown steps, after which episodes are truncated. 0: no limit. None: the task's. Values: >= 0.
        Default: None.
    frame_skip
        `Batch.step` repeats its action this many times, or until the episode ends, and returns the summed reward. All
        step counts are in flown steps. Cameras capture only after the last one. Values: [1, 1000]. Default: 1.
    stagger_first_episode
        Spread the first time limits over [1, max_episode_steps], by seed, so that the first episodes do not all end in
        the same step. Default: False.
    random_world
        Each reset draws one of the batch's worlds instead of keeping the env's own. Default: False.
    """

    # fields of EpisodeConfig
    __match_args__: ClassVar[tuple[str, ...]]
    autoreset_mode: Literal["next_step", "same_step", "disabled"]
    max_episode_steps: int | None
    frame_skip: int
    stagger_first_episode: bool
    random_world: bool
    def __init__(
        self,
        *,
        autoreset_mode: Literal["next_step", "same_step", "disabled"] = "next_step",
        max_episode_steps: int | None = None,
        frame_skip: int = 1,
        stagger_first_episode: bool = False,
        random_world: bool = False,
    ) -> None: ...
    # end of fields

class ClockConfig:
    """How time passes: the rates of policy, controller and physics, per second of simulated time.

    Parameters
    ----------
    policy_hz
        Flown steps per second, for each of which the policy decides once. Values: [0.001, 100000] Hz. Default: 10.0.
    physics_hz
        Ticks per second, 1 to 1000 to a flown step. None: one to a flown step; for drones that fly by rotors, as many
        as make at least 500 Hz. Rotors need 50 Hz. Values: > 0 Hz. Default: None.
    controller_hz
        Calls per second of the controller of drones that fly by rotors: a multiple of ``policy_hz`` that divides
        ``physics_hz``. None: one in every tick. Values: > 0 Hz. Default: None.
    """

    # fields of ClockConfig
    __match_args__: ClassVar[tuple[str, ...]]
    policy_hz: float
    physics_hz: float | None
    controller_hz: float | None
    def __init__(
        self,
        *,
        policy_hz: float = 10.0,
        physics_hz: float | None = None,
        controller_hz: float | None = None,
    ) -> None: ...
    # end of fields

@final
class ImuConfig:
    """An inertial measurement unit, for drones that fly by their rotors.

    The accelerometer reads all that accelerates the drone but gravity: +9.81 along the body's z at rest and in hovering, 0 in free
    fall. The noise is that of Kalibr's model: white noise by its density, and a bias that walks with time, from 0 in each
    episode.

    Parameters
    ----------
    name
        Name, unique among the IMUs. Values: letters, digits, _ and -. Default: 'imu'.
    accelerometer_noise_density
        Density of the accelerometer's white noise. Values: >= 0 m/s^2/sqrt(Hz). Default: 0.0.
    accelerometer_random_walk
        Density of the noise that moves the accelerometer's bias, which is 0 when an episode begins. Values: >= 0
        m/s^3/sqrt(Hz). Default: 0.0.
    accelerometer_bias_time_s
        Correlation time of the bias; 0 means a random walk. Values: >= 0 s. Default: 0.0.
    gyroscope_noise_density
        Density of the gyroscope's white noise. Values: >= 0 rad/s/sqrt(Hz). Default: 0.0.
    gyroscope_random_walk
        Density of the noise that moves the gyroscope's bias, which is 0 when an episode begins. Values: >= 0
        rad/s^2/sqrt(Hz). Default: 0.0.
    gyroscope_bias_time_s
        Correlation time of the bias; 0 means a random walk. Values: >= 0 s. Default: 0.0.
    offset_m
        Position of the sensor (x, y, z) in the body frame. Values: within +-100 m. Default: [0.0, 0.0, 0.0].
    quat_wxyz
        Rotation (w, x, y, z) from the sensor's frame to the body frame; normalised if it is close to a unit quaternion.
        Values: a unit quaternion. Default: [1.0, 0.0, 0.0, 0.0].
    rate_hz
        Readings per second of simulated time; it has to divide the ticks per second of the `ClockConfig`. None: one
        reading after every flown step. Values: > 0 Hz. Default: None.
    """

    # fields of ImuConfig
    __match_args__: ClassVar[tuple[str, ...]]
    name: str
    accelerometer_noise_density: float
    accelerometer_random_walk: float
    accelerometer_bias_time_s: float
    gyroscope_noise_density: float
    gyroscope_random_walk: float
    gyroscope_bias_time_s: float
    offset_m: Sequence[float]
    quat_wxyz: Sequence[float]
    rate_hz: float | None
    def __init__(
        self,
        *,
        name: str = "imu",
        accelerometer_noise_density: float = 0.0,
        accelerometer_random_walk: float = 0.0,
        accelerometer_bias_time_s: float = 0.0,
        gyroscope_noise_density: float = 0.0,
        gyroscope_random_walk: float = 0.0,
        gyroscope_bias_time_s: float = 0.0,
        offset_m: Sequence[float] = (0.0, 0.0, 0.0),
        quat_wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        rate_hz: float | None = None,
    ) -> None: ...
    # end of fields

@final
class WindConfig:
    """The wind that drones fly in by their rotors: a mean, and gusts of each drone's own, constant for a flown step.

    Parameters
    ----------
    mean_mps
        Mean wind (x, y, z) in the world frame. Values: within +-1000 m/s. Default: [0.0, 0.0, 0.0].
    gusts
        ``"ornstein_uhlenbeck"``: correlated noise, the same along each axis. ``"dryden"``: the turbulence of
        MIL-F-8785C at low altitude, carried past by the mean wind, at 1 m/s if the mean is less. Default: 'none'.
    gust_std_mps
        Standard deviation of gusts along each axis. Only with ``gusts="ornstein_uhlenbeck"``. Values: [0, 1000] m/s.
        Default: 1.0.
    gust_time_s
        Time in which a gust falls to 1/e. Only with ``gusts="ornstein_uhlenbeck"``. Values: > 0 s. Default: 2.0.
    wind_at_6m_mps
        Wind at 6.1 m (20 ft) above the ground. A tenth of it is the standard deviation upwards. Only with
        ``gusts="dryden"``. Values: [0, 1000] m/s. Default: 5.0.
    height_m
        Height above the ground, which gives the scale lengths, and the strength along and across. Only with
        ``gusts="dryden"``. Values: [3, 300] m. Default: 5.0.
    """

    # fields of WindConfig
    __match_args__: ClassVar[tuple[str, ...]]
    mean_mps: Sequence[float]
    gusts: Literal["none", "ornstein_uhlenbeck", "dryden"]
    gust_std_mps: float
    gust_time_s: float
    wind_at_6m_mps: float
    height_m: float
    def __init__(
        self,
        *,
        mean_mps: Sequence[float] = (0.0, 0.0, 0.0),
        gusts: Literal["none", "ornstein_uhlenbeck", "dryden"] = "none",
        gust_std_mps: float = 1.0,
        gust_time_s: float = 2.0,
        wind_at_6m_mps: float = 5.0,
        height_m: float = 5.0,
    ) -> None: ...
    # end of fields

@final
class DynamicsConfig:
    """How drones move, and what a task or a caller tells them.

    With ``motion="rotors"`` the drone is a rigid body with four rotors (docs/dynamics.md has the equations). What it is told
    are four numbers, whose meaning is ``control``:

    - ``"rotor_speeds"``: rad/s of each rotor, in the order of the airframe.
    - ``"rotor_thrusts"``: N of each rotor, in air at rest.
    - ``"body_rates"``: thrust of all rotors over the mass, m/s^2; body rates about x, y, z, rad/s. Also called CTBR.
    - ``"attitude"``: thrust m/s^2; roll, pitch, yaw, rad.
    - ``"acceleration"``: m/s^2 in the world frame; yaw rad.
    - ``"velocity"``: m/s in the world frame; yaw rate rad/s.
    - ``"heading_velocity"``: m/s forward, left and up; yaw rate rad/s.
    - ``"position"``: m in the world frame; yaw rad.
    - ``"pose"``: what tasks for kinematic motion tell, a pose to be at by the end of the step: it is flown as a velocity and a
      yaw rate.

    Parameters
    ----------
    motion
        ``"kinematic"``: straight to the setpoint. ``"rotors"``: by forces, which needs a drone with an airframe.
        Default: 'kinematic'.
    control
        Meaning of commands; kinematic motion takes only ``"pose"``. Default: 'pose'.
    integrator
        Method for the equations of motion. ``"midpoint"``: second order; rotor speeds and attitude by their closed
        forms. ``"rk4"``: fourth order. ``"automatic"``: rk4 for rotor speeds and thrusts if ticks are not longer than
        twice the rotors' lag, otherwise midpoint. Default: 'automatic'.
    on_contact
        ``"terminate"``: the drone stays where it hit, and its episode ends with the step. ``"stop"``: the point that
        touches stops, and the drone flies on. ``"bounce"``: the drone is thrown back and flies on. Default:
        'terminate'.
    restitution
        Speed away from the surface over speed towards it, in a bounce. Values: [0, 1]. Default: 0.3.
    friction
        Coulomb's coefficient of friction, in a bounce. Values: [0, 10]. Default: 0.5.
    rotor_lag
        Rotors take time to change their speed. Default: True.
    rotor_drag
        Drag and lift of rotors that move through the air. Default: True.
    body_drag
        Drag of the body. Default: True.
    gyroscopic
        Torques of turning rotors on a turning body. Default: True.
    ground_effect
        More thrust near surfaces below. Default: False.
    wind
        Wind; none by default. Default: WindConfig().
    max_speed_mps
        Speed limit of the controller. Values: > 0 m/s. Default: 5.0.
    max_acceleration_mps2
        Acceleration limit of the controller. Values: > 0 m/s^2. Default: 8.0.
    max_tilt_deg
        Tilt limit of the controller. Values: (0, 89] deg. Default: 45.0.
    max_rate_dps
        Limit of the controller's rates about x and y. Values: > 0 deg/s. Default: 600.0.
    max_yaw_rate_dps
        Limit of the controller's rate about z. Values: > 0 deg/s. Default: 200.0.
    """

    # fields of DynamicsConfig
    __match_args__: ClassVar[tuple[str, ...]]
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
    wind: WindConfig
    max_speed_mps: float
    max_acceleration_mps2: float
    max_tilt_deg: float
    max_rate_dps: float
    max_yaw_rate_dps: float
    def __init__(
        self,
        *,
        motion: Literal["kinematic", "rotors"] = "kinematic",
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
        ] = "pose",
        integrator: Literal["automatic", "midpoint", "rk4"] = "automatic",
        on_contact: Literal["terminate", "stop", "bounce"] = "terminate",
        restitution: float = 0.3,
        friction: float = 0.5,
        rotor_lag: bool = True,
        rotor_drag: bool = True,
        body_drag: bool = True,
        gyroscopic: bool = True,
        ground_effect: bool = False,
        wind: WindConfig = ...,
        max_speed_mps: float = 5.0,
        max_acceleration_mps2: float = 8.0,
        max_tilt_deg: float = 45.0,
        max_rate_dps: float = 600.0,
        max_yaw_rate_dps: float = 200.0,
    ) -> None: ...
    # end of fields

@final
class NavigationReward:
    """The reward of the navigation task: the sum of these terms, each times its weight.

    l are the LiDAR ranges over the maximum range, |L| their number, M is ``min_clearance``, R is ``goal_reward``.

    Parameters
    ----------
    distance_weight
        Weight of R at the final goal; R * ``waypoint_share`` / number of waypoints at a waypoint; otherwise the
        centimetres gained towards the current goal. Default: 1.0.
    crash_weight
        Weight of -R on a collision; otherwise min(l) - M if min(l) < M, else 0. Default: 1.0.
    free_space_weight
        Weight of sum(l / M - 1) / (|L| / M - |L|), which is 1 in the open. Default: 1.0.
    step_weight
        Weight of -(step number) / ``step_scale``; the first step has number 0. Default: 1.0.
    action_change_weight
        Weight of -1 if the action differs from the last one; the first action counts as a change. Default: 1.0.
    overshoot_weight
        Weight of -R / 10 when x exceeds the current goal's x + ``goal_radius_m``; if it is not 0, the episode ends
        there. Default: 0.0.
    goal_reward
        R. Default: 10000.0.
    waypoint_share
        Share of R that is split among the waypoints. Default: 0.1.
    goal_radius_m
        Distance within which the goal and the waypoints count as reached. Values: > 0 m. Default: 0.5.
    min_clearance
        M, in units of the LiDAR's maximum range. Values: (0, 1). Default: 0.2.
    step_scale
        Steps in which the step term reaches -1. Values: > 0. Default: 3000.0.
    carry_over_distance
        Keep the last distance when the current goal changes, as the thesis's program did. Default: False.
    """

    # fields of NavigationReward
    __match_args__: ClassVar[tuple[str, ...]]
    distance_weight: float
    crash_weight: float
    free_space_weight: float
    step_weight: float
    action_change_weight: float
    overshoot_weight: float
    goal_reward: float
    waypoint_share: float
    goal_radius_m: float
    min_clearance: float
    step_scale: float
    carry_over_distance: bool
    def __init__(
        self,
        *,
        distance_weight: float = 1.0,
        crash_weight: float = 1.0,
        free_space_weight: float = 1.0,
        step_weight: float = 1.0,
        action_change_weight: float = 1.0,
        overshoot_weight: float = 0.0,
        goal_reward: float = 10000.0,
        waypoint_share: float = 0.1,
        goal_radius_m: float = 0.5,
        min_clearance: float = 0.2,
        step_scale: float = 3000.0,
        carry_over_distance: bool = False,
    ) -> None: ...
    # end of fields

@final
class HoverConfig:
    """Catch a drone that is thrown, and hold a point.

    The point is the world's goal marker, or the centre of its bounds where it has none. Episodes begin near it, turned and
    moving anyhow, rotors as in hovering. Actions are float32 (4,), clipped to [-1, 1]; 0 hovers and 1 is the most, by the
    env's ``control``: of rotors, thrust and rates as far as they go, of tilt, acceleration and speed up to the limits of
    `DynamicsConfig`, of position 1 m from where the drone is; yaw up to half a turn from the present heading.

    Observed, float32 (16,), in the body frame, so that the heading does not matter: the way to the point, m (3); velocity,
    m/s (3); the world's up (3); angular velocity, 10 rad/s (3); rotor speeds, -1 slowest, 0 in hovering, 1 fastest (4).

    An episode ends as a crash on a contact, or farther than ``max_distance_m`` from the point. It is a success if it ends
    with no step of the last ``hold_s`` farther than ``hold_m``. d is the distance to the point in metres.

    Parameters
    ----------
    start_offset_m
        Greatest offset of the start from the point along each axis. This and the next three are drawn uniformly up to
        the value. Values: [0, 1000] m. Default: 0.5.
    start_tilt_deg
        Greatest tilt at the start. Values: [0, 180] deg. Default: 90.0.
    start_speed_mps
        Greatest speed at the start, in any direction. Values: [0, 1000] m/s. Default: 2.0.
    start_rate_dps
        Greatest rate at the start, about each axis of the body. Values: [0, 100000] deg/s. Default: 0.0.
    max_distance_m
        Distance from the point beyond which an episode ends as a crash. Values: > 0 m. Default: 6.0.
    hold_m
        Distance within which the point is held. Values: > 0 m. Default: 0.05.
    hold_s
        Time at the end of an episode for which the point has to be held. Values: (0, 1000000] s. Default: 1.0.
    near_weight
        Weight of the reward term exp(-2 d). Default: 1.0.
    hold_weight
        Weight of 1 / (1 + (d / 2 hold_m)^2). Default: 2.0.
    speed_weight
        Weight of minus the speed, m/s. Default: 0.1.
    spin_weight
        Weight of minus the length of the angular velocity, 10 rad/s. Default: 0.1.
    change_weight
        Weight of minus the mean squared difference to the previous action, which is 0 before the first. Default: 0.0.
    crash_weight
        Weight of -1 on a crash. Default: 10.0.
    """

    # fields of HoverConfig
    __match_args__: ClassVar[tuple[str, ...]]
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
    def __init__(
        self,
        *,
        start_offset_m: float = 0.5,
        start_tilt_deg: float = 90.0,
        start_speed_mps: float = 2.0,
        start_rate_dps: float = 0.0,
        max_distance_m: float = 6.0,
        hold_m: float = 0.05,
        hold_s: float = 1.0,
        near_weight: float = 1.0,
        hold_weight: float = 2.0,
        speed_weight: float = 0.1,
        spin_weight: float = 0.1,
        change_weight: float = 0.0,
        crash_weight: float = 10.0,
    ) -> None: ...
    # end of fields

@final
class TrackConfig:
    """Follow a point that moves along a smooth path.

    Paths lie about the world's goal marker, or about the centre of its bounds where it has none. Each episode begins
    somewhere on its path, with the path's velocity and yaw. Actions are those of `HoverConfig`.

    Observed, float32 (15 + 3 ``points``,), in the body frame: the way to where the path is now, ``ahead_s`` later, and so
    on, m (3 ``points``); velocity, m/s (3); the world's up (3); angular velocity, 10 rad/s (3); rotor speeds, -1 slowest, 0
    in hovering, 1 fastest (4); sine and cosine of the yaw that is missing (2).

    An episode ends as a crash on a contact, or farther than ``max_distance_m`` from where the path is. It is a success if
    it ends with a root mean square of d, over all its steps, of at most ``close_m``. d is the distance to where the path is
    now in metres.

    Parameters
    ----------
    path
        ``"figure8"``: level, x = s cos(w t), y = s / 2 sin(2 w t) with s = ``size_m``. ``"random"``: three waves of
        random phases along each axis, up to ``size_m`` in all and half of that in height. Default: 'figure8'.
    yaw
        ``"fixed"``: along the world's x axis. ``"along"``: the way the path goes. Default: 'fixed'.
    size_m
        Size of the path. Values: (0, 1000] m. Default: 1.0.
    speed_mps
        Speed of the path: the mean of a lap of a figure-8, the root mean square of random paths. Values: (0, 1000] m/s.
        Default: 1.5.
    start_offset_m
        Episodes begin off the path, drawn uniformly up to this along each axis. Values: [0, 1000] m. Default: 0.1.
    points
        Number of points of the path that are observed. Values: [1, 20]. Default: 5.
    ahead_s
        Time from one observed point to the next. Values: >= 0 s. Default: 0.1.
    max_distance_m
        Distance from the path beyond which an episode ends as a crash. Values: > 0 m. Default: 1.0.
    close_m
        Greatest root mean square of d of an episode that is a success. Values: > 0 m. Default: 0.05.
    near_weight
        Weight of the reward term exp(-2 d). Default: 1.0.
    close_weight
        Weight of 1 / (1 + (d / close_m)^2). Default: 1.0.
    yaw_weight
        Weight of minus the yaw that is missing, rad. Default: 0.2.
    spin_weight
        Weight of minus the length of the angular velocity, 10 rad/s. Default: 0.02.
    change_weight
        Weight of minus the mean squared difference to the previous action, which is 0 before the first. Default: 0.0.
    crash_weight
        Weight of -1 on a crash. Default: 10.0.
    """

    # fields of TrackConfig
    __match_args__: ClassVar[tuple[str, ...]]
    path: Literal["figure8", "random"]
    yaw: Literal["fixed", "along"]
    size_m: float
    speed_mps: float
    start_offset_m: float
    points: int
    ahead_s: float
    max_distance_m: float
    close_m: float
    near_weight: float
    close_weight: float
    yaw_weight: float
    spin_weight: float
    change_weight: float
    crash_weight: float
    def __init__(
        self,
        *,
        path: Literal["figure8", "random"] = "figure8",
        yaw: Literal["fixed", "along"] = "fixed",
        size_m: float = 1.0,
        speed_mps: float = 1.5,
        start_offset_m: float = 0.1,
        points: int = 5,
        ahead_s: float = 0.1,
        max_distance_m: float = 1.0,
        close_m: float = 0.05,
        near_weight: float = 1.0,
        close_weight: float = 1.0,
        yaw_weight: float = 0.2,
        spin_weight: float = 0.02,
        change_weight: float = 0.0,
        crash_weight: float = 10.0,
    ) -> None: ...
    # end of fields

@final
class NavigationConfig:
    """Fly from the start over the waypoints to the goal.

    Parameters
    ----------
    action
        ``"discrete"``: 0 to 5 for +x, -x, +y, -y, +z, -z by ``step_m`` in the body frame. ``"displacement"``: (3,),
        clipped to [-1, 1], times ``step_m``, body frame. ``"displacement_yaw"``: (4,), the same and a turn of up to
        ``yaw_step_deg``, counter-clockwise positive. ``"discrete_forward"``: 0 to 2 for +x, +y, -y by ``step_m``.
        Default: 'discrete'.
    observation
        What stands before the LiDAR ranges over the maximum range, 1 on a miss. ``"goal"``: the unit direction (3,) to
        the current goal in the body frame, as the pose sensor has it. ``"blob"``: ``offset`` and ``area`` of the
        `color_blob` of ``color`` in the first camera's image. ``"pixels"``: nothing; the image of the first camera,
        whose layout is ``"chw"``, is a separate field. Default: 'goal'.
    step_m
        Distance of a full action. Values: > 0 m. Default: 0.1.
    yaw_step_deg
        Angle of a full turn action. Values: (0, 180] deg. Default: 10.0.
    reward
        The terms of the reward. Default: NavigationReward().
    random_start
        Start anywhere in the world's spawn box instead of at its start marker. Default: False.
    color
        Colour that ``observation="blob"`` looks for; by default the green of the goal. Refused with another
        observation. Default: ColorRange().
    """

    # fields of NavigationConfig
    __match_args__: ClassVar[tuple[str, ...]]
    action: Literal["discrete", "displacement", "displacement_yaw", "discrete_forward"]
    observation: Literal["goal", "blob", "pixels"]
    step_m: float
    yaw_step_deg: float
    reward: NavigationReward
    random_start: bool
    color: ColorRange
    def __init__(
        self,
        *,
        action: Literal["discrete", "displacement", "displacement_yaw", "discrete_forward"] = "discrete",
        observation: Literal["goal", "blob", "pixels"] = "goal",
        step_m: float = 0.1,
        yaw_step_deg: float = 10.0,
        reward: NavigationReward = ...,
        random_start: bool = False,
        color: ColorRange = ...,
    ) -> None: ...
    # end of fields
    @staticmethod
    def observing(observation: str) -> NavigationConfig:
        """Return the task of the thesis that observes this; camera tasks fly ahead and aside, and end where they overshoot."""

@final
class Field:
    """A named array that a task declares; its shape is that of one env. Bounds are one number, or one for each value."""

    def __init__(self, name: str, dtype: str, shape: Sequence[int], low: float, high: float) -> None: ...
    @property
    def name(self) -> str:
        """Of the array; what a dict of observations calls it."""

    @property
    def dtype(self) -> str:
        """As NumPy calls it: ``"bool"``, ``"uint8"``, ``"int32"``, ``"int64"``, ``"float32"`` or ``"float64"``."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Of one env; () for a single number."""

    @property
    def low(self) -> Any:
        """Least value: a number, or an array of ``shape``."""

    @property
    def high(self) -> Any:
        """Greatest value: a number, or an array of ``shape``."""

@final
class TaskSpec:
    """What a task takes, shows and is rewarded by, declared once."""

    def __init__(
        self,
        action: Field,
        observation: Sequence[Field],
        reward_terms: Sequence[str],
        row: Literal["drone", "env"] = "drone",
    ) -> None: ...
    @property
    def row(self) -> str:
        """What a row of actions, observations and rewards belongs to: ``"drone"`` or ``"env"``."""

    @property
    def action(self) -> Field:
        """One row of what `Batch.step` takes."""

    @property
    def observation(self) -> list[Field]:
        """One field is the observation itself; several form a dict."""

    @property
    def reward_terms(self) -> list[str]:
        """Names of the terms whose sum is the reward: the columns of `Batch.reward_terms`."""

@final
class EpisodeEnd(IntEnum):
    """Why an episode ended. If several reasons hold in one step, the order is: bad_state, success, contact, left_area, time, task,
    teammate.

    ``none``: it has not ended. ``success``: the task calls it a success. ``contact``: it was terminated while a drone was in
    contact with something. ``left_area``: the task ended it because a drone left the area that the task allows.
    ``bad_state``: a setpoint, pose, reward or observation was not finite; see `Batch.bad_state`. ``time``: it was truncated at
    ``max_episode_steps``. ``task``: the task terminated or truncated it for another reason.
    ``teammate``: it was truncated because the episode of another drone of the env ended.

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
    """A task of your own in C++: a shared library that ends with ``FLOCKSTEP_EXPORT_TASK(YourTask)``.

    Build it against the headers in `flockstep.include_dir`, with the compiler that flockstep was built with. Its file is
    checked before it is loaded.

    Parameters
    ----------
    path
        Of the shared library: a str or a Path.

    Raises
    ------
    TypeError
        Something else than a path.
    ValueError
        The file is no regular file, is cut short, is no shared library, exports no task, or was built for another version.
    """

    def __init__(self, path: str | PathLike[str]) -> None: ...
    @property
    def path(self) -> str:
        """Of the shared library."""

@final
class PythonTask:
    """A task whose methods are Python's; `flockstep.Task` makes these."""

    def __init__(self, spec: TaskSpec, identity: str, max_episode_steps: int, calls: object) -> None: ...

def _scene_keys() -> str: ...
def _unexpected_keyword(callee: str, keyword: str, known: Sequence[str]) -> str: ...
def load_scene(name: str, folder: str | PathLike[str]) -> World:
    """Return the world of a name or path; bundled scenes are in the folder."""

def task_defaults(task: NavigationConfig | HoverConfig | TrackConfig | NativeTask | PythonTask) -> dict[str, Any]:
    """Return the defaults of an environment with this task.

    ``worlds``, ``lidar``, ``cameras``, ``max_episode_steps``, ``drone`` (a name or None), ``dynamics``, ``clock``.
    """

@final
class World:
    """Immutable geometry, materials and named markers, shared by any number of drones and batches."""

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

        Files that it names have to lie in its folder or below it, unless ``meshes_anywhere`` is set. Its points are turned so that
        the axis ``up`` points up (``"y"`` is usual for glTF and ``"z"`` for others), multiplied by ``scale``, and moved so that
        the file's origin comes to ``origin`` (m). A `UserWarning` names what the file has and is not read. See `flockstep.scenes`.
        """

    @staticmethod
    def from_dict(
        scene: Mapping[str, Any], base_dir: str | PathLike[str] = "", *, meshes_anywhere: bool = False
    ) -> World:
        """Make a world of what a scene file says; ``base_dir`` is its folder, the current one if empty.

        A `UserWarning` names what the files have that the scene names, and is not read.
        """

    @staticmethod
    def playground(
        seed: int, pillars: int = 12, size_m: Sequence[float] = (14.0, 14.0, 5.25), pillar_radius_m: float = 0.25
    ) -> World:
        """Generate a room of ``size_m`` metres with full-height pillars, a start, waypoints and a goal.

        The default drone can fly from the start over the waypoints to the goal. The same arguments make the same world.
        """

    @staticmethod
    def forest(seed: int, trees: int = 150, size_m: Sequence[float] = (60.0, 40.0), relief_m: float = 4.0) -> World:
        """Generate a forest on rolling terrain, of textured meshes: trees, rocks, a start and a goal at opposite ends.

        ``size_m`` is along x, from start to goal, and y; ``relief_m`` from the lowest possible ground to the highest. The
        default drone can fly from the start to the goal. The same arguments make the same world.
        """

    @staticmethod
    def city(seed: int, blocks: Sequence[int] = (3, 2), height_m: float = 34.0) -> World:
        """Generate a city: blocks of houses, streets with cars, lamps, trees and cables, a start and a goal far apart.

        ``blocks`` are along x, from start to goal, and y, each in [1, 8], 34 to 46 m a side; ``height_m`` of the tallest
        roofs, in [12, 200]. The default drone can fly from the start to the goal along streets, 2 to 6 m above them. The same
        arguments make the same world.
        """

    @staticmethod
    def office(
        seed: int, size_m: Sequence[float] = (36.0, 20.0), furniture: float = 0.8, waypoints: bool = False
    ) -> World:
        """Generate a floor of an office building: rooms, corridors and lounges, textured and furnished, behind windows.

        ``size_m`` is along x, from 20, and y, from 14; ``furniture`` in [0, 1] is how densely it is furnished. Start and goal
        are in rooms at opposite ends of x. The default drone can fly from one to the other through doors, and not straight.
        With ``waypoints`` that way has one before and one behind each door. The same arguments make the same world.
        """

    @staticmethod
    def warehouse(
        seed: int, size_m: Sequence[float] = (48.0, 30.0), height_m: float = 8.0, waypoints: bool = False
    ) -> World:
        """Generate a warehouse: a hall with skylights, rows of racks with pallets, forklifts, a conveyor and more, textured.

        ``size_m`` is along x, from 26, across the rows of racks, and y, from 16; ``height_m`` in [5, 20] is that of the
        eaves. Start and goal are at opposite ends of x. The default drone can fly from one to the other around racks and
        through empty bays, and not straight; with ``waypoints`` there is one where that way turns. The same arguments make
        the same world.
        """

    def __copy__(self) -> World: ...
    def __deepcopy__(self, memo: dict[int, Any]) -> World: ...
    @property
    def name(self) -> str:
        """As the scene file says, or its file is called."""

    @property
    def bounds(self) -> _F32:
        """(2, 3) m: least and greatest corner of all geometry."""

    @property
    def start(self) -> _F32 | _MaybeNone:
        """(3,) m, or None if the world has no start marker."""

    @property
    def waypoints(self) -> _F32:
        """(K, 3) m, in the order of flight."""

    @property
    def goal(self) -> _F32 | _MaybeNone:
        """(3,) m, or None if the world has no goal marker."""

    @property
    def spawn_box(self) -> _F32 | _MaybeNone:
        """(2, 3) m: least and greatest corner of where a task may start drones, or None."""

    @property
    def marker_radius_m(self) -> float:
        """Metres, as drawn."""

    @property
    def materials(self) -> list[dict[str, Any]]:
        """A dict for each: ``name``, ``base_color`` (3,) linear RGB, ``semantic`` (the class that cameras report; the place in
        this list, counted from 1, unless the scene says otherwise), ``emissive`` (3,) linear RGB, shown in any light,
        ``alpha_cutoff``: cameras see through meshes where the texture's alpha is below it. Limits are those of the keys of a
        scene file."""

    @property
    def light(self) -> dict[str, Any]:
        """Sun and sky, as cameras see them, with the keys and limits of a scene file: ``sun_direction`` (3,) unit, towards the
        sun; ``sun_color``, ``sky_ambient``, ``ground_ambient``, ``zenith_color``, ``horizon_color``, each (3,) linear RGB;
        ``gamma``; ``sun_radius_deg`` of the sun's disc in the sky, 0 for none; ``sun_glow`` beside it."""

    @property
    def primitives(self) -> list[dict[str, Any]]:
        """A dict for each: ``kind`` (``"room"``, ``"box"``, ``"cylinder"``, ``"sphere"``,
        ``"capsule"``, ``"plane"``, ``"disc"``), ``center`` (3,) m, ``quat_wxyz`` (4,), ``half_extents`` (3,) m (of what is
        round: radius, radius, half height), ``material``, ``visible`` and ``solid``."""

    def to_dict(self) -> dict[str, Any]:
        """Return what `save` writes to a ``.json``; triangle meshes are inline."""

    def save(self, path: str | PathLike[str]) -> None:
        """Write a scene file (``.json``) or a glTF 2.0 file (``.glb``, ``.gltf``), which `load` makes an equal world of.

        In glTF, which any viewer shows, primitives are tessellated, and ``extras`` say what they are. The file is written whole
        or not at all.

        Raises
        ------
        ValueError
            Another suffix, a place that cannot be written, or a world too large for glTF: a file has at most 1 GiB.
        """

    def mesh(self, chord_error_m: float = 1e-3) -> dict[str, npt.NDArray[Any]]:
        """Return everything as triangles.

        Round primitives are tessellated so that no chord is farther than ``chord_error_m`` from the surface.

        Returns
        -------
        ``vertices`` (V, 3) m; ``triangles`` (T, 3) int32, indices of vertices, counter-clockwise seen from outside a solid and
        from inside a room; ``uv`` (V, 2) float32, where in its texture a vertex is, (0, 0) being the upper left corner, and 0
        where there is none; ``materials`` (T,) int32, an index into `materials`; ``objects`` (T,) int32, an index into
        `primitives`, then their number + the number of the mesh: what cameras report as ``instance``, less 1.
        """

    def objects(self) -> dict[str, npt.NDArray[Any]]:
        """Return the objects that cameras number: the primitives, then the meshes; row i is that of ``instance`` i + 1.

        Returns
        -------
        ``boxes`` (K, 2, 3) float32 m, least and greatest corner of the smallest box around each; ``materials`` (K,) int32, an index
        into `materials`, -1 where an object has several; ``visible`` and ``solid`` (K,) bool, whether sensors see it and whether
        drones hit it.
        """

    def point_cloud(self, spacing_m: float) -> dict[str, npt.NDArray[Any]]:
        """Return points spread evenly over all surfaces, about one for every ``spacing_m`` x ``spacing_m``.

        They lie on ``mesh(spacing_m / 100)`` and are the same ones each time.

        Returns
        -------
        ``points`` (N, 3) float32 m; ``normals`` (N, 3) float32 unit, out of a solid and into a room; ``semantic`` (N,) uint16, the
        class that cameras report; ``objects`` (N,) int32, as `mesh` has them.

        Raises
        ------
        ValueError
            They would be more than 50,000,000.
        """

    def occupancy(self, cell_m: float, box: npt.ArrayLike | None = None) -> dict[str, Any]:
        """Return which cells of a grid are occupied.

        A cell is if it touches a surface, or its centre lies within a solid or outside of the room. Cells count as a thousandth
        wider than they are, so that a surface between two cells occupies both. Meshes are surfaces: the inside of a closed one
        is empty, here as in flight.

        Parameters
        ----------
        cell_m
            Edge of a cell, in [0.001, 100] m.
        box
            (2, 3) m that cells cover, from its least corner on. None: `bounds`.

        Returns
        -------
        ``occupied`` (nx, ny, nz) bool; ``origin`` (3,) float32 m, the least corner; ``cell_m``. Cell (i, j, k) has its centre at
        ``origin + cell_m * (i + 0.5, j + 0.5, k + 0.5)``.

        Raises
        ------
        ValueError
            The cells would be more than 134,217,728.
        """

    def distance(self, cell_m: float, box: npt.ArrayLike | None = None) -> dict[str, Any]:
        """Return how far the centre of each cell of a grid is from the nearest surface.

        Arguments and errors are those of `occupancy`.

        Returns
        -------
        ``distance_m`` (nx, ny, nz) float32, 0 within a solid and outside of the room; ``origin`` and ``cell_m`` as `occupancy`
        has them.
        """

    def with_markers(
        self,
        *,
        start: npt.ArrayLike | None = None,
        goal: npt.ArrayLike | None = None,
        waypoints: npt.ArrayLike | None = None,
        spawn_box: npt.ArrayLike | None = None,
    ) -> World:
        """Return the same world with these markers, and no others.

        ``start`` and ``goal`` are (3,) m, ``waypoints`` (K, 3), ``spawn_box`` (2, 3), least and greatest corner.
        """

    def with_light(
        self,
        *,
        sun_direction: tuple[float, float, float] | None = None,
        sun_color: tuple[float, float, float] | None = None,
        sky_ambient: tuple[float, float, float] | None = None,
        ground_ambient: tuple[float, float, float] | None = None,
        zenith_color: tuple[float, float, float] | None = None,
        horizon_color: tuple[float, float, float] | None = None,
        gamma: float | None = None,
        sun_radius_deg: float | None = None,
        sun_glow: float | None = None,
        tint: npt.ArrayLike | None = None,
    ) -> World:
        """Return the same world in another light, with other colours.

        It shares geometry, textures, and all that is built for rays and collisions with this one. Its own are, where cameras see
        it, 16 bytes for each triangle, 120 for each primitive, 2 kB for each material and 12 kB besides; OpenGL keeps a copy of
        the geometry for each. `relight` draws many. All but ``tint`` are those of `WorldBuilder.light`; None: as it is.

        Parameters
        ----------
        tint
            (3,) or (M, 3) linear RGB in [0, 10], by which the base colours of all materials, or of each of `materials`, are
            multiplied; so textures are, too. No base colour becomes more than 1.
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
        """Draw ``count`` places (count, 3) m at which a drone, level and facing +x, is free.

        Each has something below, and neither what is next below it nor what is next above it shows the back of a triangle. So it
        is in the open or within a room or building, not in the ground, below it, or within a closed mesh. The first places do
        not depend on ``count``.

        Parameters
        ----------
        seed
            The same arguments draw the same places.
        clearance_m
            How far at least the drone's centre is from everything. None: the radius of the ball around the drone, which then may
            turn to any side.
        max_height_m
            Above what lies below; a place drawn higher is drawn again below that.
        box
            (2, 3) m, where to draw. None: `bounds`, and without a room up to ``max_height_m`` above them.
        reachable_from
            (3,) m, a place from which the drone can fly to all that are drawn.
        drone
            A `DroneModel`, or the name or path of one. None: the default drone.
        cell_m
            Of the lattice along which ``reachable_from`` is searched.

        Raises
        ------
        ValueError
            No place was found in 100,000 draws in a row; the message says why not.
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
    ) -> World:
        """Return the same world with a start and a goal that `free_places` draws, and no other markers.

        The drone can fly from one to the other. The other arguments are those of `free_places`.

        Parameters
        ----------
        distance_m
            At least from start to goal. None: a third of the diagonal, seen from above, of where places are drawn.

        Raises
        ------
        ValueError
            No such pair was found.
        """

    def check(self, drone: _DroneLike | None = None) -> dict[str, Any]:
        """Return what to look at before flying in a world from elsewhere.

        Returns
        -------
        ``name``; ``size_m`` (3,), of `bounds`; ``primitives``, ``triangles`` (of meshes) and ``objects``, how many; ``open_edges``,
        edges of triangles that belong to one alone, and ``crowded_edges``, to more than two, where vertices at the same place are
        one: a closed mesh has none of either, open ground the first around it; ``materials`` and ``textures``, how many, and
        ``texture_bytes``, in memory; ``start``, ``goal`` and ``spawn_box``, whether there is one, and ``waypoints``, how many;
        ``not_read``, what its file has and is not read, triangles without an area among it, in words; ``not_navigable``, why the
        navigation tasks cannot fly this drone (None: the default) here, or None where they can.
        """

    def raycast(
        self, origins: npt.ArrayLike, directions: npt.ArrayLike, max_range_m: float
    ) -> dict[str, npt.NDArray[Any]]:
        """Return the nearest hit of each of R rays.

        Parameters
        ----------
        origins, directions
            (R, 3) m; directions need not be unit, but not zero.
        max_range_m
            Metres.

        Returns
        -------
        ``t_hit`` (R,) m, inf on a miss; ``normal`` (R, 3) unit, facing the ray's origin, 0 on a miss; ``u`` and ``v`` (R,)
        where on a triangle, as the weights of its second and third vertex, 0 on primitives and on a miss; ``primitive``
        (R,) int32, an index into `primitives`, then their number + the index of a triangle, -1 on a miss; ``material``
        (R,) int32, an index into `materials`, -1 on a miss.
        """

@final
class WorldBuilder:
    """Makes a world by code, piece by piece; `build` returns it.

    Lengths and places are metres in the world frame, quaternions (w, x, y, z) from the piece's own frame to the world.
    Materials and textures are given by the numbers that `material` and `texture` return. What does not fit together is
    refused by `build`, or before. Cameras, LiDARs and rays see what is ``visible``; drones hit what is ``solid``, and planners
    go around it. Everything is one of these, or both.

    Parameters
    ----------
    name
        Of the world.
    """

    def __init__(self, name: str = "unnamed") -> None: ...
    def texture(
        self,
        name: str,
        pixels: npt.NDArray[np.uint8],
        wrap: Sequence[Literal["repeat", "mirror", "clamp"]] = ("repeat", "repeat"),
    ) -> int:
        """Add an image (height, width, 3 or 4) in sRGB, row 0 at the top; return its number. The fourth channel is alpha, 255
        where there is none; only ``alpha_cutoff`` of a material asks for it.

        ``wrap`` says what it shows beyond its borders, across and down.
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

        Limits are those of the keys of a scene file. ``base_color`` is linear RGB; a texture's colours are multiplied by it,
        on meshes and height fields. ``semantic`` is the class that cameras report; 0: the material's number plus 1.
        ``emissive`` is linear RGB, by default 0, and shown in any light. Cameras see through meshes and height fields, and
        the sun shines through, where the texture's alpha, from 0 to 1, is below ``alpha_cutoff``. LiDAR and collisions hit
        the whole of them.
        """

    def room(self, min: Sequence[float], max: Sequence[float], material: int) -> None:
        """Add the room: the inside of a box, given by two corners."""

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
        """Add a box of a size along its own x, y, z."""

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
        """Add a cylinder with flat caps along its own z."""

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
        """Add a capsule along its own z; its height includes the round caps."""

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
        """Add a rectangle of a size along its own x and y, seen and hit from both sides."""

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
        """Add a disc across its own z, seen and hit from both sides."""

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
        """Add triangles (T, 3) of vertices (V, 3), an object of their own.

        ``uv`` (V, 2) says where in the texture: (0, 0) is its upper left corner, (1, 1) its lower right one. ``colors`` (V, 3),
        linear RGB, are multiplied by what the material shows.
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
        """Add ground of heights (rows, columns), as triangles: that of row r, column c at ``corner + cell_m * (c, r)``.

        A texture repeats every ``texture_m``.
        """

    def light(
        self,
        *,
        sun_direction: Sequence[float] = ...,
        sun_color: Sequence[float] = ...,
        sky_ambient: Sequence[float] = ...,
        ground_ambient: Sequence[float] = ...,
        zenith_color: Sequence[float] = ...,
        horizon_color: Sequence[float] = ...,
        gamma: float = ...,
        sun_radius_deg: float = ...,
        sun_glow: float = ...,
    ) -> None:
        """Set the light, as `World.light` has it; what is left out is as in a world without."""

    def start(self, place: Sequence[float]) -> None:
        """Set where drones start."""

    def waypoint(self, place: Sequence[float]) -> None:
        """Add a waypoint, after those there are."""

    def goal(self, place: Sequence[float]) -> None:
        """Set the goal."""

    def spawn_box(self, min: Sequence[float], max: Sequence[float]) -> None:
        """Set the box within which drones start with ``random_start``, by two corners."""

    def build(self) -> World:
        """Return the world so far. More may be added afterwards, for another one."""

@final
class DroneModel:
    """What a drone is made of: its convex hull is its collision body; its airframe, if it has one, is what its flight is computed from.

    Parameters
    ----------
    hull
        (V, 3) m in the body frame, 4 to 32 points with a volume: a drone without an airframe, for kinematic motion. Default: the
        650-class quadrotor ``"t650"``, 0.93 x 0.59 x 0.20 m, with its airframe.
    """

    def __init__(self, hull: npt.ArrayLike | None = None) -> None: ...
    @property
    def hull(self) -> _F32:
        """(V, 3) m, body frame."""

    @staticmethod
    def load(name_or_path: str | PathLike[str]) -> DroneModel:
        """Return a bundled airframe by its name, or one from a JSON file, by a path that ends in ``.json``."""

    @staticmethod
    def names() -> list[str]:
        """Return the names of the bundled airframes."""

    @staticmethod
    def from_dict(data: dict[str, Any]) -> DroneModel:
        """Make a drone from what its JSON file would hold; docs/add-a-drone.md has the format."""

    def to_dict(self) -> dict[str, Any]:
        """Return what `from_dict` makes an equal drone of."""

    def scaled(self, *, size: float = 1.0, mass: float = 1.0) -> DroneModel:
        """Return the drone in another size and mass, both as factors, that flies alike.

        Lengths grow by ``size``; inertia, thrust, drag and lags follow (Froude's law), so that speeds and times grow by the square
        root of ``size``, and thrust-to-weight stays.
        """

    @property
    def name(self) -> str:
        """The name of the frame, empty where it has none."""

    @property
    def mass_kg(self) -> float:
        """Mass of the airframe."""

    @property
    def thrust_to_weight(self) -> float:
        """Thrust of all rotors at full speed over the weight."""

    @property
    def max_thrust_n(self) -> float:
        """Thrust of one rotor at full speed, N."""

    @property
    def hover_speed_radps(self) -> float:
        """Speed of rotors that share the weight evenly, rad/s."""

@final
class Contact:
    """Where the last motion of each drone ended. Views into the batch, cleared by a teleport or a reset."""

    # arrays of Contact
    @property
    def hit(self) -> _Bool:
        """(N,): something was touched."""

    @property
    def inside(self) -> _Bool:
        """(N,): the motion began in penetration."""

    @property
    def fraction(self) -> _F32:
        """(N,): part of the motion that was flown; with substeps, of the one that hit."""

    @property
    def point(self) -> _F32:
        """(N, 3) m, world frame: where it touched, on the obstacle."""

    @property
    def normal(self) -> _F32:
        """(N, 3) 1, world frame: from the obstacle towards the drone."""
    # end of arrays

@final
class Camera:
    """One camera of every drone of a batch; `Batch.camera` returns it.

    Images are read-only views, written in place by the next call that renders, and keep the batch alive. Asking for an
    output that the camera does not write raises `ValueError`. Where nothing is seen (sky, or beyond ``far_m``), depth is
    inf, normal 0, ids 0.
    """

    @property
    def config(self) -> CameraConfig:
        """As the batch was made, but for the capture mode, which is the present one."""

    def config_of(self, index: int) -> CameraConfig:
        """Return the setting of one drone, as `Batch.set_camera` changed it."""

    # arrays of Camera
    @property
    def rgb(self) -> _U8:
        """(N, height, width, 3): sRGB colour."""

    @property
    def depth(self) -> _F32:
        """(N, height, width) m: inf if nothing is seen: sky, or beyond far_m."""

    @property
    def semantic(self) -> _U16:
        """(N, height, width): semantic id; 0 if nothing is seen."""

    @property
    def instance(self) -> _U16:
        """(N, height, width): 1 + index of the primitive, then the meshes, then start, waypoints, goal; 0 if nothing is seen."""

    @property
    def normal(self) -> _F32:
        """(N, height, width, 3) 1, world frame: surface normal, towards the camera; 0 if nothing is seen."""

    @property
    def grey(self) -> _U8:
        """(N, height, width): 0.299 R + 0.587 G + 0.114 B of rgb (ITU-R BT.601), rounded."""

    @property
    def hsv(self) -> _U8:
        """(N, height, width, 3): hue / 2 in degrees, [0, 179], saturation and value in [0, 255], as in OpenCV."""

    @property
    def frame_step(self) -> _I64:
        """(N,): number of the reading that the frame shows, 0 at the reset; -1: stale."""
    # end of arrays
    def jpeg(self, index: int, quality: int = 90) -> bytes:
        """Return the file of one drone's rgb (else grey) frame; quality from 1 to 100.

        Raises
        ------
        ValueError
            The camera writes neither, the frame is stale, or there is no such drone or quality.
        """

    def save_frames(
        self,
        folder: str | PathLike[str],
        indices: int | Sequence[int] | npt.NDArray[np.integer[Any]] | None = None,
        outputs: Sequence[str] | None = None,
    ) -> list[Path]:
        """Write PNG files ``<camera>-<drone>-<output>.png`` and return their paths; needs Pillow.

        ``rgb`` and ``grey`` have 8 bits, and so has ``hsv``, whose channels stand for red, green and blue. ``semantic``
        and ``instance`` are the ids, 16 bits. ``depth`` has 16 bits, in millimetres; 0 where nothing is seen or it is
        beyond 65.535 m. ``normal`` is 127.5 * (n + 1), 8 bits; 0 where nothing
        is seen. `numpy.save` of the arrays themselves keeps depth and normal exact.

        Image viewers show 16 bits of ids or millimetres as almost black. Therefore ``depth``, ``semantic`` and ``instance``
        each get a second file in colour, ``<camera>-<drone>-<output>-color.png``: depth from bright (nearest) to dark
        (farthest) on a logarithmic scale that all frames of the call share, and a fixed colour per id. Where nothing is seen
        it is black.

        Parameters
        ----------
        folder
            Made where it is missing; files of the same names are replaced.
        indices
            Which drones. None: all that have a frame.
        outputs
            Which outputs. None: all that the camera writes.

        Raises
        ------
        ValueError
            An output that the camera does not write, or a drone whose frame is stale: nothing is written then.
        ModuleNotFoundError
            Pillow is not installed.
        """

@final
class Lidar:
    """One LiDAR of every drone of a batch; `Batch.lidar` returns it. Views keep the batch alive."""

    @property
    def config(self) -> LidarConfig:
        """As the batch was made."""

    def config_of(self, index: int) -> LidarConfig:
        """Return the setting of one drone, as `Batch.set_lidar` changed it."""

    # arrays of Lidar
    @property
    def ranges(self) -> _F32:
        """(N, channels, beams) m: inf on a miss; `RuntimeError` before the first scan."""

    @property
    def max_range_m(self) -> _F32:
        """(N,) m: maximum range of each drone."""
    # end of arrays
    @property
    def directions(self) -> _F32:
        """(N, channels, beams, 3) unit, body frame; a copy."""

    @property
    def points(self) -> _F32:
        """(N, channels, beams, 3) m, world frame, inf on a miss; a copy. Exact only while the drone is where it sensed."""

@final
class Terms:
    """What the engine's own tasks are rewarded by and observe, of every env as it is now; `Batch.terms` returns it.

    ``goal_index`` (N,) says which waypoint is each env's goal, from 0; beyond the last one, and by default, it is the goal
    marker of its world. New arrays, but for `action_changed`.
    """

    def goal(self, goal_index: npt.ArrayLike | None = None) -> _F32:
        """(N, 3) m, world frame."""

    def start(self) -> _F32:
        """(N, 3) m, world frame: the start marker of each env's world."""

    def goal_distance(self, goal_index: npt.ArrayLike | None = None) -> _F64:
        """(N,) m, from where the drones are."""

    def goal_direction(self, goal_index: npt.ArrayLike | None = None) -> _F32:
        """(N, 3) unit, in the body frame as the pose sensor has it."""

    def displaced(self, displacement_m: npt.ArrayLike) -> _F32:
        """(N, 3) m, world frame: where the drones would be after a displacement (N, 3) m in their body frames."""

    def ranges(self) -> _F32:
        """(N, rays): the LiDAR's ranges over its maximum range, 1 on a miss."""

    def clearance(self) -> _F64:
        """(N,): the least of `ranges`."""

    def free_space(self, min_clearance: float) -> _F64:
        """(N,): 1 in the open, 0 where all ranges are ``min_clearance``, a number in (0, 1)."""

    @property
    def action_changed(self) -> _Bool:
        """(N,): the action differs from that of the step before, as an episode's first does; in `Task.step`. A view."""

@final
class Recipe:
    """Everything that a batch is built from, as one value that goes to JSON and back: the same in Python and C++.

    Its JSON is an object with the members ``"task"`` (null, or an object with the task's ``"name"`` and the fields of its
    configuration), ``"worlds"``, ``"drone"``, and the fields of the batch. Members that are missing have the defaults of
    the task. `DroneVectorEnv.recipe` returns the recipe of an env, `DroneVectorEnv.from_recipe` makes an env from one.

    Parameters
    ----------
    task
        A configuration of the engine's tasks, whose defaults the recipe begins with; the id of a task of your own; or
        None for a batch without a task.
    """

    task: NavigationConfig | HoverConfig | TrackConfig | str | None
    worlds: list[str]
    drone: str | DroneModel
    # fields of Recipe
    num_envs: int
    drones_per_env: int
    num_threads: int
    block_size: int
    lidars: Sequence[LidarConfig]
    cameras: Sequence[CameraConfig]
    camera_backend: Literal["raycast", "gl", "auto"]
    tracer: Literal["auto", "tiles", "embree"]
    pose_sensor: PoseSensorConfig
    imus: Sequence[ImuConfig]
    episode: EpisodeConfig
    clock: ClockConfig
    dynamics: DynamicsConfig
    # end of fields
    def __init__(self, task: NavigationConfig | HoverConfig | TrackConfig | str | None = None) -> None: ...
    @staticmethod
    def from_json(text: str) -> Recipe:
        """Return the recipe of a JSON text; no file is opened.

        Raises
        ------
        ValueError
            A member that is not known, misspelt or of a wrong type or value: the message names its place.
        """

    def to_json(self) -> str:
        """Return the JSON text that `from_json` makes an equal recipe of."""

    def check_access(self, scenes: str | PathLike[str]) -> None:
        """Raise `ValueError` if a world or the drone is the path of a file outside of the folder of bundled scenes."""

class Batch:
    """E envs of M drones each over W worlds, N = E M drone slots in all, stepped together.

    Arrays that are properties are read-only views, unless said to be copies: they are written in place by the next call,
    and keep the batch alive. Drone d belongs to env d // M. Masks are bool, (N,) for calls about drones and (E,) for calls about envs
    (`reset`, `seed`, `begin_episode`, `set_world`); None means every active one. R rows are N or E, as the task's
    `TaskSpec.row` says. One caller at a time. A batch does not
    survive a fork: used in a child process, it raises `RuntimeError`.

    Parameters
    ----------
    worlds
        A `World`, the name or path of one, a set of `flockstep.scenes` such as ``"train"``, or a sequence of these, at least one; or a
        `WorldPool`, from which each `reset` and each episode that begins draws one: it takes a task. Until their
        first reset, all drones are in world 0 of a pool.
    num_drones
        N, from 1 to 2**20: a multiple of ``drones_per_env``.
    lidar, pose_sensor, imu
        Sensors: none, an exact pose, and none by default. Several LiDARs or IMUs are a sequence, of different names. An IMU
        needs drones that fly by their rotors.
    task
        What `reset` and `step` run. The navigation task needs a LiDAR, and a camera where it observes one.
    drone
        A `DroneModel`, or what `DroneModel.load` takes: the name of a frame or a path. Default: the 650-class quadrotor.
    cameras
        Of each drone, each of another name; at most 2**32 pixels each in all. One that writes ``instance`` needs worlds of at
        most 65535 primitives, meshes and markers.
    camera_backend
        ``"raycast"``: the engine's own tracing, which repeats to the bit. ``"gl"``: OpenGL through EGL. ``"auto"``: the
        faster of the two, timed on the batch's worlds. Without OpenGL, both are raycast with a `RuntimeWarning`. With a
        `WorldPool`, ``"gl"`` is refused, and ``"auto"`` is raycast.
    episode, clock, dynamics
        Of the task's episodes, of time, and of motion.
    num_threads
        0 means the physical cores this process may run on.
    block_size
        Envs a thread takes at once; 0 means a good number, 64 to 256. No result depends on it.
    world_index
        (E,) integers: the world of each env. Default: env i is in world i modulo W.
    tracer
        How rays of cameras and LiDARs meet what is in a world; the same but for rounding. ``"tiles"``: those of cameras,
        and of LiDARs whose beams lie close (at least four rows, sixteen beams of each within some 50 degrees), meet
        triangles in tiles of 16 x 16 rays that go through a tree of their own together, which takes some 65 bytes a
        triangle; all others by Embree, in packets. ``"auto"``: tiles for sensors
        of at least 256 rays, in worlds of at most 1,024 triangles for each of these; beyond, packets are faster.
        ``"embree"``: no tiles, and primitives by Embree, too, except rooms: slower, to compare with.
    drones_per_env
        M, from 1: the drones of an env share its world, its seed and its episodes. They neither sense nor touch each
        other.
    """

    def __init__(
        self,
        worlds: WorldsLike | WorldPool,
        num_drones: int = 1,
        *,
        lidar: LidarConfig | Sequence[LidarConfig] | None = None,
        pose_sensor: PoseSensorConfig | None = None,
        imu: ImuConfig | Sequence[ImuConfig] | None = None,
        task: NavigationConfig | HoverConfig | TrackConfig | NativeTask | PythonTask | None = None,
        drone: _DroneLike | None = None,
        cameras: Sequence[CameraConfig] = (),
        camera_backend: str = "raycast",
        episode: EpisodeConfig | None = None,
        clock: ClockConfig | None = None,
        dynamics: DynamicsConfig | None = None,
        num_threads: int = 0,
        block_size: int = 0,
        world_index: npt.ArrayLike | None = None,
        tracer: str = "auto",
        drones_per_env: int = 1,
    ) -> None: ...
    @staticmethod
    def from_recipe(
        recipe: Recipe,
        worlds: WorldsLike | WorldPool | None = None,
        task: NativeTask | PythonTask | None = None,
        *,
        allow_files: bool = False,
    ) -> Batch:
        """Make a batch from a recipe.

        Parameters
        ----------
        recipe
            What to build.
        worlds, task
            Objects that take the place of the worlds and the task that the recipe names.
        allow_files
            Whether worlds and drone may be files outside of the folder of bundled scenes.
        """

    @property
    def num_envs(self) -> int:
        """E."""

    @property
    def drones_per_env(self) -> int:
        """M."""

    @property
    def num_drones(self) -> int:
        """N."""

    @property
    def dynamics(self) -> DynamicsConfig:
        """How drones move, and what they are told: a copy."""

    @property
    def clock(self) -> ClockConfig:
        """The rates, those included that were left open: a copy."""

    @property
    def num_threads(self) -> int:
        """Threads that step the batch, the caller's among them."""

    @property
    def embree_rays(self) -> int:
        """How many rays have met triangles through Embree, those of shadows included, since the batch was made.

        Rays of LiDARs and of cameras that ``raycast`` renders; rays that meet only primitives are not among them.
        """

    @property
    def embree_packets(self) -> int:
        """In how many packets these rays went; it may depend on the number of threads."""

    @property
    def worlds(self) -> list[World]:
        """The W worlds, by `world_index`. With a `WorldPool`, `AttributeError`: ask `world_of`."""

    def world_of(self, index: int) -> World:
        """Return the world that a drone is in."""

    @property
    def drone(self) -> DroneModel:
        """The model that every drone has."""

    # arrays of Batch
    @property
    def position(self) -> _F32:
        """(N, 3) m, world frame: position."""

    @property
    def quat_wxyz(self) -> _F32:
        """(N, 4) 1, world frame: orientation, body to world."""

    @property
    def active(self) -> _Bool:
        """(N,): False: the slot is removed."""

    @property
    def world_index(self) -> _I32:
        """(E,): index into `worlds`; with a `WorldPool`, the number of the env's world."""

    @property
    def episode(self) -> _I64:
        """(E,): number of the episode under the env's seed, from 0."""

    @property
    def tick(self) -> _I64:
        """(E,) ticks: ticks flown in the env's episode."""

    @property
    def velocity(self) -> _F32:
        """(N, 3) m/s, world frame: velocity."""

    @property
    def angular_velocity(self) -> _F32:
        """(N, 3) rad/s, body frame: angular velocity."""

    @property
    def acceleration(self) -> _F32:
        """(N, 3) m/s^2, world frame: mean of the last tick; 0 if it ended in a contact."""

    @property
    def angular_acceleration(self) -> _F32:
        """(N, 3) rad/s^2, body frame: mean of the last tick; 0 if it ended in a contact."""

    @property
    def rotor_speed(self) -> _F32:
        """(N, 4) rad/s: speeds of the rotors, in the order of the airframe."""

    @property
    def wind(self) -> _F32:
        """(N, 3) m/s, world frame: wind of the last step; before an episode's first step, the wind it begins with."""

    @property
    def sensed_position(self) -> _F32:
        """(N, 3) m, world frame: position, as read last."""

    @property
    def sensed_quat_wxyz(self) -> _F32:
        """(N, 4) 1, world frame: orientation, body to world, as read last."""

    @property
    def accelerometer(self) -> _F32:
        """(N, 3) m/s^2, sensor frame: specific force, as read last."""

    @property
    def gyroscope(self) -> _F32:
        """(N, 3) rad/s, sensor frame: angular velocity, as read last."""

    @property
    def steps(self) -> _I64:
        """(E,) steps: steps flown in this episode, the current step included."""

    @property
    def flying(self) -> _Bool:
        """(E,): False: the episode was over before the last step, which skipped the env."""

    @property
    def bad_states(self) -> _I64:
        """(R,): episodes that ended in a `bad_state` since the batch was made."""

    @property
    def reward(self) -> _F32:
        """(R,): reward of the last step. Writable, and never read back."""

    @property
    def reward_terms(self) -> _F32:
        """(R, terms): terms of the reward, in the order of the spec; their sum is it."""

    @property
    def terminated(self) -> _Bool:
        """(R,): the episode ended here, in a state that ends episodes."""

    @property
    def truncated(self) -> _Bool:
        """(R,): the episode ended here, for another reason."""

    @property
    def success(self) -> _Bool:
        """(R,): the episode ended here, and the task calls it a success."""

    @property
    def crashed(self) -> _Bool:
        """(R,): the episode ended here, in contact with something."""

    @property
    def bad_state(self) -> _Bool:
        """(R,): the episode ended here, because a number was not finite or a pose beyond the world."""

    @property
    def episode_end(self) -> _U8:
        """(R,): why the episode ended here, an `EpisodeEnd`; 0 if it goes on."""

    @property
    def episode_return(self) -> _F64:
        """(R,): sum of the rewards of the episode that ended here, else of the current one."""

    @property
    def episode_terms(self) -> _F64:
        """(R, terms): the same sum for each term of the reward."""

    @property
    def episode_length(self) -> _I64:
        """(R,) steps: steps flown in the same episode."""
    # end of arrays
    @property
    def contact(self) -> Contact:
        """Where the last motion ended."""

    @property
    def lidar_name(self) -> str | None:
        """Name of the LiDAR, or of the first of several; None without one."""

    def lidar(self, name: str | None = None) -> Lidar:
        """Return a LiDAR: its ranges and configuration. Without a name, the first. `ValueError` if there is none."""

    def sensor(self, name: str) -> dict[str, Any]:
        """Return the arrays that a sensor publishes, read-only views by their names, such as ``"accelerometer"``.

        LiDARs, IMUs and cameras have the name in their configuration, the pose sensor is ``"pose"``.
        """

    def set_pose(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> None:
        """Teleport, without a collision check, to positions (N, 3) m and quaternions (N, 4); None keeps what is."""

    def move(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> Contact:
        """Fly to positions (N, 3) m and quaternions (N, 4) on a straight line and the shortest arc; None keeps what is.

        A drone that touches something stops at its last free pose.
        """

    def set_velocity(
        self,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        rotor_speed: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> None:
        """Set velocities (N, 3) m/s, world frame, and rad/s, body frame, and rotor speeds (N, 4) rad/s; None keeps what is.

        A drone turns at most half a turn in a tick: `ValueError` for angular velocities above pi times `physics_hz`.
        After `set_pose` a drone is at rest, its rotors hovering.
        """

    def fly(self, command: npt.ArrayLike, ticks: int | None = None, mask: npt.ArrayLike | None = None) -> Contact:
        """Fly a command (N, 4), as `DynamicsConfig.control` says, for some ticks; None: those of a step.

        Obstacles in the way are hit; see `DynamicsConfig.on_contact`. Sensors are not read. Gusts and the controller
        follow each env's clock, so many calls of one tick do what one call of many ticks does. A drone that becomes too
        fast to integrate is put to rest where it was last, with a `RuntimeWarning`; in a task its episode ends as a bad
        state.

        Ctrl-C ends a long flight between two ticks. Drones near obstacles may then have flown fewer ticks than others, and
        `tick` leaves out what was cut short.

        Raises
        ------
        ValueError
            Numbers beyond +-2e6; a roll or pitch beyond +-pi, a yaw beyond +-10,000 rad.
        RuntimeError
            Kinematic motion, or ``control="pose"``.
        """

    def sense(self, mask: npt.ArrayLike | None = None) -> None:
        """Read the sensors at the present poses. Cameras whose capture mode says so render."""

    def spawn(
        self,
        indices: npt.ArrayLike,
        position: npt.ArrayLike,
        quat_wxyz: npt.ArrayLike | None = None,
        world_index: npt.ArrayLike | None = None,
    ) -> None:
        """Bring slots (K,) to life at positions (K, 3) m, quaternions (K, 4), in worlds (K,), and `sense` there.

        With a task, the drones of an env begin their episodes together: give all of them that are not removed.
        """

    def remove(self, indices: npt.ArrayLike) -> None:
        """Empty slots (K,): they cost nothing and read as absent, with ranges of inf and the pose they had.

        Their frames are black, with depths of inf, and stale.
        """

    def set_world(self, world_index: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> None:
        """Put envs into worlds (E,); their drones keep their coordinates. Refused with a `WorldPool`, as a world in `spawn` is."""

    def set_lidar(
        self,
        mask: npt.ArrayLike | None = None,
        lidar: str | None = None,
        *,
        max_range_m: float | None = None,
        hfov_deg: float | None = None,
        vfov_deg: float | None = None,
        offset_m: Sequence[float] | None = None,
        quat_wxyz: Sequence[float] | None = None,
    ) -> None:
        """Change the LiDARs of some drones from the next `sense` on; what is None stays."""

    def camera(self, name: str | None = None) -> Camera:
        """Return one camera: its images and configuration. A missing name means the only one, here and below.

        `ValueError` where there is none of that name, or there are several and none is named.
        """

    def capture(self, mask: npt.ArrayLike | None = None, camera: str | None = None) -> None:
        """Render now, whatever the capture mode."""

    def set_capture_mode(self, mode: str, camera: str | None = None) -> None:
        """Change when frames are rendered: ``"every_step"``, ``"on_movement"`` or ``"on_demand"``.

        `ValueError` for ``"on_demand"`` of a camera that the task observes.
        """

    def set_camera(
        self,
        mask: npt.ArrayLike | None = None,
        camera: str | None = None,
        *,
        hfov_deg: float | None = None,
        vfov_deg: float | None = None,
        offset_m: Sequence[float] | None = None,
        quat_wxyz: Sequence[float] | None = None,
    ) -> None:
        """Change one camera of some drones; what is None stays. Their frames are stale until they are rendered anew.

        A field of view lets go of the other one, unless both are given.
        """

    def camera_backend_report(self) -> str:
        """Return which backend renders, and why."""

    def seed(self, seeds: npt.ArrayLike, mask: npt.ArrayLike | None = None) -> None:
        """Set the env seeds (E,) uint64 and set the episode counters to 0. With a task, `reset` does this."""

    def begin_episode(self, mask: npt.ArrayLike | None = None) -> None:
        """Advance the episode counters. With a task, `reset` and `step` do this."""

    def random(self, stream: int, count: int) -> _F32:
        """Return uniform numbers in [0, 1), (E, count), a new array.

        They depend on the env's seed, its episode and the stream (from 0 to 2**31 - 1) alone; drawing changes nothing.
        """

    def reset(self, seeds: npt.ArrayLike | None = None, mask: npt.ArrayLike | None = None) -> None:
        """Begin new episodes of the task: the first ones of seeds (E,) uint64, or each env's next one.

        Raises
        ------
        RuntimeError
            The batch has no task.
        """

    def step(self, actions: npt.ArrayLike) -> None:
        """Fly one step of the task, or as many as ``frame_skip`` says: actions (R, ...), as `spec` declares them.

        Two slots of outputs take turns, so what `observation` and the like gave before a step is whole until the one after.

        Raises
        ------
        RuntimeError
            The batch has no task, or `reset` has not been called.
        """

    @property
    def spec(self) -> TaskSpec:
        """What the task declares."""

    @property
    def observation(self) -> Any:
        """(R, ...), after resets; a dict of arrays where the task observes several fields. Writable, and never read back."""

    @property
    def final_observation(self) -> Any:
        """Likewise, the last of the episode, valid where `terminated` or `truncated`."""

    @property
    def terms(self) -> Terms:
        """Distance to the goal, clearance and the like: what the engine's own tasks are made of."""

    @property
    def task_state(self) -> dict[str, Any]:
        """The arrays of the task by their names, read-only views; the navigation task's ``goal_index`` among them."""

    def snapshot(self) -> bytes:
        """Return everything the next step depends on."""

    def restore(self, blob: bytes) -> None:
        """Go back to a snapshot; `ValueError`, and no change, for one of another configuration or with a byte changed."""

@final
class GreenBlob:
    """What is green in an image."""

    @property
    def found(self) -> bool:
        """Whether any pixel is green."""

    @property
    def x(self) -> int:
        """Pixels, of the box's first pixel, from the left."""

    @property
    def y(self) -> int:
        """Pixels, from the top."""

    @property
    def width(self) -> int:
        """Pixels; 0 where no green is seen, as all the numbers are."""

    @property
    def height(self) -> int:
        """Pixels; 0 where no green is seen."""

    @property
    def offset(self) -> float:
        """Of the box's centre from the image's in x, over half the image's width: in [-1, 1], positive to the right."""

    @property
    def area(self) -> float:
        """Of the box over the image's."""

    @property
    def mask(self) -> _Bool:
        """(height, width) which pixels are green."""

def green_blob(image: npt.NDArray[np.uint8], layout: str = "hwc") -> GreenBlob:
    """Find what is green, as the camera task sees it: pixels with G > 1.25 * max(R, B) + 16, and the box around them.

    Parameters
    ----------
    image
        uint8 of shape (height, width, 3), or with the layout ``"chw"`` (3, height, width).
    """

@final
class ColorBlob:
    """Where a colour is in some images: the box around all pixels that have it.

    Each array has the images' leading shape: () for one image, (N,) for N. All numbers are 0 where the colour is not seen.
    """

    @property
    def found(self) -> _Bool:
        """Whether any pixel has the colour."""

    @property
    def x(self) -> npt.NDArray[np.int32]:
        """Pixels, of the box's first pixel, from the left."""

    @property
    def y(self) -> npt.NDArray[np.int32]:
        """Pixels, from the top."""

    @property
    def width(self) -> npt.NDArray[np.int32]:
        """Pixels, of the box."""

    @property
    def height(self) -> npt.NDArray[np.int32]:
        """Pixels, of the box."""

    @property
    def offset(self) -> _F32:
        """Of the box's centre from the image's in x, over half the image's width: in [-1, 1], positive to the right."""

    @property
    def area(self) -> _F32:
        """Of the box over the image's."""

    @property
    def mask(self) -> _Bool:
        """(..., height, width) which pixels have the colour."""

def color_blob(images: npt.NDArray[np.uint8], color: ColorRange, layout: str = "hwc") -> ColorBlob:
    """Find a colour in images, as the camera task does: the box around all pixels that have it.

    Parameters
    ----------
    images
        rgb, uint8 of shape (..., height, width, 3), or with the layout ``"chw"`` (..., 3, height, width): one image, or
        ``batch.camera().rgb``.
    color
        Which colour.

    Raises
    ------
    ValueError
        Images of another dtype or shape, an unknown layout, or a range outside of [0, 255].
    """

@final
class ColorComponents:
    """The K connected parts of an image that have a colour, in the order of their labels."""

    @property
    def box(self) -> npt.NDArray[np.int32]:
        """(K, 4) x and y of the first pixel from the upper left, width, height; pixels."""

    @property
    def centroid(self) -> npt.NDArray[np.float64]:
        """(K, 2) x, y in pixels from the upper left corner: the mean of the pixels' centres, which are at + 1/2."""

    @property
    def area_px(self) -> npt.NDArray[np.int32]:
        """(K,) number of pixels."""

    @property
    def labels(self) -> npt.NDArray[np.int32]:
        """(height, width) 0 where the colour is not, k + 1 in component k."""

def color_components(image: npt.NDArray[np.uint8], color: ColorRange, layout: str = "hwc") -> ColorComponents:
    """Find the connected parts of an image that have a colour; pixels that touch at a corner are connected. By OpenCV.

    Parameters
    ----------
    image
        rgb, uint8 of shape (height, width, 3), or with the layout ``"chw"`` (3, height, width).
    color
        Which colour.

    Raises
    ------
    ValueError
        As `color_blob`.
    """

def plan(
    world: WorldLike,
    start: npt.ArrayLike,
    goals: npt.ArrayLike,
    drone: _DroneLike | None = None,
    cell_m: float = 0.1,
    progress: Callable[[float], object] | None = None,
) -> _F32 | None:
    """Do what `flockstep.plan` does; ``progress`` is called ten times a second with the share that is done, in [0, 1]."""
