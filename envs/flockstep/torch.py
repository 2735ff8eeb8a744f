"""Differentiable flight for PyTorch: losses of your own, differentiated through the motion of drones.

>>> state = torch.as_tensor(batch.flown)
>>> for _ in range(32):
...     state = flockstep.torch.fly(batch, state, policy(state))
>>> flockstep.torch.parts(state).position.square().sum().backward()
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch

try:
    import torch
except ImportError as error:
    needed = f"flockstep.torch needs PyTorch: pip install 'flockstep[sb3]' ({error})"
    raise type(error)(needed, name=error.name) from error


class Parts(NamedTuple):
    """Views of the columns of a state, (N, ...)."""

    position: torch.Tensor
    """(N, 3) m, world frame."""
    velocity: torch.Tensor
    """(N, 3) m/s, world frame."""
    quat_wxyz: torch.Tensor
    """(N, 4) unit, body to world."""
    angular_velocity: torch.Tensor
    """(N, 3) rad/s, body frame."""
    error_integral: torch.Tensor
    """(N, 3) m, integral of the controller's velocity error."""
    rotor_speed: torch.Tensor
    """(N, 4) rad/s."""
    rotor_command: torch.Tensor
    """(N, 4) rad/s, last commanded."""


def parts(state: torch.Tensor) -> Parts:
    """Return the columns of a state (N, 24), which is like `Batch.flown`, by their names."""
    return Parts(*torch.split(state, [3, 3, 4, 3, 3, 4, 4], dim=1))


def fly(batch: Batch, state: torch.Tensor, command: torch.Tensor, ticks: int = 1) -> torch.Tensor:
    """Fly commands (N, 4) for one step from a state (N, 24), like `Batch.flown`, and return the state after it.

    The flight is that of `Batch.fly`, with contacts. Drones whose state in the batch is another one are put into it
    first. Commands may not be late: fly earlier ones instead. Derivatives are those of `Batch.pullback`, over ``ticks``
    long ticks. They are zero for drones that touched something in the step, or became too fast to integrate.
    """
    after: torch.Tensor = _Fly.apply(state, command, batch, ticks)  # type: ignore[no-untyped-call]
    return after


def _rows(tensor: torch.Tensor) -> npt.NDArray[np.float32]:
    rows: npt.NDArray[np.float32] = tensor.detach().to("cpu", torch.float32).numpy()
    return rows


class _Fly(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, state: torch.Tensor, command: torch.Tensor, batch: Batch, ticks: int) -> torch.Tensor:
        before = _rows(state)
        batch.flown = before
        hit = np.array(batch.fly(_rows(command)).hit)
        after = batch.flown
        # A drone that became too fast stays at rest where it was.
        lost = (after[:, :3] == before[:, :3]).all(1) & ~after[:, 3:6].any(1) & before[:, 3:6].any(1)
        ctx.batch, ctx.ticks, ctx.goes_on = batch, ticks, ~(hit | lost)
        ctx.save_for_backward(state, command)
        return torch.from_numpy(after).to(state)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, d_after: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, None, None]:
        state, command = ctx.saved_tensors
        d_rows = np.where(ctx.goes_on[:, None], _rows(d_after), np.float32(0))
        d_state, d_command = ctx.batch.pullback(_rows(state), _rows(command), d_rows, ctx.ticks)
        return torch.from_numpy(d_state).to(state), torch.from_numpy(d_command).to(command), None, None
