"""The operations of a server, with asyncio."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import IntEnum
from operator import index
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from flockstep._core import BodyConfig
from flockstep.client import bodies, readers
from flockstep.client import protocol_pb2 as pb
from flockstep.client.call import Call, finite, flags, floats, given, nothing
from flockstep.client.results import (
    Angles,
    Boxes,
    CameraData,
    CameraSettings,
    CaptureMode,
    Fps,
    Impact,
    Impacts,
    LidarData,
    LidarSettings,
    LightSettings,
    Mesh,
    PointCloud,
    Rotation,
    Time,
    TimedArrays,
    WorldInfo,
)
from flockstep.client.streams import AsyncStream

_T = TypeVar("_T")
_Format: TypeAlias = Literal["jpeg", "png", "raw"]
_ALL = -1  # in place of a drone's index


class AsyncOperations:
    """The operations of a server. Each raises `ServerError` if the server refuses it.

    Units are SI. The world frame is right-handed: x east, y north, z up. The body frame is x forward, y left, z up.
    Quaternions are (w, x, y, z) and rotate from body to world. Worlds are indices in the list of `get_worlds`.
    """

    async def _call(self, call: Call[_T]) -> _T:
        raise NotImplementedError

    def _subscribe(self, call: Call[_T], rate_hz: float, only_new: bool) -> AsyncStream[_T]:
        raise NotImplementedError

    # --- the session

    async def ping(self) -> None:
        """Wait for an empty answer, to test the connection."""
        await self._call(Call(pb.Request(ping=pb.Ping()), "done", nothing))

    async def claim(self, drones: Iterable[int]) -> None:
        """Claim drones: a server with ownership then refuses operations of other clients that change them.

        On other servers a claim only shows in `get_drones`. Claims end with the connection.

        Raises
        ------
        ServerError
            ``"PERMISSION_DENIED"``: another client has claimed one of them; none is claimed.
        """
        await self._call(Call(pb.Request(claim=pb.Claim(drones=map(index, drones))), "done", nothing))

    async def release(self, drones: Iterable[int]) -> None:
        """End this client's claims of drones; others are ignored."""
        await self._call(Call(pb.Request(release=pb.Release(drones=map(index, drones))), "done", nothing))

    # --- the simulation

    def drone(self, drone: int) -> AsyncDrone:
        """Return a handle of the drone with this index. The server is not asked."""
        return AsyncDrone(self, index(drone))

    async def get_drones(self) -> list[AsyncDrone]:
        """Return the active drones, with their env and owner."""
        call = Call(pb.Request(get_drones=pb.GetDrones()), "drones", lambda reply, arrays: [*reply.drones.drones])
        return [AsyncDrone(self, drone.drone, drone.env, drone.owner) for drone in await self._call(call)]

    async def spawn_drone(
        self,
        location: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        *,
        env: int | None = None,
        claim: bool = False,
    ) -> AsyncDrone:
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
        spawn = pb.SpawnDrone(
            location=None if location is None else _vector("location", location),
            rotation=None if quat_wxyz is None else _quaternion("quat_wxyz", quat_wxyz),
            env=None if env is None else index(env),
            claim=claim,
        )
        call = Call(pb.Request(spawn_drone=spawn), "drone", lambda reply, arrays: reply.drone)
        drone = await self._call(call)
        return AsyncDrone(self, drone.drone, drone.env, drone.owner)

    async def remove_drone(self, drone: int) -> None:
        """Remove a drone: the simulation skips it, and its index may be given to a new one."""
        await self._call(Call(pb.Request(remove_drone=pb.RemoveDrone(drone=index(drone))), "done", nothing))

    async def get_camera_capture_mode(self, camera: str = "") -> CaptureMode:
        """Return when a camera renders. Default: the only camera."""
        request = pb.Request(get_camera_capture_mode=pb.GetCameraCaptureMode(camera=camera))
        return await self._call(Call(request, "capture_mode", readers.capture_mode))

    async def set_camera_capture_mode(self, mode: CaptureMode, camera: str = "") -> None:
        """Set when a camera renders.

        Parameters
        ----------
        mode
            ``"every_step"``, ``"on_movement"`` (of its drone) or ``"on_demand"`` (of `get_camera_data`).
        camera
            Name of the camera. Default: the only camera.
        """
        number = _choice("mode", mode, pb.CaptureModeName)
        request = pb.Request(set_camera_capture_mode=pb.SetCameraCaptureMode(camera=camera, mode=number))
        await self._call(Call(request, "done", nothing))

    async def get_fps(self) -> Fps:
        """Return the speed of the simulation."""
        return await self._call(_get_fps())

    async def set_lidar_config(
        self,
        lidar: str = "",
        *,
        channels: int | None = None,
        beams: int | None = None,
        hfov_deg: float | None = None,
        vfov_deg: float | None = None,
        max_range_m: float | None = None,
        offset_m: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
    ) -> None:
        """Change a LiDAR of all drones. See `LidarSettings`; what is not given stays unchanged.

        Parameters
        ----------
        lidar
            Name of the LiDAR. Default: the first.
        channels, beams
            Rows and columns of the scan. They change the shapes of arrays.
        hfov_deg, vfov_deg
            Horizontal and vertical field of view in degrees.
        max_range_m
            Range in m.
        offset_m, quat_wxyz
            Pose of the sensor in the body frame: (3,) m and (4,).
        """
        config = _lidar_config(channels, beams, hfov_deg, vfov_deg, max_range_m, offset_m, quat_wxyz)
        await self._call(_set_lidar_config(_ALL, lidar, config))

    async def set_camera_config(
        self,
        camera: str = "",
        *,
        width_px: int | None = None,
        height_px: int | None = None,
        hfov_deg: float | None = None,
        vfov_deg: float | None = None,
        offset_m: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
    ) -> None:
        """Change a camera of all drones. See `CameraSettings`; what is not given stays unchanged.

        Parameters
        ----------
        camera
            Name of the camera. Default: the only camera.
        width_px, height_px
            Size in pixels. They change the shapes of arrays.
        hfov_deg, vfov_deg
            Field of view in degrees. If one is given, the other is set for square pixels.
        offset_m, quat_wxyz
            Pose of the sensor in the body frame: (3,) m and (4,).
        """
        config = _camera_config(width_px, height_px, hfov_deg, vfov_deg, offset_m, quat_wxyz)
        await self._call(_set_camera_config(_ALL, camera, config))

    # --- many drones at once

    async def get_arrays(self, names: Sequence[str], *, sensor: str = "") -> TimedArrays:
        """Return arrays of all drones or envs as they were after the last completed operation, all of one moment.

        Parameters
        ----------
        names
            Names of arrays, such as ``["position", "quat_wxyz"]``; ``info.array_names`` lists those of the batch.
        sensor
            Name of a LiDAR, camera or IMU, whose arrays are then named. Default: those of the batch.
        """
        return await self._call(_get_arrays(names, sensor))

    async def set_poses(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
        teleport: bool = False,
    ) -> Impacts:
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
        arrays = given(
            position=None if position is None else floats("position", position, -1, 3),
            quat_wxyz=None if quat_wxyz is None else floats("quat_wxyz", quat_wxyz, -1, 4),
            mask=None if mask is None else flags("mask", mask),
        )
        request = pb.Request(set_poses=pb.SetPoses(teleport=teleport))
        return await self._call(Call(request, "time", readers.impacts, arrays))

    async def fly(
        self, command: npt.ArrayLike, *, control: str = "", ticks: int = 0, mask: npt.ArrayLike | None = None
    ) -> Time:
        """Fly all drones by their rotors.

        Parameters
        ----------
        command
            (N, 4) commands, whose meaning depends on ``control``; see `DynamicsConfig`.
        control
            Name of the control, such as ``"velocity"``. Default: that of the batch.
        ticks
            Number of ticks of the physics. Default: one step.
        mask
            (N,) bool: the drones to fly. Default: all.
        """
        arrays: dict[str, npt.NDArray[Any]] = {"command": floats("command", command, -1, 4)}
        if mask is not None:
            arrays["mask"] = flags("mask", mask)
        request = pb.Request(fly=pb.Fly(ticks=index(ticks), control=control))
        return await self._call(Call(request, "time", readers.time, arrays))

    async def set_command(
        self, command: npt.ArrayLike, *, control: str = "", mask: npt.ArrayLike | None = None
    ) -> None:
        """Set the commands (N, 4) that later steps fly. See `fly` for the parameters."""
        arrays: dict[str, npt.NDArray[Any]] = {"command": floats("command", command, -1, 4)}
        if mask is not None:
            arrays["mask"] = flags("mask", mask)
        await self._call(Call(pb.Request(set_command=pb.SetCommand(control=control)), "done", nothing, arrays))

    # --- bodies of many envs at once

    async def spawn_bodies(
        self,
        body: BodyConfig,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
    ) -> npt.NDArray[np.int64]:
        """Put a body into the first free slot of each env, or of no env if one has no free slot.

        Parameters
        ----------
        body
            Its configuration.
        position, quat_wxyz
            Poses (E, 3) m and (E, 4), world frame. Default here and below: those of the configuration.
        velocity, angular_velocity
            (E, 3) m/s, world frame, and (E, 3) rad/s, body frame. Without any of the four arrays, the script of the
            configuration moves the body.
        mask
            (E,) bool: the envs. Default: all.

        Returns
        -------
        slots
            (E,) The slots; -1 for other envs.
        """
        return await self._call(bodies.spawn(body, position, quat_wxyz, velocity, angular_velocity, mask))

    async def remove_bodies(self, mask: npt.ArrayLike | None = None) -> Time:
        """Remove bodies until the next episode: those of the mask (E, B), or all of the envs of a mask (E,), or all."""
        return await self._call(bodies.remove(mask))

    async def set_body_poses(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
    ) -> Time:
        """Place bodies. They leave their scripts until the next episode.

        Parameters
        ----------
        position, quat_wxyz
            (E, B, 3) m and (E, B, 4), world frame. Default: unchanged.
        mask
            (E, B) bool: the bodies, or (E,) for all bodies of envs. Default: all. Free slots are skipped.
        """
        return await self._call(bodies.set_poses(position, quat_wxyz, mask))

    async def set_body_velocities(
        self,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
    ) -> Time:
        """Set the velocities of bodies, which keep them until the next episode.

        Parameters
        ----------
        velocity, angular_velocity
            (E, B, 3) m/s, world frame, and (E, B, 3) rad/s, body frame. Default: unchanged.
        mask
            As for `set_body_poses`.
        """
        return await self._call(bodies.set_velocities(velocity, angular_velocity, mask))

    async def get_body_configs(self, envs: Iterable[int] | None = None) -> list[list[BodyConfig | None]]:
        """Return the configurations of the bodies in some envs: for each env a list of B, with None for free slots.

        Parameters
        ----------
        envs
            Indices of envs. Default: all.
        """
        return await self._call(bodies.get_configs(envs))

    # --- time

    async def step(self) -> Time:
        """Step once, if the batch has no task: drones with rotors fly their commands, then the sensors are read.

        In lockstep, the step waits until every member has asked for it.
        """
        return await self._call(Call(pb.Request(step=pb.Step()), "time", readers.time))

    async def set_clock(self, rate_hz: float) -> Time:
        """Let the server step at this rate of wall time, in Hz; 0: time stands still between the steps of clients."""
        return await self._call(Call(pb.Request(set_clock=pb.SetClock(rate_hz=rate_hz)), "time", readers.time))

    async def join_lockstep(self) -> Time:
        """Join the lockstep: from now on, the server steps when every member has called `step`.

        `step` may then wait for longer than ``timeout_s`` of `connect`. A member for whose `step` the others have
        waited for ``lockstep_timeout_s`` of the server leaves the lockstep; its next `step` raises `ServerError`.
        """
        return await self._call(Call(pb.Request(join_lockstep=pb.JoinLockstep()), "time", readers.time))

    async def leave_lockstep(self) -> None:
        """Leave the lockstep. The end of the connection does the same."""
        await self._call(Call(pb.Request(leave_lockstep=pb.LeaveLockstep()), "done", nothing))

    async def sense(self) -> Time:
        """Read all sensors now."""
        return await self._call(Call(pb.Request(sense=pb.Sense()), "time", readers.time))

    async def snapshot(self) -> bytes:
        """Return everything that affects later steps."""
        return await self._call(Call(pb.Request(snapshot=pb.Snapshot()), "done", readers.snapshot))

    async def restore(self, snapshot: bytes) -> None:
        """Go back to a snapshot."""
        arrays = {"snapshot": np.frombuffer(snapshot, np.uint8)}
        await self._call(Call(pb.Request(restore=pb.Restore()), "done", nothing, arrays))

    # --- worlds

    async def get_worlds(self) -> list[WorldInfo]:
        """Return the worlds that the server was started with."""
        return await self._call(Call(pb.Request(get_worlds=pb.GetWorlds()), "worlds", readers.worlds))

    async def set_world(self, env: int, world: int) -> None:
        """Put an env into another world. Its drones keep their poses."""
        request = pb.Request(set_world=pb.SetWorld(env=index(env), world=index(world)))
        await self._call(Call(request, "done", nothing))

    async def get_light(self, world: int = 0, *, env: int | None = None) -> LightSettings:
        """Return the light of an env, or without one that of a world."""
        get = pb.GetLight(world=index(world)) if env is None else pb.GetLight(env=index(env))
        return await self._call(Call(pb.Request(get_light=get), "light", readers.light))

    async def set_light(
        self,
        world: int = 0,
        *,
        envs: Iterable[int] | None = None,
        sun_direction: npt.ArrayLike | None = None,
        sun_color: npt.ArrayLike | None = None,
        sky_ambient: npt.ArrayLike | None = None,
        ground_ambient: npt.ArrayLike | None = None,
        zenith_color: npt.ArrayLike | None = None,
        horizon_color: npt.ArrayLike | None = None,
        gamma: float | None = None,
        sun_radius_deg: float | None = None,
        sun_glow: float | None = None,
        fog_visibility_m: float | None = None,
    ) -> None:
        """Change the light of some envs, or that of a world, for all envs in it that have no light of their own.

        Parameters
        ----------
        world
            Index of the world, without ``envs``.
        envs
            Indices of the envs, whose lights change. If nothing else is given, they show the lights of their worlds
            again. Default: the light of the world changes.
        sun_direction
            Direction towards the sun, (3,), world frame. Default here and below: unchanged.
        sun_color
            Colour of the sun, linear RGB (3,), like the other colours.
        sky_ambient, ground_ambient
            Ambient light from above and from below.
        zenith_color, horizon_color
            Colours of the sky.
        gamma
            Exponent of written colours.
        sun_radius_deg
            Radius of the sun's disc in the sky; 0: no disc.
        sun_glow
            Share of the sun's colour in the sky next to it.
        fog_visibility_m
            Distance at which fog leaves 2 % of a surface's contrast; 0: no fog.
        """
        colors = given(
            sun_direction=sun_direction,
            sun_color=sun_color,
            sky_ambient=sky_ambient,
            ground_ambient=ground_ambient,
            zenith_color=zenith_color,
            horizon_color=horizon_color,
        )
        numbers = given(
            gamma=gamma, sun_radius_deg=sun_radius_deg, sun_glow=sun_glow, fog_visibility_m=fog_visibility_m
        )
        fields: dict[str, Any] = {name: _vector(name, value) for name, value in colors.items()}
        fields |= {name: finite(name, [value], 1)[0] for name, value in numbers.items()}
        light = pb.Light(**fields)
        chosen = [] if envs is None else [index(env) for env in envs]
        if envs is not None and not chosen:
            raise ValueError("envs: expected at least one index, got none")
        if chosen:
            change = pb.SetLight(envs=chosen, light=light) if fields else pb.SetLight(envs=chosen)
        else:
            change = pb.SetLight(world=index(world), light=light)
        await self._call(Call(pb.Request(set_light=change), "done", nothing))

    async def get_mesh(self, world: int = 0) -> Mesh:
        """Return the geometry of a world as triangles."""
        return await self._call(Call(pb.Request(get_mesh=pb.GetMesh(world=index(world))), "done", readers.mesh))

    async def get_point_cloud(self, world: int = 0, *, spacing_m: float = 0.1) -> PointCloud:
        """Return points on the surfaces of a world, about ``spacing_m`` apart."""
        request = pb.Request(get_point_cloud=pb.GetPointCloud(world=index(world), spacing_m=spacing_m))
        return await self._call(Call(request, "done", readers.point_cloud))

    async def get_boxes(self, world: int = 0) -> Boxes:
        """Return the smallest box around each object of a world."""
        return await self._call(Call(pb.Request(get_boxes=pb.GetBoxes(world=index(world))), "done", readers.boxes))

    # --- streams

    def subscribe_arrays(
        self, names: Sequence[str], *, sensor: str = "", rate_hz: float = 30.0, only_new: bool = False
    ) -> AsyncStream[TimedArrays]:
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
        return self._subscribe(_get_arrays(names, sensor), rate_hz, only_new)

    def subscribe_fps(self, *, rate_hz: float = 1.0) -> AsyncStream[Fps]:
        """Receive the speed of the simulation again and again, ``rate_hz`` times a second at most."""
        return self._subscribe(_get_fps(), rate_hz, False)


