"""The published policy RAPTOR (J. Eschmann et al., arXiv:2509.11481) and ours, on the same throws of all airframes.

RAPTOR, in the package foundation-policy, sets rotor speeds 100 times a second and knows nothing of the airframe. Ours
is flockstep.policies.load("hover_varied"): it commands body rates 50 times a second, and the flight controller, which
knows the airframe, sets the rotors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from foundation_policy import Raptor

import flockstep
from flockstep.rotations import rotate
from flockstep.trainings import TRAININGS, UNSEEN_SEEDS
from flockstep.trainings.varied import FRAMES, MEMORY, UNSEEN_FRAMES
from timing import Measured

FLIGHTS, FLIGHT_S = 256, 6.0
#: Throws that RAPTOR's authors would call gentle, and those of the board.
THROWS = {
    "gentle": flockstep.HoverConfig(start_offset_m=0.2, start_tilt_deg=40.0, start_speed_mps=0.5, max_distance_m=50.0),
    "board": flockstep.HoverConfig(max_distance_m=50.0),
}
#: Rotor of ours for each of RAPTOR's, which go round: front right, rear right, rear left, front left.
ROTORS = [0, 3, 1, 2]
Fly = Callable[[Any, Any], Any]


class ByRaptor:
    """Flies an environment of Hover by RAPTOR."""

    def __init__(self, envs: Any, policy: Any) -> None:
        self.envs, self.policy = envs, policy
        policy.reset()
        self.range = self._ranges(envs)
        low, hover, high = self.range
        self.last = 2.0 * (hover - low) / (high - low) - 1.0
        w, _, _, z = envs.batch.quat_wxyz.T.astype(float)
        self.heading = 2.0 * np.arctan2(z, w)  # at the throw, which RAPTOR keeps as its direction of 0

    @staticmethod
    def _ranges(envs: Any) -> Any:
        # Slowest and hovering speed of the rotors, and the fastest, of each drone.
        batch = envs.batch
        names = batch.airframes or [batch.drone.name]
        rows = []
        for drone in range(envs.num_envs):
            name = names[int(batch.params[drone, -1])] if batch.airframes else names[0]
            rotors = flockstep.DroneModel.load(name).to_dict()["rotors"]
            rows.append((rotors["min_speed_radps"], batch.rotor_speed[drone, 0], rotors["max_speed_radps"]))
        return np.array(rows).T[:, :, None] * np.ones(4)

    def _turned(self, vectors: Any) -> Any:
        # Vectors of the world in axes turned by the heading.
        x, y, z = vectors.T
        c, s = np.cos(self.heading), np.sin(self.heading)
        return np.stack([c * x + s * y, c * y - s * x, z], axis=1)

    def __call__(self, offset: Any) -> Any:
        """Return actions from the offsets of the point in the body frame."""
        batch = self.envs.batch
        axes = [self._turned(rotate(batch.quat_wxyz, np.tile(axis, (len(offset), 1)))) for axis in np.eye(3)]
        place, velocity = self._turned(-rotate(batch.quat_wxyz, offset)), self._turned(batch.velocity)
        seen = [place, np.stack(axes, axis=2).reshape(-1, 9), velocity, batch.angular_velocity, self.last]
        self.last = np.clip(self.policy.evaluate_step(np.concatenate(seen, axis=1)), -1.0, 1.0)
        low, hover, high = self.range
        speed = np.empty_like(self.last)
        speed[:, ROTORS] = self.last
        speed = low + (high - low) * (speed + 1.0) / 2.0
        return np.where(speed > hover, (speed - hover) / (high - hover), (speed - hover) / (hover - low)).astype(
            np.float32
        )


def errors(task: flockstep.HoverConfig, who: str, airframe: dict[str, Any]) -> Any:
    """Return the mean distance of each flight in its last second; infinite after a contact."""
    keywords: dict[str, Any] = {"control": "body_rates", "observed": MEMORY, "policy_hz": 50.0}
    if who == "raptor":
        keywords = {"control": "rotor_speeds", "policy_hz": 100.0}
    envs = flockstep.DroneVectorEnv(
        FLIGHTS, task=task, autoreset_mode="disabled", max_episode_steps=10_000, **airframe, **keywords
    )
    observation, _ = envs.reset(seed=UNSEEN_SEEDS.start)
    model = flockstep.policies.load("hover_varied")
    act = ByRaptor(envs, Raptor()) if who == "raptor" else None
    steps, last, crashed = round(FLIGHT_S * keywords["policy_hz"]), [], np.zeros(FLIGHTS, bool)
    for step in range(steps):
        actions = model.predict(observation, deterministic=True)[0] if act is None else act(observation[:, :3])
        observation, _, terminated, *_ = envs.step(actions)
        crashed |= terminated
        if step >= steps - keywords["policy_hz"]:
            last.append(np.linalg.norm(observation[:, :3], axis=1))
    envs.close()
    return np.where(crashed, np.inf, np.mean(last, axis=0))


def measure() -> Iterator[Measured]:
    """Fly both on every airframe, and on random ones that training did not draw."""
    kinds: dict[str, dict[str, Any]] = {frame: {"drone": frame} for frame in FRAMES} | {
        "random": {"airframes": UNSEEN_FRAMES}
    }
    assert TRAININGS["hover_varied"].env == "flockstep/Hover-v0"
    for throw, task in THROWS.items():
        for kind, airframe in kinds.items():
            for who in ("raptor", "ours"):
                found = errors(task, who, airframe)
                name = f"raptor/{throw}/{kind}/{who}"
                yield f"{name}/within_50cm", float((found <= 0.5).mean()), "1", FLIGHTS
                yield f"{name}/within_5cm", float((found <= 0.05).mean()), "1", FLIGHTS
                if found[found <= 0.5].size:
                    yield f"{name}/median_error_m", float(np.median(found[found <= 0.5])), "m", FLIGHTS
