"""PPO by the compiled learner, with the names, defaults and semantics of Stable-Baselines3's."""

from __future__ import annotations

import inspect
import secrets
import time
import warnings
from collections import deque
from collections.abc import Mapping
from os import PathLike
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep._core import Learner, RolloutConfig, UpdateConfig, _unexpected_keyword
from flockstep.errors import did_you_mean
from flockstep.keywords import add_parameters
from flockstep.learning import files, loop, sb3_models
from flockstep.learning.arguments import Arguments
from flockstep.learning.callbacks import Callbacks
from flockstep.learning.logs import Log
from flockstep.learning.networks import network_config
from flockstep.learning.sources import SingleEnvSource, Source, rows_to_act_on, source_of

Array = npt.NDArray[Any]
_Self = TypeVar("_Self", bound="PPO")
_Config = TypeVar("_Config", RolloutConfig, UpdateConfig)


class PPO(Arguments):
    """Proximal policy optimisation in C++, for networks of fully connected layers.

    A script that trains with Stable-Baselines3's PPO trains with this class if its import changes. Steps of the
    engine's tasks stay in the engine; your own tasks, any Gymnasium vector env and any ``VecEnv`` work, too. Results
    are bit-identical for any number of threads. Policies with images or memory need Stable-Baselines3.

    >>> envs = gymnasium.make_vec("flockstep/Hover-v0", num_envs=512, autoreset_mode="same_step")
    >>> model = flockstep.PPO("MlpPolicy", envs, n_steps=32, batch_size=4096, n_epochs=5, learning_rate=3e-3)
    >>> model.learn(1_600_000, progress_bar=True)
    >>> model.save("policy")

    Parameters
    ----------
    policy
        ``"MlpPolicy"``, or ``"MultiInputPolicy"`` for a dict, whose parts are flattened in the order of its space.
    env
        A `DroneVectorEnv`, a Gymnasium vector env, env or id, or a ``VecEnv``.
    use_sde, sde_sample_freq, rollout_buffer_class, rollout_buffer_kwargs
        Arguments of Stable-Baselines3; only their defaults are accepted.
    stats_window_size
        Number of the latest episodes whose means are logged.
    tensorboard_log
        Folder for TensorBoard, with the tags of Stable-Baselines3. None: none.
    policy_kwargs
        ``net_arch``: sizes of the hidden layers, a list for both networks or a dict with ``pi`` and ``vf``. Default:
        [64, 64]. ``activation_fn``: ``"tanh"`` (default), ``"relu"``, or these classes of PyTorch. ``log_std_init``:
        logarithm of the actions' standard deviations at the start, 0. ``features_extractor_class``: `GoalFeatures`,
        `BlobFeatures` or `PointFeatures` of `flockstep.sb3`, or their names, which do not need PyTorch. Other arguments
        of Stable-Baselines3's policies are accepted with their defaults.
    verbose
        1: print a table after every update.
    seed
        Of weights, actions, minibatches and the environments. None: drawn. A ``VecEnv`` gets it here, so that its own
        ``seed``, called afterwards, replaces it.
    device
        ``"cpu"`` or ``"auto"``.
    num_threads
        Threads of the learner. 0: those of the batch, or one per physical core.

    Raises
    ------
    ValueError, TypeError
        A value is not allowed, or needs Stable-Baselines3; the message names it.
    """

    _missing: tuple[str, ...] = ()
    """Schedules that were functions when the model was saved, and were not given to load; they have their defaults."""

    def _set_up(
        self,
        policy: str,
        env: Any,
        use_sde: bool = False,
        sde_sample_freq: int = -1,
        rollout_buffer_class: Any = None,
        rollout_buffer_kwargs: Mapping[str, Any] | None = None,
        stats_window_size: int = 100,
        tensorboard_log: str | PathLike[str] | None = None,
        policy_kwargs: Mapping[str, Any] | None = None,
        verbose: int = 0,
        seed: int | None = None,
        device: Any = "auto",
        _init_setup_model: bool = True,
        *,
        num_threads: int = 0,
        critic_only: int = 0,
        **hyperparameters: Any,
    ) -> None:
        for name, value in hyperparameters.items():
            if name not in sb3_models.HYPERPARAMETERS:
                raise TypeError(_unexpected_keyword("PPO.__init__", name, [*inspect.signature(PPO).parameters]))
            setattr(self, name, value)
        del sde_sample_freq  # of use_sde
        if use_sde:
            raise ValueError(
                "use_sde: expected False, got True: for state-dependent exploration, use Stable-Baselines3"
            )
        if getattr(rollout_buffer_class, "__name__", "") not in ("", "RolloutBuffer", "DictRolloutBuffer"):
            raise ValueError(
                f"rollout_buffer_class: expected None, got {rollout_buffer_class!r}: for others, use Stable-Baselines3"
            )
        if rollout_buffer_kwargs:
            raise ValueError(f"rollout_buffer_kwargs: expected none, got {rollout_buffer_kwargs!r}")
        if not _init_setup_model:
            raise ValueError("_init_setup_model: expected True, got False: the networks are always made")
        _require_cpu(device)
        if env is None:
            raise TypeError("env: expected an environment, got None; load() makes a model without one")
        self.source: Source | None = source_of(env)
        self.env = self.source.single if isinstance(self.source, SingleEnvSource) else env
        self.observation_space, self.action_space = self.source.observation_space, self.source.action_space
        self.stats_window_size, self.tensorboard_log, self.verbose = stats_window_size, tensorboard_log, verbose
        self.seed, self.critic_only = seed, critic_only
        self._make_learner(policy, policy_kwargs, num_threads)
        self._warn_of_batch_size(stacklevel=4)
        self._seed_env()

    def _make_learner(self, policy: str, policy_kwargs: Mapping[str, Any] | None, num_threads: int) -> None:
        """Make the networks; the environment or its spaces, and the hyperparameters, are set."""
        self._check()
        self.policy_kwargs = dict(policy_kwargs or {})
        config, log_std = network_config(
            policy, self.observation_space, self.action_space, self.policy_kwargs, self.critic_only
        )
        self.learner = Learner(config, num_threads or _threads_of(self.source), _drawn_seed(self.seed))
        if not config.is_discrete and log_std != 0.0:
            parameters = self.learner.parameters
            parameters[: config.action_size] = log_std
            self.learner.parameters = parameters
        self._set_normalization(self.n_envs)
        self._begin_counts()

    def _warn_of_batch_size(self, stacklevel: int = 3) -> None:
        steps = self.n_steps * self.n_envs
        if self.batch_size > steps:
            warnings.warn(
                f"batch_size: expected at most the {steps} steps of a rollout ({self.n_steps} n_steps x {self.n_envs} "
                f"envs), got {self.batch_size}: each epoch is a single minibatch of {steps}",
                UserWarning,
                stacklevel=stacklevel,
            )

    def _seed_env(self) -> None:
        """Seed the environment: a ``VecEnv`` now, others when the next `learn` begins."""
        self._start = "seed"
        if self.source is not None and self.seed is not None:
            self.source.seed(int(self.seed))

    def _set_normalization(self, rows: int) -> None:
        """Let the learner act on normalised observations if the model normalises them, before its first rollout."""
        self.learner.begin(RolloutConfig(n_steps=1, normalize_observations=self.normalize_observations), rows)

    @classmethod
    def _blank(cls: type[_Self], hyperparameters: Mapping[str, Any]) -> _Self:
        """Return a model without an environment and networks; other hyperparameters have their defaults."""
        model = cls.__new__(cls)
        for name, value in {**_DEFAULTS, **hyperparameters}.items():
            setattr(model, name, value)
        model.source, model.env = None, None
        return model

    def _begin_counts(self) -> None:
        self.num_timesteps = self._total_timesteps = self._n_updates = 0
        self._current_progress_remaining = 1.0
        self._begin_statistics()
        # How the next learn() begins: "seed" the environments, "reset" them, or "go on".
        self._start = "seed"
        self._log: Any = None
        self._vec_env: Any = None

    def _begin_statistics(self) -> None:
        self.ep_info_buffer: deque[dict[str, float]] = deque(maxlen=self.stats_window_size)
        self.ep_success_buffer: deque[float] = deque(maxlen=self.stats_window_size)

    @property
    def n_envs(self) -> int:
        """Number of rows of the environment."""
        return 1 if self.source is None else self.source.rows

    @property
    def logger(self) -> Any:
        """The log of the current training, with ``record(key, value)`` and ``dump(step)``."""
        if self._log is None:
            self._log = Log(self.verbose, None, type(self).__name__)
        return self._log

    def set_logger(self, logger: Any) -> None:
        """Use another logger, such as one of Stable-Baselines3."""
        self._log = logger
        self._has_given_log = True

    _has_given_log = False

    def get_env(self) -> Any:
        """Return the environment as given, or a ``VecEnv`` of Stable-Baselines3 around a Gymnasium env or id."""
        if self._vec_env is None and isinstance(self.source, SingleEnvSource):
            self._vec_env = self.source.as_vec_env()
        return self.env if self._vec_env is None else self._vec_env

    def get_vec_normalize_env(self) -> Any:
        """Return the ``VecNormalize`` around the environment, or None."""
        env = self.env
        while env is not None and type(env).__name__ != "VecNormalize":
            env = getattr(env, "venv", None)
        return env

    def set_env(self, env: Any, force_reset: bool = True) -> None:
        """Train in another environment, with equal spaces and its own seeds, from the next `learn` on.

        Parameters
        ----------
        env
            As for the constructor.
        force_reset
            Begin new episodes. False: go on with the current ones, such as those of a snapshot of a `DroneVectorEnv`,
            if `learn` is called with ``reset_num_timesteps=False``.

        Raises
        ------
        ValueError
            The spaces differ, or the environment cannot go on.
        """
        source = source_of(env)
        for name in ("observation_space", "action_space"):
            if getattr(source, name) != getattr(self, name):
                raise ValueError(f"env: expected the {name} {getattr(self, name)}, got {getattr(source, name)}")
        self._check(source)
        if not force_reset:
            source.resume()
        self.source, self._vec_env = source, None
        self.env = source.single if isinstance(source, SingleEnvSource) else env
        self._start = "reset" if force_reset else "go on"
        self._warn_of_batch_size()

    # --- learning

    def learn(
        self: _Self,
        total_timesteps: int,
        callback: Any = None,
        log_interval: int | None = 1,
        tb_log_name: str = "PPO",
        reset_num_timesteps: bool = True,
        progress_bar: bool = False,
    ) -> _Self:
        """Train for a number of steps, rounded up to whole rollouts.

        Ctrl-C leaves a whole model, as of the last minibatch; the next `learn` begins new episodes.

        Parameters
        ----------
        total_timesteps
            Steps of all rows together.
        callback
            Callbacks of Stable-Baselines3, a function of ``(locals, globals)`` that returns False to stop, or a list.
        log_interval
            Rollouts between two logs; None: no logs.
        tb_log_name
            Name of the run in TensorBoard.
        reset_num_timesteps
            Count from 0, and begin new episodes. False: go on.
        progress_bar
            Show a progress bar; needs tqdm.

        Raises
        ------
        ValueError
            A hyperparameter is out of range.
        FloatingPointError
            A reward, an observation or a loss is not finite; the message names the step. The parameters are those
            before it.
        """
        if self.source is None:
            raise ValueError("learn: expected an environment: call set_env first")
        self._require_schedules()
        if float(total_timesteps) != int(total_timesteps):
            raise ValueError(f"total_timesteps: expected an integer, got {total_timesteps!r}")
        self._check()
        if reset_num_timesteps:
            self.num_timesteps = 0
            self._begin_statistics()
        self._total_timesteps = int(total_timesteps) + self.num_timesteps
        if not self._has_given_log:
            if self._log is not None:
                self._log.close()
            self._log = Log(self.verbose, self.tensorboard_log, tb_log_name, is_new=reset_num_timesteps)
        if reset_num_timesteps or self._start != "go on":
            self.source.reset(int(self.seed) if self._start == "seed" and self.seed is not None else None)
            if self.learner.rows == self.source.rows:
                self.learner.discounted_returns = np.zeros(self.source.rows)
        self._start = "reset"  # if this training ends early
        callbacks = Callbacks(callback, self)
        bar = loop.progress_bar(int(total_timesteps)) if progress_bar else None
        begun, begun_at, iteration = time.perf_counter(), self.num_timesteps, 0
        callbacks.start({**locals(), "total_timesteps": self._total_timesteps}, globals())
        try:
            while self.num_timesteps < self._total_timesteps:
                if not self._collect(callbacks, bar):
                    break
                iteration += 1
                self._current_progress_remaining = max(0.0, 1.0 - self.num_timesteps / self._total_timesteps)
                if log_interval is not None and iteration % log_interval == 0:
                    loop.log_progress(self, iteration, time.perf_counter() - begun, self.num_timesteps - begun_at)
                self._train()
        finally:
            if bar is not None:
                bar.close()
        self._start = "go on"  # unless a callback sets another environment
        callbacks.end()
        return self

    _collect, _train = loop.collect, loop.train  # parts of learn

    def _config(self, kind: type[_Config], remaining: float | None = None) -> _Config:
        """Return the hyperparameters of a configuration; ``remaining`` sets the values of functions."""
        values: dict[str, Any] = {name: getattr(self, name) for name in kind.__match_args__}
        for name in values if remaining is not None else ():
            values[name] = float(values[name](remaining)) if callable(values[name]) else values[name]
        return kind(**values)

    def _check(self, source: Source | None = None) -> None:
        """Raise ValueError or TypeError that names a hyperparameter, or a part of a new source, that is not allowed."""
        self._config(RolloutConfig)
        self._config(UpdateConfig, 1.0)
        if self.clip_range_vf is not None and not callable(self.clip_range_vf) and self.clip_range_vf <= 0:
            raise ValueError(f"clip_range_vf: expected a number > 0, or None, got {self.clip_range_vf!r}")
        _require_seed(self.seed)
        if not (isinstance(self.stats_window_size, (int, np.integer)) and self.stats_window_size >= 1):
            raise ValueError(f"stats_window_size: expected an integer >= 1, got {self.stats_window_size!r}")

    # --- acting

    def predict(
        self,
        observation: Any,
        state: tuple[Array, ...] | None = None,
        episode_start: Array | None = None,
        deterministic: bool = False,
    ) -> tuple[Array, tuple[Array, ...] | None]:
        """Return the actions for one observation or for several, and ``state`` as given.

        Parameters
        ----------
        observation
            As of the observation space, or rows of it. The numbers that only the critic gets may be missing.
        state, episode_start
            For compatibility; the policy has no memory.
        deterministic
            The most probable action, not a random one.
        """
        del episode_start
        rows, is_single = self._rows(observation)
        drawn = self.learner.predict(rows) if deterministic else self.learner.sample(rows)
        space = self.action_space
        if isinstance(space, spaces.Discrete):
            actions = drawn.astype(np.int64) + int(space.start)
        else:
            assert isinstance(space, spaces.Box)
            actions = np.clip(drawn.reshape(len(rows), *space.shape), space.low, space.high).astype(space.dtype)
        return (actions[0] if is_single else actions), state

    def _rows(self, observation: Any) -> tuple[npt.NDArray[np.float32], bool]:
        """Return observations as rows of numbers, and True if there is a single one without a dimension of rows."""
        return rows_to_act_on(self.observation_space, self.critic_only, observation)

    # --- files and conversions

    def save(self, path: str | PathLike[str]) -> None:
        """Write the model to a file: JSON and arrays in a zip archive. It is replaced as a whole."""
        files.save(path, self)

    @classmethod
    def load(
        cls: type[_Self],
        path: str | PathLike[str],
        env: Any = None,
        device: Any = "auto",
        custom_objects: Mapping[str, Any] | None = None,
        print_system_info: bool = False,
        force_reset: bool = True,
        **changes: Any,
    ) -> _Self:
        """Read a model from a file that `save` wrote. No code in it is run.

        Parameters
        ----------
        path
            The file; ``.zip`` may be omitted.
        env
            The environment to go on training in, or None.
        device, custom_objects, print_system_info
            Arguments of Stable-Baselines3; only their defaults are accepted.
        force_reset
            As for `set_env`.
        **changes
            Hyperparameters to change. A schedule that was a function has to be given again, if the model is to learn.

        Raises
        ------
        ValueError
            The file is of another kind or damaged, or an env is given and a schedule is missing.
        """
        _require_cpu(device)
        if custom_objects or print_system_info:
            raise ValueError(
                "load: expected no custom_objects and no print_system_info: give hyperparameters as keywords, such as "
                "learning_rate=1e-3"
            )
        known = [*files.NUMBERS, *sb3_models.SCHEDULES, "tensorboard_log", "verbose", "num_threads"]
        for name in changes:
            if name not in known:
                raise TypeError(
                    f"load: expected hyperparameters such as learning_rate, got {name!r}{did_you_mean(name, known)}"
                )
        num_threads = int(changes.pop("num_threads", 0))
        source = None if env is None else source_of(env)
        seeds = {}
        if "seed" in changes:  # also of actions and minibatches
            _require_seed(changes["seed"])
            seeds = {"learner_seed": _drawn_seed(changes["seed"]), "draws": 0}
        model = files.load(path, cls, num_threads or _threads_of(source), seeds)
        model._missing = tuple(name for name in model._missing if name not in changes)
        if env is not None:
            model._require_schedules()
        for name, value in changes.items():
            setattr(model, name, value)
        model._check()
        if "normalize_observations" in changes:
            model._set_normalization(model.learner.rows)
        if env is not None:
            model.set_env(env, force_reset)
            if force_reset:
                model._seed_env()
        return model

    def _require_schedules(self) -> None:
        if self._missing:
            raise ValueError(f"{self._missing[0]}: it was a function, which files do not hold: give it to load()")

    def to_sb3(self) -> Any:
        """Return a ``PPO`` of Stable-Baselines3 with the same network and hyperparameters. It acts the same to 1e-6.

        A model with ``critic_only`` raises ValueError.
        """
        return sb3_models.to_sb3(self)

    @classmethod
    def from_sb3(cls: type[_Self], model: Any, env: Any = None) -> _Self:
        """Return a model with the network and hyperparameters of a ``PPO`` of Stable-Baselines3.

        Raises
        ------
        ValueError
            The model has a part that the learner lacks; the message names it.
        """
        made: _Self = sb3_models.from_sb3(cls, model, env)
        return made


def _require_seed(seed: Any) -> None:
    if seed is not None and not (isinstance(seed, (int, np.integer)) and 0 <= seed < 1 << 63):
        raise ValueError(f"seed: expected an integer in [0, 2**63) or None, got {seed!r}")


def _drawn_seed(seed: int | None) -> int:
    """Return the seed of the learner."""
    return secrets.randbits(62) if seed is None else int(seed)


def _require_cpu(device: Any) -> None:
    if str(device) not in ("auto", "cpu"):
        raise ValueError(f"device: expected 'cpu' or 'auto', got {device!r}: the learner runs on the processor")


def _threads_of(source: Source | None) -> int:
    """Return the number of threads of a source's batch, or 0."""
    batch = getattr(getattr(source, "env", None), "batch", None)
    return int(getattr(batch, "num_threads", 0))


_DEFAULTS = {
    name: parameter.default
    for name, parameter in inspect.signature(PPO.__init__).parameters.items()
    if name in (*files.NUMBERS, *sb3_models.SCHEDULES, "critic_only", "tensorboard_log", "verbose")
}

add_parameters(PPO, Arguments, before="Raises")