class AsyncDrone:
    """A drone of a server. `drone`, `get_drones` and `spawn_drone` make it.

    Attributes
    ----------
    index
        Index in the batch.
    env
        Its env, or None if the object comes from `drone`.
    owner
        Number of the client that had claimed it when the object was made, or 0; None if the object comes from `drone`.
    """

    def __init__(self, client: AsyncOperations, index: int, env: int | None = None, owner: int | None = None) -> None:
        self._client = client
        self.index = index
        self.env = env
        self.owner = owner

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.index}>"

    async def get_location(self) -> npt.NDArray[np.float32]:
        """Return the location (3,) in m, world frame."""
        request = pb.Request(get_location=pb.GetLocation(drone=self.index))
        return await self._client._call(Call(request, "location", readers.location))

    async def set_location(self, location: npt.ArrayLike, *, teleport: bool = False) -> Impact:
        """Move the drone in a straight line, until it touches something.

        Parameters
        ----------
        location
            (3,) m, world frame.
        teleport
            Place the drone there without a collision check.
        """
        message = pb.SetLocation(drone=self.index, location=_vector("location", location), teleport=teleport)
        return await self._client._call(Call(pb.Request(set_location=message), "impact", readers.impact))

    async def get_rotation(self) -> Rotation:
        """Return the rotation from body to world."""
        request = pb.Request(get_rotation=pb.GetRotation(drone=self.index))
        return await self._client._call(Call(request, "rotation", readers.rotation))

    async def set_rotation(self, rotation: npt.ArrayLike | Angles, *, teleport: bool = False) -> Impact:
        """Turn the drone, until it touches something.

        Parameters
        ----------
        rotation
            A quaternion (w, x, y, z) of any length above 0, or `Angles`.
        teleport
            Turn without a collision check.
        """
        message = pb.SetRotation(drone=self.index, teleport=teleport, **_rotation(rotation))
        return await self._client._call(Call(pb.Request(set_rotation=message), "impact", readers.impact))

    async def set_location_and_rotation(
        self, location: npt.ArrayLike, rotation: npt.ArrayLike | Angles, *, teleport: bool = False
    ) -> Impact:
        """Move and turn the drone, until it touches something. See `set_location` and `set_rotation`."""
        message = pb.SetLocationAndRotation(
            drone=self.index, location=_vector("location", location), teleport=teleport, **_rotation(rotation)
        )
        return await self._client._call(Call(pb.Request(set_location_and_rotation=message), "impact", readers.impact))

    async def get_camera_data(
        self, camera: str = "", *, format: _Format = "jpeg", quality: int = 90, output: str = ""
    ) -> CameraData:
        """Return the image of a camera.

        A camera in the capture mode ``"on_demand"`` renders now; in the other modes, only if its frame is stale.

        Parameters
        ----------
        camera
            Name of the camera. Default: the only camera.
        format
            ``"jpeg"`` or ``"png"``: a file; ``"raw"``: the pixels.
        quality
            Quality of a JPEG file, 1 to 100.
        output
            Name of an output of the camera, such as ``"depth"``; a file can hold only ``"rgb"`` or ``"grey"``. Default:
            ``"rgb"``, or ``"grey"`` if there is no colour.
        """
        return await self._client._call(_get_camera_data(self.index, camera, format, quality, output))

    async def get_lidar_data(self, lidar: str = "", *, directions: bool = True) -> LidarData:
        """Scan now and return the result.

        Parameters
        ----------
        lidar
            Name of the LiDAR. Default: the first.
        directions
            Return the directions of the beams, too. They change only with the settings.
        """
        return await self._client._call(_get_lidar_data(self.index, lidar, directions))

    async def get_lidar_config(self, lidar: str = "") -> LidarSettings:
        """Return the settings of a LiDAR. Default: the first."""
        request = pb.Request(get_lidar_config=pb.GetLidarConfig(drone=self.index, lidar=lidar))
        return await self._client._call(Call(request, "lidar_config", readers.lidar_settings))

    async def set_lidar_config(
        self,
        lidar: str = "",
        *,
        channels: int | None = None,
        beams: int | None = None,
        hfov_deg: float | None = None,
        vfov_deg: float | None = None,
        max_range_m: float | None = None,
        offset_m: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
    ) -> None:
        """Change a LiDAR of this drone; what is not given stays unchanged.

        The parameters are those of the client's ``set_lidar_config``. If ``channels`` or ``beams`` is given, everything
        that is given changes for all drones.
        """
        config = _lidar_config(channels, beams, hfov_deg, vfov_deg, max_range_m, offset_m, quat_wxyz)
        await self._client._call(_set_lidar_config(self.index, lidar, config))

    async def get_camera_config(self, camera: str = "") -> CameraSettings:
        """Return the settings of a camera. Default: the only camera."""
        request = pb.Request(get_camera_config=pb.GetCameraConfig(drone=self.index, camera=camera))
        return await self._client._call(Call(request, "camera_config", readers.camera_settings))

    async def set_camera_config(
        self,
        camera: str = "",
        *,
        width_px: int | None = None,
        height_px: int | None = None,
        hfov_deg: float | None = None,
        vfov_deg: float | None = None,
        offset_m: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
    ) -> None:
        """Change a camera of this drone; what is not given stays unchanged.

        The parameters are those of the client's ``set_camera_config``. If ``width_px`` or ``height_px`` is given,
        everything that is given changes for all drones.
        """
        config = _camera_config(width_px, height_px, hfov_deg, vfov_deg, offset_m, quat_wxyz)
        await self._client._call(_set_camera_config(self.index, camera, config))

    async def get_move_line_visible(self) -> bool:
        """Return whether the line of the drone's past positions is drawn."""
        request = pb.Request(get_move_line_visible=pb.GetMoveLineVisible(drone=self.index))
        return await self._client._call(Call(request, "move_line_visible", readers.move_line_visible))

    async def set_move_line_visible(self, visible: bool) -> None:
        """Draw the line of the drone's past positions into the RGB images that the server returns, or stop that."""
        request = pb.Request(set_move_line_visible=pb.SetMoveLineVisible(drone=self.index, visible=visible))
        await self._client._call(Call(request, "done", nothing))

    async def set_command(self, command: npt.ArrayLike, *, control: str = "") -> None:
        """Set the command (4,) that later steps fly.

        Parameters
        ----------
        command
            Four numbers, whose meaning depends on ``control``; see `DynamicsConfig`.
        control
            Name of the control, such as ``"velocity"``. Default: that of the batch.
        """
        request = pb.Request(set_command=pb.SetCommand(drone=self.index, control=control))
        await self._client._call(Call(request, "done", nothing, {"command": floats("command", command, 4)}))

    async def claim(self) -> None:
        """Claim the drone for this client; see `AsyncClient.claim`."""
        await self._client.claim([self.index])

    async def release(self) -> None:
        """End this client's claim of the drone."""
        await self._client.release([self.index])

    async def remove(self) -> None:
        """Remove the drone from the simulation."""
        await self._client.remove_drone(self.index)

    def subscribe_camera(
        self,
        camera: str = "",
        *,
        format: _Format = "jpeg",
        quality: int = 90,
        output: str = "",
        rate_hz: float = 30.0,
        only_new: bool = False,
    ) -> AsyncStream[CameraData]:
        """Receive images again and again. See `get_camera_data` and `AsyncClient.subscribe_arrays`."""
        call = _get_camera_data(self.index, camera, format, quality, output)
        return self._client._subscribe(call, rate_hz, only_new)

    def subscribe_lidar(
        self, lidar: str = "", *, directions: bool = True, rate_hz: float = 30.0, only_new: bool = False
    ) -> AsyncStream[LidarData]:
        """Receive scans again and again. See `get_lidar_data` and `AsyncClient.subscribe_arrays`."""
        return self._client._subscribe(_get_lidar_data(self.index, lidar, directions), rate_hz, only_new)


