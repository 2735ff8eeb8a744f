"""The keywords of `DroneVectorEnv` that are fields of configurations; made by bindings/stubs.py."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypedDict

if TYPE_CHECKING:
    from flockstep._core import (
        BarometerConfig,
        BodyConfig,
        CameraConfig,
        ClockConfig,
        ColorRange,
        DynamicsConfig,
        EpisodeConfig,
        GpsReceiverConfig,
        ImuConfig,
        LidarConfig,
        Light,
        MagnetometerConfig,
        NavigationReward,
        ObservationConfig,
        OpticalFlowConfig,
        PoseSensorConfig,
        Variation,
        WindConfig,
    )


class EnvKeywords(TypedDict, total=False):
    """Keywords of `DroneVectorEnv`: fields of its `Recipe` and of configurations. The task sets their defaults.

    Parameters
    ----------
    drones_per_env
        Number of drones in each env, M, which share a world. Without a task it may be 0.
    interaction
        How the drones of an env interact. ``"none"``: not at all. ``"sense"``: LiDARs detect the others' hulls, cameras
        see their meshes. ``"collide"``: their hulls collide. ``"both"``: both. Unless ``"none"``, an env has at most
        4096 drones.
    num_threads
        Number of threads. More than four per CPU give a warning. 0: the physical cores that this process may use. No
        result depends on it.
    block_size
        Envs that a thread takes at once. 0: the engine chooses. No result depends on it.
    lidar
        The LiDARs of each drone.
    camera
        The cameras of each drone. One camera has at most 2^32 pixels over all drones.
    camera_backend
        Renderer of cameras. ``"raycast"``: the engine's own tracing, without a GPU, bit-identical for any number of
        threads. ``"gl"``: OpenGL 4.5 through EGL, without shadows and fog. If it is missing, raycast with a warning.
        ``"auto"``: raycast.
    tracer
        Method that traces rays against triangles. ``"auto"``: the fastest for each sensor. ``"slices"``, ``"tiles"``,
        ``"embree"``: for comparison.
    pose_sensor
        The pose sensor of each drone.
    imu
        The IMUs of each drone.
    barometer
        The barometers of each drone.
    magnetometer
        The magnetometers of each drone.
    gps_receiver
        The GPS receivers of each drone.
    optical_flow
        The optical flow sensors of each drone.
    bodies
        Bodies in every env at an episode's beginning, after those of its world.
    max_bodies
        Slots for bodies in each env, B. Free ones are for ``batch.bodies.spawn()``. 0: as many as an episode may begin
        with.
    lights
        At most 4096 lights, of which each episode of an env draws one. Empty: the lights of the worlds.
    episode
        Begin and end of episodes.
    observed
        History, past actions and delay of what a task observes.
    clock
        Rates of policy, controller and physics.
    dynamics
        Motion model of the drones.
    variations
        What differs from drone to drone, and how it is drawn. Needs ``motion="rotors"``. `flockstep.vary` makes the
        list.
    airframes
        Drones from whose airframes each episode draws one, instead of the one of ``drone``: names, files, or
        ``"random/seed-7"``. Hull and sensors stay those of ``drone``.
    privileged
        Parameters of the drone, minus their defaults, at the end of a task's observation: names of fields of
        `DroneParameters`, or of elements. They need ``variations``. Keep them from the policy by ``critic_only`` of
        `flockstep.PPO`.

        For every task, from `EpisodeConfig`, which documents them: ``episodes``, ``max_episode_steps``, ``frame_skip``,
        ``stagger_first_episode``, ``random_world``.

        For every task, from `ClockConfig`, which documents them: ``policy_hz``, ``physics_hz``, ``controller_hz``.

        For every task, from `DynamicsConfig`, which documents them: ``motion``, ``control``, ``integrator``,
        ``on_contact``, ``restitution``, ``friction``, ``rotor_lag``, ``rotor_drag``, ``body_drag``, ``gyroscopic``,
        ``ground_effect``, ``downwash``, ``wind``, ``max_speed_mps``, ``max_acceleration_mps2``, ``max_tilt_deg``,
        ``max_rate_dps``, ``max_yaw_rate_dps``.

        For the navigation task, from `NavigationConfig`, which documents them: ``action``, ``step_m``,
        ``yaw_step_deg``, ``reward``, ``random_start``, ``color``.

        For the hover task, from `HoverConfig`, which documents them: ``start_offset_m``, ``start_tilt_deg``,
        ``start_speed_mps``, ``start_rate_dps``, ``max_distance_m``, ``hold_m``, ``hold_s``, ``near_weight``,
        ``hold_weight``, ``speed_weight``, ``spin_weight``, ``change_weight``, ``crash_weight``.

        For the track task, from `TrackConfig`, which documents them: ``path``, ``yaw``, ``size_m``, ``speed_mps``,
        ``start_offset_m``, ``points``, ``ahead_s``, ``max_distance_m``, ``close_m``, ``near_weight``, ``close_weight``,
        ``yaw_weight``, ``spin_weight``, ``change_weight``, ``crash_weight``.

        For the race task, from `RaceConfig`, which documents them: ``laps``, ``gates_ahead``, ``max_thrust_to_weight``,
        ``start``, ``start_offset_m``, ``start_yaw_deg``, ``start_tilt_deg``, ``start_speed_mps``, ``miss_m``,
        ``max_distance_m``, ``observation_scale``, ``speed_cap_mps``, ``cap_rise_mps``, ``cap_episodes``,
        ``cap_success``, ``progress_weight``, ``gate_weight``, ``rates_weight``, ``change_weight``, ``crash_weight``.

        For the dodge task, from `DodgeConfig`, which documents them: ``step_m``, ``goal_distance_m``,
        ``goal_radius_m``, ``near_m``, ``progress_weight``, ``goal_weight``, ``crash_weight``, ``near_weight``,
        ``time_weight``.

        For the swap task, from `SwapConfig`, which documents them: ``step_m``, ``radius_m``, ``spacing_m``,
        ``jitter_m``, ``goal_radius_m``, ``neighbors``, ``sight_m``, ``near_m``, ``progress_weight``, ``goal_weight``,
        ``crash_weight``, ``near_weight``, ``time_weight``.

        For the formation task, from `FormationConfig`, which documents them: ``shape``, ``spacing_m``, ``route``,
        ``loop_radius_m``, ``leader_speed_mps``, ``step_m``, ``jitter_m``, ``neighbors``, ``sight_m``,
        ``max_distance_m``, ``close_m``, ``near_m``, ``place_weight``, ``crash_weight``, ``near_weight``,
        ``change_weight``.
    """

    drones_per_env: int | None
    interaction: Literal["none", "sense", "collide", "both"] | None
    num_threads: int | None
    block_size: int | None
    lidar: LidarConfig | Sequence[LidarConfig] | None
    camera: CameraConfig | Sequence[CameraConfig] | None
    camera_backend: Literal["raycast", "gl", "auto"] | None
    tracer: Literal["auto", "tiles", "slices", "embree"] | None
    pose_sensor: PoseSensorConfig | None
    imu: ImuConfig | Sequence[ImuConfig] | None
    barometer: BarometerConfig | Sequence[BarometerConfig] | None
    magnetometer: MagnetometerConfig | Sequence[MagnetometerConfig] | None
    gps_receiver: GpsReceiverConfig | Sequence[GpsReceiverConfig] | None
    optical_flow: OpticalFlowConfig | Sequence[OpticalFlowConfig] | None
    bodies: BodyConfig | Sequence[BodyConfig] | None
    max_bodies: int | None
    lights: Light | Sequence[Light] | None
    episode: EpisodeConfig | None
    observed: ObservationConfig | None
    clock: ClockConfig | None
    dynamics: DynamicsConfig | None
    variations: Variation | Sequence[Variation] | None
    airframes: str | Sequence[str] | None
    privileged: str | Sequence[str] | None
    episodes: Literal["team", "each", "last"]
    max_episode_steps: int | None
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
