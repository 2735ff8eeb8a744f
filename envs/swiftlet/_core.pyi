"""The native module. Arrays are float32 unless said otherwise; `N` is `num_drones`.

Arrays returned as properties are read-only views owned by their batch (they keep it alive) and are written in place by the
next call; copy what you keep. Bad input raises `ValueError` naming the field before anything changes.
"""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, final

import numpy as np
import numpy.typing as npt

_F32 = npt.NDArray[np.float32]
_F64 = npt.NDArray[np.float64]
_I32 = npt.NDArray[np.int32]
_I64 = npt.NDArray[np.int64]
_U64 = npt.NDArray[np.uint64]
_Bool = npt.NDArray[np.bool_]

__version__: str
embree_version: str
simd_target: str

@final
class LidarConfig:
    channels: int
    beams: int
    hfov_deg: float
    vfov_deg: float
    max_range_m: float
    offset_m: tuple[float, float, float]
    quat_wxyz: tuple[float, float, float, float]
    azimuth_deg: list[float]
    elevation_deg: list[float]
    def __init__(
        self,
        *,
        channels: int = 1,
        beams: int = 35,
        hfov_deg: float = 270.0,
        vfov_deg: float = 0.0,
        max_range_m: float = 3.0,
        offset_m: Sequence[float] = (0.0, 0.0, 0.0),
        quat_wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
        azimuth_deg: Sequence[float] = (),
        elevation_deg: Sequence[float] = (),
    ) -> None: ...
    @property
    def shape(self) -> tuple[int, int]: ...  # (channels, beams) of one scan

@final
class PoseSensorConfig:
    position_noise_std_m: float
    tilt_noise_std_deg: float
    def __init__(self, *, position_noise_std_m: float = 0.0, tilt_noise_std_deg: float = 0.0) -> None: ...

@final
class NavigationReward:
    # fields as in config.hpp: distance_weight, crash_weight, free_space_weight, step_weight, action_change_weight, outrun_weight,
    # goal_reward, waypoint_share, goal_radius_m, min_clearance, step_scale, thesis_switch
    def __init__(self, *, distance_weight: float = 1.0, crash_weight: float = 1.0) -> None: ...

@final
class NavigationConfig:
    # fields as in config.hpp; action: "discrete" | "displacement" | "displacement_yaw"
    def __init__(self, *, action: str = "discrete", step_m: float = 0.1) -> None: ...

@final
class World:
    @staticmethod
    def load(source: str | PathLike[str]) -> World: ...
    @staticmethod
    def from_dict(scene: Mapping[str, Any], base_dir: str | PathLike[str] = "") -> World: ...
    @staticmethod
    def playground(
        seed: int, pillars: int = 12, size: Sequence[float] = (14.0, 14.0, 5.25), pillar_radius_m: float = 0.25
    ) -> World: ...
    @property
    def name(self) -> str: ...
    @property
    def bounds(self) -> _F32: ...  # (2, 3) m: min, max
    @property
    def start(self) -> _F32 | None: ...  # (3,) m
    @property
    def waypoints(self) -> _F32: ...  # (K, 3) m
    @property
    def goal(self) -> _F32 | None: ...  # (3,) m
    @property
    def spawn_box(self) -> _F32 | None: ...  # (2, 3) m
    @property
    def marker_radius(self) -> float: ...
    @property
    def primitives(self) -> list[dict[str, Any]]: ...  # kind, center, quat_wxyz, half_extents, material
    def to_dict(self) -> dict[str, Any]: ...
    def save(self, path: str | PathLike[str]) -> None: ...
    def mesh(self, chord_error_m: float = 1e-3) -> tuple[_F32, _I32]: ...
    def raycast(self, origins: npt.ArrayLike, directions: npt.ArrayLike, max_range: float) -> dict[str, Any]: ...

@final
class DroneModel:
    def __init__(self, hull: npt.ArrayLike | None = None) -> None: ...
    @property
    def hull(self) -> _F32: ...  # (V, 3) m, body frame

