"""Bodies of many envs: the operations of a server, and the bodies of a `RemoteBatch`."""

from __future__ import annotations

from collections.abc import Iterable
from operator import index
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep._core import BodyConfig
from flockstep.client import readers
from flockstep.client.call import Call, call
from flockstep.client.configs import body_configs, body_json
from flockstep.client.errors import refusals
from flockstep.client.forms import Waits, operation
from flockstep.client.frames import ArrayProperty
from flockstep.client.results import Time


class BodyOperations:
    """The operations on bodies."""

    @operation
    def spawn_bodies(
        self,
        body: BodyConfig,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
    ) -> Call[npt.NDArray[np.int64]]:
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
        return call(
            "spawn_bodies",
            lambda reply, arrays: arrays["slot"],
            config_json=body_json(body),
            position=position,
            quat_wxyz=quat_wxyz,
            velocity=velocity,
            angular_velocity=angular_velocity,
            mask=mask,
        )

    @operation
    def remove_bodies(self, mask: npt.ArrayLike | None = None) -> Call[Time]:
        """Remove bodies until the next episode: those of the mask (E, B), or all of the envs of a mask (E,), or all."""
        return call("remove_bodies", readers.time, mask=mask)

    @operation
    def set_body_poses(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
    ) -> Call[Time]:
        """Place bodies. They leave their scripts until the next episode.

        Parameters
        ----------
        position, quat_wxyz
            (E, B, 3) m and (E, B, 4), world frame. Default: unchanged.
        mask
            (E, B) bool: the bodies, or (E,) for all bodies of envs. Default: all. Free slots are skipped.
        """
        return call("set_body_poses", readers.time, position=position, quat_wxyz=quat_wxyz, mask=mask)

    @operation
    def set_body_velocities(
        self,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        *,
        mask: npt.ArrayLike | None = None,
    ) -> Call[Time]:
        """Set the velocities of bodies, which keep them until the next episode.

        Parameters
        ----------
        velocity, angular_velocity
            (E, B, 3) m/s, world frame, and (E, B, 3) rad/s, body frame. Default: unchanged.
        mask
            As for `set_body_poses`.
        """
        arrays = {"velocity": velocity, "angular_velocity": angular_velocity, "mask": mask}
        return call("set_body_velocities", readers.time, **arrays)

    @operation
    def get_body_configs(self, envs: Iterable[int] | None = None) -> Call[list[list[BodyConfig | None]]]:
        """Return the configurations of the bodies in some envs: for each env a list of B, with None for free slots.

        Parameters
        ----------
        envs
            Indices of envs. Default: all.
        """
        indices = None if envs is None else [*map(index, envs)]
        if indices == []:
            raise ValueError("envs: expected at least one index, got none")
        return call("get_body_configs", body_configs, envs=indices)


class BlockingBodies(BodyOperations, Waits):
    """The operations on bodies, which wait for their replies."""


class RemoteBodies:
    """The bodies of a server's batch: E envs of B slots, with the attributes and calls of `Bodies`.

    Each access reads the attribute from the server. A call that the server refuses for a wrong value raises
    `ValueError`.
    """

    def __init__(self, client: BlockingBodies) -> None:
        self._client = client

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
        with refusals():
            return self._client.spawn_bodies(body, position, quat_wxyz, velocity, angular_velocity, mask=mask)

    def remove(self, mask: npt.ArrayLike | None = None) -> None:
        """Remove bodies. See `Bodies.remove`."""
        with refusals():
            self._client.remove_bodies(mask)

    def set_pose(
        self,
        position: npt.ArrayLike | None = None,
        quat_wxyz: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> None:
        """Place bodies. See `Bodies.set_pose`."""
        with refusals():
            self._client.set_body_poses(position, quat_wxyz, mask=mask)

    def set_velocity(
        self,
        velocity: npt.ArrayLike | None = None,
        angular_velocity: npt.ArrayLike | None = None,
        mask: npt.ArrayLike | None = None,
    ) -> None:
        """Set the velocities of bodies. See `Bodies.set_velocity`."""
        with refusals():
            self._client.set_body_velocities(velocity, angular_velocity, mask=mask)

    def config(self, env: int, body: int) -> BodyConfig | None:
        """Return the configuration of a body, or None if the slot is free."""
        with refusals():
            (configs,) = self._client.get_body_configs([env])
        if not 0 <= index(body) < len(configs):
            raise ValueError(f"body: expected an integer in [0, {len(configs)}), got {body}")
        return configs[index(body)]

    def _array(self, name: str) -> npt.NDArray[Any]:
        with refusals():
            read = self._client._call(call("get_arrays", readers.timed_arrays, names=[f"body_{name}"]))
            return read[f"body_{name}"]

    active = ArrayProperty("Flags (E, B): the slot holds a body.")
    position = ArrayProperty("Positions (E, B, 3) m, world frame.")
    quat_wxyz = ArrayProperty("Rotations (E, B, 4) from body to world.")
    velocity = ArrayProperty("Velocities (E, B, 3) m/s, world frame.")
    angular_velocity = ArrayProperty("Angular velocities (E, B, 3) rad/s, body frame.")
    scripted = ArrayProperty("Flags (E, B): the body's script moves it.")
