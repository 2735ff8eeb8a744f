"""The parts of a training by `PPO`: collecting a rollout, learning from it, and the log."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from flockstep._core import RolloutConfig, UpdateConfig
from flockstep.learning.callbacks import Callbacks
from flockstep.learning.sb3_models import SCHEDULES

if TYPE_CHECKING:
    from flockstep.learning.ppo import PPO


def collect(model: PPO, callbacks: Callbacks, bar: Any) -> bool:
    """Collect a rollout; return False if a callback stops the training."""
    assert model.source is not None
    source, learner = model.source, model.learner
    learner.begin(model._config(RolloutConfig), source.rows)
    callbacks.start_rollout()
    for t in range(model.n_steps):
        with naming_step(model.num_timesteps + source.rows):
            stepped = source.step(learner, t, callbacks.need_infos)
        model.num_timesteps += source.rows
        for episode in stepped.episodes:
            model.ep_info_buffer.append({"r": episode.total, "l": episode.length})
            if episode.success is not None:
                model.ep_success_buffer.append(episode.success)
        if bar is not None:
            bar.update(source.rows)
        if not callbacks.step(stepped):
            return False
    with naming_step(model.num_timesteps):
        learner.finish(source.observation(learner))
    callbacks.end_rollout()
    return True


def train(model: PPO) -> None:
    """Learn from the rollout."""
    config = model._config(UpdateConfig, model._current_progress_remaining)
    report = model.learner.update(config)
    if not report.is_finite:
        raise FloatingPointError(
            f"step {model.num_timesteps}: the loss of an update is not finite ({report.loss}): rewards, "
            "observations or learning_rate are too large; the parameters are those before that minibatch"
        )
    model._n_updates += report.epochs
    record = model.logger.record
    for name in report.__match_args__:
        value = getattr(report, name)
        if isinstance(value, float) and not (name == "std" and model.learner.config.is_discrete):
            record(f"train/{name}", value)
    record("train/n_updates", model._n_updates, exclude="tensorboard")
    for name in SCHEDULES:
        if (value := getattr(config, name)) is not None:
            record(f"train/{name}", value)


def log_progress(model: PPO, iteration: int, seconds: float, steps: int) -> None:
    """Log the episodes and the speed, and write what was recorded since the last time."""
    record = model.logger.record
    record("time/iterations", iteration, exclude="tensorboard")
    if model.ep_info_buffer:
        record("rollout/ep_rew_mean", float(np.mean([end["r"] for end in model.ep_info_buffer])))
        record("rollout/ep_len_mean", float(np.mean([end["l"] for end in model.ep_info_buffer])))
    record("time/fps", int(steps / max(seconds, 1e-9)))
    record("time/time_elapsed", int(seconds), exclude="tensorboard")
    record("time/total_timesteps", model.num_timesteps, exclude="tensorboard")
    if model.ep_success_buffer:
        record("rollout/success_rate", float(np.mean(model.ep_success_buffer)))
    model.logger.dump(step=model.num_timesteps)


@contextmanager
def naming_step(step: int) -> Iterator[None]:
    """Name the step in errors about numbers that are not finite."""
    try:
        yield
    except FloatingPointError as error:
        raise FloatingPointError(f"step {step}: {error}; the parameters are those of the last update") from error


def progress_bar(total: int) -> Any:
    """Return a progress bar by tqdm."""
    try:
        from tqdm.auto import tqdm
    except ImportError as error:
        raise ImportError("progress_bar=True needs tqdm: pip install tqdm", name="tqdm") from error
    return tqdm(total=total, unit=" steps", unit_scale=True, mininterval=0.5)
