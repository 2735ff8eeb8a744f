"""The operations of a server. `Client` and `AsyncClient` have them, each in its form: see `forms`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import index
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from flockstep._core import Light
from flockstep.client import protocol as pb
from flockstep.client import readers
from flockstep.client.bodies import BlockingBodies, BodyOperations
from flockstep.client.call import Call, Subscription, call, nothing, quaternion
from flockstep.client.changes import LightChanges
from flockstep.client.configs import change_json, config_of
from flockstep.client.drones import Drone, SensorOperations
from flockstep.client.forms import operation, stream
from flockstep.client.results import (
    Boxes,
    CaptureMode,
    Fps,
    Impacts,
    Mesh,
    PointCloud,
    ServerInfo,
    Time,
    TimedArrays,
    WorldInfo,
)

if TYPE_CHECKING:
    from typing_extensions import Unpack

_Drone = TypeVar("_Drone")  # kind of the handles of drones


class Operations(SensorOperations, BodyOperations, Generic[_Drone]):
    """The operations of a server. Each raises `ServerError` if the server refuses it.

    Units are SI. The world frame is right-handed: x east, y north, z up. The body frame is x forward, y left, z up.
    Quaternions are (w, x, y, z) and rotate from body to world. Worlds are indices in the list of `get_worlds`.
    """

    info: ServerInfo

    def _handle(self, index: int, env: int | None = None, owner: int | None = None) -> _Drone:
        raise NotImplementedError

    def _handle_of(self, drone: pb.Drone) -> _Drone:
        return self._handle(drone.drone, drone.env, drone.owner)

    # --- the session

    @operation
    def ping(self) -> Call[None]:
        """Wait for an empty answer, to test the connection."""
        return call("ping", nothing)

    @operation
    def claim(self, drones: Iterable[int]) -> Call[None]:
        """Claim drones: a server with ownership then refuses operations of other clients that change them.

        On other servers a claim only shows in `get_drones`. Claims end with the connection.

        Raises
        ------
        ServerError
            ``"PERMISSION_DENIED"``: another client has claimed one of them; none is claimed.
        """
        return call("claim", nothing, drones=drones)

    @operation
    def release(self, drones: Iterable[int]) -> Call[None]:
        """End this client's claims of drones; others are ignored."""
        return call("release", nothing, drones=drones)

    # --- the simulation

    def drone(self, drone: int) -> _Drone:
        """Return a handle of the drone with this index. The server is not asked."""
        return self._handle(index(drone))

    @operation
    def get_drones(self) -> Call[list[_Drone]]:
        """Return the active drones, with their env and owner."""
        return call("get_drones", lambda reply, arrays: [*map(self._handle_of, reply.drones.drones)])

    @operation
    def spawn_drone(
        self,
        location: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        *,
        env: int | None = None,
        claim: bool = False,
    ) -> Call[_Drone]:
        """Add a drone: in the place of a removed one, or in a new row of all arrays.

        Parameters
        ----------
        location
            (3,) m, world frame, where the drone touches nothing. Default: the start of the world, or a free place
            near it if that is taken.
        quat_wxyz
            Rotation (4,). Default: none.
        env
            Env of the drone. Default: any.
        claim
            Claim the drone as well.
        """
        return call(
            "spawn_drone",
            lambda reply, arrays: self._handle_of(reply.drone),
            location=location,
            rotation=None if quat_wxyz is None else quaternion("quat_wxyz", quat_wxyz),
            env=env,
            claim=claim,
        )

    @operation
    def remove_drone(self, drone: int) -> Call[None]:
        """Remove a drone: the simulation skips it, and its index may be given to a new one."""
        return call("remove_drone", nothing, drone=drone)

    @operation
    def get_camera_capture_mode(self, camera: str = "") -> Call[CaptureMode]:
        """Return when a camera renders. Default: the only camera."""
        return call("get_camera_capture_mode", readers.capture_mode, camera=camera)

    @operation
    def set_camera_capture_mode(self, mode: CaptureMode, camera: str = "") -> Call[None]:
        """Set when a camera renders.

        Parameters
        ----------
        mode
            ``"every_step"``, ``"on_movement"`` (of its drone) or ``"on_demand"`` (of `get_camera_data`).
        camera
            Name of the camera. Default: the only camera.
        """
        return call("set_camera_capture_mode", nothing, camera=camera, mode=mode)

    @operation
    def get_fps(self) -> Call[Fps]:
        """Return the speed of the simulation."""
        return _get_fps()

    # --- many drones at once

    @operation
    def get_arrays(self, names: Sequence[str], *, sensor: str = "") -> Call[TimedArrays]:
        """Return arrays of all drones or envs as they were after the last completed operation, all of one moment.

        Parameters
        ----------
        names
            Names of arrays, such as ``["position", "quat_wxyz"]``; ``info.array_names`` lists those of the batch.
        sensor
            Name of a sensor, as for `Batch.sensor`, whose arrays are then named. Default: those of the batch.
        """
        return _get_arrays(names, sensor)

    @operation
    def set_poses(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
        teleport: bool = False,
    ) -> Call[Impacts]:
        """Move all drones in straight lines, until they touch something.

        Parameters
        ----------
        position
            (N, 3) m, world frame. Default: unchanged.
        quat_wxyz
            (N, 4). Default: unchanged.
        mask
            (N,) bool: the drones to move. Default: all.
        teleport
            Place the drones there without a collision check.
        """
        arrays = {"position": position, "quat_wxyz": quat_wxyz, "mask": mask}
        return call("set_poses", readers.impacts, **arrays, teleport=teleport)

    @operation
    def fly(
        self, command: npt.ArrayLike, *, control: str = "", ticks: int = 0, mask: npt.ArrayLike | None = None
    ) -> Call[Time]:
        """Fly all drones by their rotors.

        Parameters
        ----------
        command
            (N, 4) commands, or one number for each rotor, whose meaning depends on ``control``; see `DynamicsConfig`.
        control
            Name of the control, such as ``"velocity"``. Default: that of the batch.
        ticks
            Number of ticks of the physics. Default: one step.
        mask
            (N,) bool: the drones to fly. Default: all.
        """
        return call("fly", readers.time, command=command, control=control, ticks=ticks, mask=mask)

    @operation
    def set_command(
        self, command: npt.ArrayLike, *, control: str = "", mask: npt.ArrayLike | None = None
    ) -> Call[None]:
        """Set the commands that later steps fly. See `fly` for the parameters."""
        return call("set_command", nothing, command=command, control=control, mask=mask)

    # --- time

    @operation
    def step(self) -> Call[Time]:
        """Step once, if the batch has no task: drones with rotors fly their commands, then the sensors are read.

        In lockstep, the step waits until every member has asked for it.
        """
        return call("step", readers.time)

    @operation
    def set_clock(self, rate_hz: float) -> Call[Time]:
        """Let the server step at this rate of wall time, in Hz; 0: time stands still between the steps of clients."""
        return call("set_clock", readers.time, rate_hz=rate_hz)

    @operation
    def join_lockstep(self) -> Call[Time]:
        """Join the lockstep: from now on, the server steps when every member has called `step`.

        `step` may then wait for longer than ``timeout_s`` of `connect`. A member for whose `step` the others have
        waited for ``lockstep_timeout_s`` of the server leaves the lockstep; its next `step` raises `ServerError`.
        """
        return call("join_lockstep", readers.time)

    @operation
    def leave_lockstep(self) -> Call[None]:
        """Leave the lockstep. The end of the connection does the same."""
        return call("leave_lockstep", nothing)

    @operation
    def sense(self) -> Call[Time]:
        """Read all sensors now."""
        return call("sense", readers.time)

    @operation
    def snapshot(self) -> Call[bytes]:
        """Return everything that affects later steps."""
        return call("snapshot", readers.snapshot)

    @operation
    def restore(self, snapshot: bytes) -> Call[None]:
        """Go back to a snapshot."""
        return call("restore", nothing, snapshot=np.frombuffer(snapshot, np.uint8))

    # --- worlds

    @operation
    def get_worlds(self) -> Call[list[WorldInfo]]:
        """Return the worlds that the server was started with."""
        return call("get_worlds", readers.worlds)

    @operation
    def set_world(self, env: int, world: int) -> Call[None]:
        """Put an env into another world. Its drones keep their poses."""
        return call("set_world", nothing, env=env, world=world)

    @operation
    def get_light(self, world: int = 0, *, env: int | None = None) -> Call[Light]:
        """Return the light of an env, or without one that of a world."""
        return call("get_light", config_of(Light), env=env, world=world if env is None else None)

    @operation
    def set_light(
        self, /, world: int = 0, *, envs: Iterable[int] | None = None, **fields: Unpack[LightChanges]
    ) -> Call[None]:
        """Change the light of some envs, or that of a world, for all envs in it that have no light of their own.

        Parameters
        ----------
        world
            Index of the world, without ``envs``.
        envs
            Indices of the envs, whose lights change. If nothing else is given, they show the lights of their worlds
            again. Default: the light of the world changes.
        **fields
            Fields of `Light` that change.
        """
        chosen = None if envs is None else [*map(index, envs)]
        if chosen == []:
            raise ValueError("envs: expected at least one index, got none")
        text = change_json(Light, LightChanges, fields)
        return call("set_light", nothing, config_json=text, envs=chosen, world=None if chosen else world)

    @operation
    def get_mesh(self, world: int = 0) -> Call[Mesh]:
        """Return the geometry of a world as triangles."""
        return call("get_mesh", readers.mesh, world=world)

    @operation
    def get_point_cloud(self, world: int = 0, *, spacing_m: float = 0.1) -> Call[PointCloud]:
        """Return points on the surfaces of a world, about ``spacing_m`` apart."""
        return call("get_point_cloud", readers.point_cloud, world=world, spacing_m=spacing_m)

    @operation
    def get_boxes(self, world: int = 0) -> Call[Boxes]:
        """Return the smallest box around each object of a world."""
        return call("get_boxes", readers.boxes, world=world)

    # --- streams

    @stream
    def subscribe_arrays(
        self, names: Sequence[str], *, sensor: str = "", rate_hz: float = 30.0, only_new: bool = False
    ) -> Subscription[TimedArrays]:
        """Receive arrays again and again; see `get_arrays`.

        Parameters
        ----------
        names, sensor
            As for `get_arrays`.
        rate_hz
            Maximum rate in Hz of wall time.
        only_new
            Receive only what a step or an operation may have changed.

        Returns
        -------
        stream
            An iterator with the newest values; those that are not fetched in time are dropped. ``close()`` ends it.
        """
        return Subscription(_get_arrays(names, sensor), rate_hz, only_new)

    @stream
    def subscribe_fps(self, *, rate_hz: float = 1.0) -> Subscription[Fps]:
        """Receive the speed of the simulation again and again, ``rate_hz`` times a second at most."""
        return Subscription(_get_fps(), rate_hz, False)


class BlockingOperations(Operations[Drone], BlockingBodies):
    """The operations of a server, which wait for their replies."""

    def _handle(self, index: int, env: int | None = None, owner: int | None = None) -> Drone:
        return Drone(self, index, env, owner)


def _get_fps() -> Call[Fps]:
    return call("get_fps", readers.fps)


def _get_arrays(names: Sequence[str], sensor: str) -> Call[TimedArrays]:
    if isinstance(names, str):
        raise TypeError(f"names: expected a list of names, got {names!r}")
    return call("get_arrays", readers.timed_arrays, names=names, sensor=sensor)
