"""A loss of your own, differentiated through the flight: a policy learns to catch throws by its rotor thrusts.

Needs PyTorch. python examples/own_loss.py trains for less than a minute and prints how many throws are caught.
"""

from __future__ import annotations

import time

import numpy as np
import torch
from torch import Tensor, nn

import flockstep
from flockstep.torch import fly, parts

THROWS, HORIZON, UPDATES = 64, 32, 300


class Flight:
    """Thrown Crazyflies, and what a policy sees and does."""

    def __init__(self, throws: int, seed: int) -> None:
        dynamics = flockstep.DynamicsConfig(motion="rotors", control="rotor_thrusts")
        clock = flockstep.ClockConfig(policy_hz=50)
        self.batch = flockstep.Batch(
            "arena/hall", throws, drone="crazyflie", dynamics=dynamics, clock=clock, num_threads=1
        )
        drone = self.batch.drone
        self.hover = drone.mass_kg * 9.81 / 4
        self.room = self.hover * (drone.thrust_to_weight - 1)  # from hovering to full thrust
        self.middle = torch.tensor(self.batch.worlds[0].bounds.mean(axis=0), dtype=torch.float32)
        self.level = self.batch.flown
        self.random = np.random.default_rng(seed)

    def throw(self) -> Tensor:
        """Return states up to 0.5 m from the middle along each axis, tilted by up to 90 degrees, at up to 2 m/s."""
        state, count = self.level.copy(), len(self.level)
        state[:, :3] = self.middle.numpy() + self.random.uniform(-0.5, 0.5, (count, 3))
        heading = self.random.normal(size=(count, 3))
        state[:, 3:6] = heading / np.linalg.norm(heading, axis=1, keepdims=True) * self.random.uniform(0, 2, (count, 1))
        half, axis = self.random.uniform(0, np.pi / 4, count), self.random.uniform(0, 2 * np.pi, count)
        state[:, 6:10] = np.stack(
            [np.cos(half), np.sin(half) * np.cos(axis), np.sin(half) * np.sin(axis), 0 * half], axis=1
        )
        return torch.from_numpy(state)

    def observe(self, state: Tensor) -> Tensor:
        """Return offset, velocity and up in the body frame, angular velocity and rotor speeds, (N, 16)."""
        s = parts(state)
        w, axis = s.quat_wxyz[:, :1], -s.quat_wxyz[:, 1:]

        def to_body(v: Tensor) -> Tensor:
            twice = 2 * torch.linalg.cross(axis, v)
            turned: Tensor = v + w * twice + torch.linalg.cross(axis, twice)
            return turned

        up = torch.tensor([[0.0, 0.0, 1.0]]).expand_as(s.velocity)
        rotors = s.rotor_speed / float(self.level[0, 16]) - 1
        offset = to_body(self.middle - s.position)
        return torch.cat([offset, to_body(s.velocity), to_body(up), s.angular_velocity / 10, rotors], dim=1)

    def fly(self, state: Tensor, action: Tensor) -> Tensor:
        """Fly actions within -1 (no thrust) and 1 (full thrust); 0 hovers."""
        return fly(self.batch, state, self.hover + action * torch.where(action > 0, self.room, self.hover))


def loss(flight: Flight, state: Tensor, action: Tensor) -> Tensor:
    """Return the loss of a step: far from the middle, fast, turning, or with large actions."""
    s = parts(state)
    distance = (s.position - flight.middle).square().sum(1).add(0.1**2).sqrt()
    speed = s.velocity.square().sum(1).add(0.1**2).sqrt()
    spin = (s.angular_velocity / 10).square().sum(1)
    return (distance + 0.1 * speed + 0.005 * spin + 0.005 * action.square().sum(1)).mean()


def train(updates: int = UPDATES, seed: int = 0) -> nn.Module:
    """Train a policy by the derivatives of the loss over windows of steps."""
    torch.manual_seed(seed)
    flight = Flight(THROWS, seed)
    last = nn.Linear(64, 4)
    nn.init.zeros_(last.weight)
    policy = nn.Sequential(nn.Linear(16, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), last, nn.Tanh())
    adam = torch.optim.Adam(policy.parameters(), lr=1e-2, betas=(0.9, 0.99))
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(adam, updates)
    state = flight.throw()
    for update in range(updates):
        state = flight.throw() if update % 5 == 0 else state.detach()
        total = torch.zeros(())
        for _ in range(HORIZON):
            action = policy(flight.observe(state))
            state = flight.fly(state, action)
            total = total + loss(flight, state, action) / HORIZON
        adam.zero_grad()
        total.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(policy.parameters(), 0.3)
        adam.step()
        schedule.step()
    return policy


@torch.no_grad()
def caught(policy: nn.Module, throws: int = 500, seed: int = 1) -> float:
    """Return the share of throws that are within 5 cm of the middle all through the last of four seconds."""
    flight = Flight(throws, seed)
    state, holds = flight.throw(), torch.ones(throws, dtype=torch.bool)
    for step in range(200):
        state = flight.fly(state, policy(flight.observe(state)))
        if step >= 150:
            holds &= (parts(state).position - flight.middle).norm(dim=1) <= 0.05
    return float(holds.float().mean())


def main(updates: int = UPDATES) -> float:
    """Train, and return the share of throws that the policy catches."""
    torch.set_num_threads(1)  # the network is small
    return caught(train(updates))


if __name__ == "__main__":
    began = time.perf_counter()
    print(f"caught {main():.1%} of the throws within 5 cm, after {time.perf_counter() - began:.0f} s")