# --- calls of several operations


def _get_fps() -> Call[Fps]:
    return Call(pb.Request(get_fps=pb.GetFps()), "fps", readers.fps)


def _get_arrays(names: Sequence[str], sensor: str) -> Call[TimedArrays]:
    if isinstance(names, str):
        raise TypeError(f"names: expected a list of names, got {names!r}")
    return Call(pb.Request(get_arrays=pb.GetArrays(names=names, sensor=sensor)), "time", readers.timed_arrays)


def _get_camera_data(drone: int, camera: str, format: _Format, quality: int, output: str) -> Call[CameraData]:
    if format == "jpeg" and not 1 <= quality <= 100:
        raise ValueError(f"quality: expected an integer from 1 to 100, got {quality!r}")
    number = _choice("format", format, pb.ImageFormat)
    message = pb.GetCameraData(drone=drone, camera=camera, format=number, quality=index(quality), output=output)
    return Call(pb.Request(get_camera_data=message), "camera_data", readers.camera_data)


def _get_lidar_data(drone: int, lidar: str, directions: bool) -> Call[LidarData]:
    message = pb.GetLidarData(drone=drone, lidar=lidar, without_directions=not directions)
    return Call(pb.Request(get_lidar_data=message), "lidar_data", readers.lidar_data)


