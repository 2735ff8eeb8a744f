"""The calls that concern bodies, and the bodies of a `RemoteBatch`."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable
from operator import index
from typing import Any, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from flockstep._core import BodyConfig, BodyMotion, World
from flockstep.arrays import refuse_masked
from flockstep.client import protocol_pb2 as pb
from flockstep.client import readers
from flockstep.client.call import Call, floats, given
from flockstep.client.frames import Arrays
from flockstep.client.results import Time

T = TypeVar("T")

_GLB_URI = "data:model/gltf-binary;base64,"  # begins a mesh in JSON


class _Caller(Protocol):
    def __call__(self, call: Call[T]) -> T: ...


def spawn(
    body: BodyConfig,
    position: npt.ArrayLike | None,
    quat_wxyz: npt.ArrayLike | None,
    velocity: npt.ArrayLike | None,
    angular_velocity: npt.ArrayLike | None,
    mask: npt.ArrayLike | None,
) -> Call[npt.NDArray[np.int64]]:
    """Return the call that spawns a body in each env."""
    if not isinstance(body, BodyConfig):
        raise TypeError(f"body: expected a flockstep.BodyConfig, got {body!r}")
    arrays = given(
        position=_rows("position", position, -1, 3),
        quat_wxyz=_rows("quat_wxyz", quat_wxyz, -1, 4),
        velocity=_rows("velocity", velocity, -1, 3),
        angular_velocity=_rows("angular_velocity", angular_velocity, -1, 3),
        mask=_mask(mask),
    )
    request = pb.Request(spawn_bodies=pb.SpawnBodies(config_json=json.dumps(_plain(body))))
    return Call(request, "time", _slots, arrays)


def remove(mask: npt.ArrayLike | None) -> Call[Time]:
    """Return the call that removes bodies."""
    request = pb.Request(remove_bodies=pb.RemoveBodies())
    return Call(request, "time", readers.time, given(mask=_mask(mask)))


def set_poses(
    position: npt.ArrayLike | None, quat_wxyz: npt.ArrayLike | None, mask: npt.ArrayLike | None
) -> Call[Time]:
    """Return the call that places bodies."""
    arrays = given(
        position=_rows("position", position, -1, -1, 3),
        quat_wxyz=_rows("quat_wxyz", quat_wxyz, -1, -1, 4),
        mask=_mask(mask),
    )
    return Call(pb.Request(set_body_poses=pb.SetBodyPoses()), "time", readers.time, arrays)


def set_velocities(
    velocity: npt.ArrayLike | None, angular_velocity: npt.ArrayLike | None, mask: npt.ArrayLike | None
) -> Call[Time]:
    """Return the call that sets the velocities of bodies."""
    arrays = given(
        velocity=_rows("velocity", velocity, -1, -1, 3),
        angular_velocity=_rows("angular_velocity", angular_velocity, -1, -1, 3),
        mask=_mask(mask),
    )
    return Call(pb.Request(set_body_velocities=pb.SetBodyVelocities()), "time", readers.time, arrays)


def get_configs(envs: Iterable[int] | None) -> Call[list[list[BodyConfig | None]]]:
    """Return the call that gets the configurations of bodies."""
    indices = None if envs is None else [*map(index, envs)]
    if indices == []:
        raise ValueError("envs: expected at least one index, got none")
    return Call(pb.Request(get_body_configs=pb.GetBodyConfigs(envs=indices)), "body_configs", _configs)


class RemoteBodies:
    """The bodies of a server's batch: E envs of B slots, with the attributes and calls of `Bodies`.

    Each access reads the attribute from the server. A call that the server refuses for a wrong value raises
    `ValueError`.
    """

    def __init__(self, call: _Caller) -> None:
        self._call = call

    def __len__(self) -> int:
        return int(self.active.shape[1])

    def spawn(
        self,
        body: BodyConfig,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> npt.NDArray[np.int64]:
        """Put a body into the first free slot of each env. See `Bodies.spawn`."""
        return self._call(spawn(body, position, quat_wxyz, velocity, angular_velocity, mask))

    def remove(self, mask: npt.ArrayLike | None = None) -> None:
        """Remove bodies. See `Bodies.remove`."""
        self._call(remove(mask))

    def set_pose(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> None:
        """Place bodies. See `Bodies.set_pose`."""
        self._call(set_poses(position, quat_wxyz, mask))

    def set_velocity(
        self,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> None:
        """Set the velocities of bodies. See `Bodies.set_velocity`."""
        self._call(set_velocities(velocity, angular_velocity, mask))

    def config(self, env: int, body: int) -> BodyConfig | None:
        """Return the configuration of a body, or None if the slot is free."""
        (configs,) = self._call(get_configs([env]))
        if not 0 <= index(body) < len(configs):
            raise ValueError(f"body: expected an integer in [0, {len(configs)}), got {body}")
        return configs[index(body)]

    def _array(self, name: str) -> npt.NDArray[Any]:
        request = pb.Request(get_arrays=pb.GetArrays(names=[f"body_{name}"]))
        return self._call(Call(request, "time", lambda reply, arrays: arrays[f"body_{name}"]))

    @property
    def active(self) -> npt.NDArray[np.bool_]:
        """Flags (E, B): the slot holds a body."""
        return self._array("active")

    @property
    def position(self) -> npt.NDArray[np.float32]:
        """Positions (E, B, 3) m, world frame."""
        return self._array("position")

    @property
    def quat_wxyz(self) -> npt.NDArray[np.float32]:
        """Rotations (E, B, 4) from body to world."""
        return self._array("quat_wxyz")

    @property
    def velocity(self) -> npt.NDArray[np.float32]:
        """Velocities (E, B, 3) m/s, world frame."""
        return self._array("velocity")

    @property
    def angular_velocity(self) -> npt.NDArray[np.float32]:
        """Angular velocities (E, B, 3) rad/s, body frame."""
        return self._array("angular_velocity")

    @property
    def scripted(self) -> npt.NDArray[np.bool_]:
        """Flags (E, B): the body's script moves it."""
        return self._array("scripted")


def _rows(name: str, values: npt.ArrayLike | None, *shape: int) -> npt.NDArray[np.float32] | None:
    return None if values is None else floats(name, values, *shape)


def _mask(values: npt.ArrayLike | None) -> npt.NDArray[np.bool_] | None:
    if values is None:
        return None
    refuse_masked("mask", values)
    array = np.asarray(values)
    if array.dtype != np.bool_ or array.ndim not in (1, 2):
        raise ValueError(f"mask: expected bools of shape (E,) or (E, B), got {array.dtype} {array.shape}")
    return array


def _plain(value: Any) -> Any:
    """Return a configuration as JSON values."""
    if isinstance(value, (BodyConfig, BodyMotion)):
        return {name: _plain(getattr(value, name)) for name in type(value).__match_args__}
    if isinstance(value, World):
        return _GLB_URI + base64.b64encode(value.to_glb()).decode()
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value


def _body(text: str) -> BodyConfig:
    fields = json.loads(text)
    if (mesh := fields.get("mesh")) is not None:
        fields["mesh"] = World.from_glb(base64.b64decode(mesh.removeprefix(_GLB_URI)))
    return BodyConfig(**{**fields, "motion": BodyMotion(**fields["motion"])})


def _slots(reply: pb.Reply, arrays: Arrays) -> npt.NDArray[np.int64]:
    return arrays["slot"]


def _configs(reply: pb.Reply, arrays: Arrays) -> list[list[BodyConfig | None]]:
    known = [*map(_body, reply.body_configs.config_json)]
    return [[None if number < 0 else known[number] for number in row] for row in arrays["config"]]