@final
class Contact:
    hit: _Bool  # (N,)
    inside: _Bool  # (N,) the motion began in penetration
    fraction: _F32  # (N,) of the motion flown
    point: _F32  # (N, 3) m, world frame
    normal: _F32  # (N, 3) unit, from the obstacle towards the drone

@final
class Batch:
    def __init__(
        self,
        worlds: Sequence[World],
        num_drones: int = 1,
        *,
        lidar: LidarConfig | None = None,
        pose_sensor: PoseSensorConfig | None = None,
        task: NavigationConfig | None = None,
        drone: DroneModel | None = None,
        autoreset_mode: str = "next_step",
        num_threads: int = 0,
        block_size: int = 64,
        world_index: npt.ArrayLike | None = None,  # (N,) which world each drone is in; default i mod len(worlds)
    ) -> None: ...
    # -- what it is
    num_drones: int
    num_threads: int
    worlds: list[World]
    # -- state (views, read-only)
    position: _F32  # (N, 3) m
    quat_wxyz: _F32  # (N, 4)
    active: _Bool  # (N,)
    world_index: _I32  # (N,)
    contact: Contact
    lidar_ranges: _F32  # (N, channels, beams) m, inf on a miss
    lidar_directions: _F32  # (N, channels, beams, 3) unit, body frame (a copy)
    lidar_points: _F32  # (N, channels, beams, 3) m, world frame, inf on a miss (a copy)
    sensed_position: _F32  # (N, 3) m, what the pose sensor says
    sensed_quat_wxyz: _F32  # (N, 4)
    # -- motion and sensing
    def set_pose(self, position: Any = None, quat_wxyz: Any = None, mask: Any = None) -> None: ...
    def move(self, position: Any = None, quat_wxyz: Any = None, mask: Any = None) -> Contact: ...
    def sense(self, mask: Any = None) -> None: ...
    def spawn(self, indices: Any, position: Any, quat_wxyz: Any = None, world_index: Any = None) -> None: ...
    def remove(self, indices: Any) -> None: ...
    def set_world(self, world_index: Any, mask: Any = None) -> None: ...
    def set_lidar(
        self,
        mask: Any = None,
        *,
        max_range_m: float | None = None,
        hfov_deg: float | None = None,
        vfov_deg: float | None = None,
        offset_m: Any = None,
        quat_wxyz: Any = None,
    ) -> None: ...
    # -- random numbers: uniform in [0, 1), keyed by (env seed, episode, stream); no state
    def seed(self, seeds: Any, mask: Any = None) -> None: ...  # (N,) uint64; also sets the masked envs' episode counter to 0
    def begin_episode(self, mask: Any = None) -> None: ...  # advances the episode counter (a built-in task's reset does it itself)
    def random(self, stream: int, count: int) -> _F32: ...  # (N, count)
    episode: _I64  # (N,) which episode of its seed each env is in, from 0
    # -- the built-in task (RuntimeError without one)
    def reset(self, seeds: Any = None, mask: Any = None) -> None: ...
    def step(self, actions: Any) -> None: ...
    # views of the current slot; two slots rotate, one turn a step or reset
    observation: _F32  # (N, obs)
    final_observation: _F32  # (N, obs) valid where terminated or truncated
    reward: _F32  # (N,) writable
    terminated: _Bool  # (N,)
    truncated: _Bool  # (N,)
    reward_terms: _F32  # (N, 6)
    success: _Bool  # (N,) the episode that ended in this step reached its final goal without a crash
    crashed: _Bool  # (N,) the episode that ended in this step ended by a collision
    episode_return: _F64  # (N,) of the episode that ended in this step, else of the current one so far
    episode_length: _I64  # (N,) likewise
    goal_index: _I32  # (N,) 0.. number of waypoints
    # -- all that the next step depends on
    def snapshot(self) -> bytes: ...
    def restore(self, blob: bytes) -> None: ...

def plan(world: World, start: npt.ArrayLike, goals: npt.ArrayLike, drone: DroneModel | None = None, cell_m: float = 0.1) -> _F32 | None: ...
