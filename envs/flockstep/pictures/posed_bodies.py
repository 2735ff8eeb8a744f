"""The bodies of an env for pictures."""

from __future__ import annotations

import copy

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, BodyConfig, BodyMotion
from flockstep.rotations import rotate

Floats = npt.NDArray[np.float64]

_CIRCLE = np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 24, endpoint=False)), np.sin(a)], axis=1)


def posed_bodies(batch: Batch, env: int) -> list[BodyConfig]:
    """Return the bodies of an env as configurations that stand at the current poses, without invisible ones."""
    bodies, posed = batch.bodies, []
    for body in np.flatnonzero(bodies.active[env]):
        config = copy.copy(bodies.config(env, int(body)))
        assert config is not None
        if config.visibility == "solid":
            continue
        config.position_m = bodies.position[env, body].tolist()
        config.quat_wxyz = bodies.quat_wxyz[env, body].tolist()
        config.motion = BodyMotion()
        posed.append(config)
    return posed


def outline(body: BodyConfig) -> Floats:
    """Return points around a body seen from above, (K, 3) m, world frame."""
    if body.mesh is not None:
        corners = rotate(np.asarray(body.quat_wxyz, float), body.mesh.mesh()["vertices"].astype(float))
        outermost: Floats = corners[np.argmax(corners[:, :2] @ _CIRCLE.T, axis=0)]
        return np.asarray(body.position_m, float) + outermost
    x, y, z = np.asarray(body.size_m, float) / 2
    ring = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) if body.shape == "box" else _CIRCLE * x
    levels = [-z, z] if body.shape in ("box", "cylinder") else [x - z, z - x]
    local = np.concatenate([np.column_stack([ring, np.full(len(ring), level)]) for level in levels])
    turned: Floats = rotate(np.asarray(body.quat_wxyz, float), local)
    return np.asarray(body.position_m, float) + turned