def _set_lidar_config(drone: int, lidar: str, config: pb.LidarConfig) -> Call[None]:
    message = pb.SetLidarConfig(drone=drone, lidar=lidar, config=config)
    return Call(pb.Request(set_lidar_config=message), "done", nothing)


def _set_camera_config(drone: int, camera: str, config: pb.CameraConfig) -> Call[None]:
    message = pb.SetCameraConfig(drone=drone, camera=camera, config=config)
    return Call(pb.Request(set_camera_config=message), "done", nothing)


# --- arguments to messages


def _vector(name: str, values: npt.ArrayLike) -> pb.Vector3:
    x, y, z = finite(name, values, 3)
    return pb.Vector3(x=x, y=y, z=z)


def _quaternion(name: str, values: npt.ArrayLike) -> pb.Quaternion:
    w, x, y, z = finite(name, values, 4)
    return pb.Quaternion(w=w, x=x, y=y, z=z)


def _rotation(rotation: npt.ArrayLike | Angles) -> dict[str, Any]:
    if isinstance(rotation, Angles):
        return {"angles": pb.Angles(**rotation._asdict())}
    return {"quaternion": _quaternion("rotation", rotation)}


def _lidar_config(
    channels: int | None,
    beams: int | None,
    hfov_deg: float | None,
    vfov_deg: float | None,
    max_range_m: float | None,
    offset_m: npt.ArrayLike | None,
    quat_wxyz: npt.ArrayLike | None,
) -> pb.LidarConfig:
    return pb.LidarConfig(
        channels=channels,
        beams=beams,
        hfov_deg=hfov_deg,
        vfov_deg=vfov_deg,
        max_range_m=max_range_m,
        offset_m=None if offset_m is None else _vector("offset_m", offset_m),
        rotation=None if quat_wxyz is None else _quaternion("quat_wxyz", quat_wxyz),
    )


def _camera_config(
    width_px: int | None,
    height_px: int | None,
    hfov_deg: float | None,
    vfov_deg: float | None,
    offset_m: npt.ArrayLike | None,
    quat_wxyz: npt.ArrayLike | None,
) -> pb.CameraConfig:
    return pb.CameraConfig(
        width_px=width_px,
        height_px=height_px,
        hfov_deg=hfov_deg,
        vfov_deg=vfov_deg,
        offset_m=None if offset_m is None else _vector("offset_m", offset_m),
        rotation=None if quat_wxyz is None else _quaternion("quat_wxyz", quat_wxyz),
    )


def _choice(name: str, value: str, choices: type[IntEnum]) -> int:
    """Return the number of a choice."""
    numbers = {choice.name.lower(): choice.value for choice in choices}
    if value not in numbers:
        raise ValueError(f"{name}: expected {', '.join(map(repr, numbers))}, got {value!r}")
    return numbers[value]
