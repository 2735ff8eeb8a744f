"""Drones that differ: lists of `Variation`, presets with their sources, and a description."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from flockstep._core import Batch, ControllerConfig, Variation, parameter_names
from flockstep.errors import did_you_mean

#: A law: a number (a constant), a pair of bounds (uniform), or a `Variation` of any parameter.
Law = float | tuple[float, float] | Variation
#: Laws by the fraction of a training that is done, for `Curriculum`.
Schedule = Callable[[float], list[Variation]]


def log_uniform(low: float, high: float, **options: Any) -> Variation:
    """Return the law of a number whose logarithm is uniform, for `vary`. Options are fields of `Variation`."""
    return Variation(law="log_uniform", low=low, high=high, **options)


def uniform(low: float, high: float, **options: Any) -> Variation:
    """Return the law of a uniform number, for `vary`. Options: fields of `Variation`, such as ``when="interval"``."""
    return Variation(low=low, high=high, **options)


def normal(mean: float, std: float, low: float | None = None, high: float | None = None, **options: Any) -> Variation:
    """Return a normal law clipped to [low, high], by default three standard deviations, for `vary`."""
    low, high = mean - 3 * std if low is None else low, mean + 3 * std if high is None else high
    return Variation(law="normal", mean=mean, std=std, low=low, high=high, **options)


def choice(values: Iterable[float], **options: Any) -> Variation:
    """Return the law of a number that is one of some values, equally likely, for `vary`."""
    return Variation(law="choice", choices=list(values), **options)


def vary(*presets: Iterable[Variation], **laws: Law) -> list[Variation]:
    """Return a list of variations, for the keyword ``variations`` of an environment or a `Batch`.

    Parameters
    ----------
    presets
        Lists to begin with, such as ``flockstep.variations.presets["diffaero"]``. Of two laws for one parameter the
        later one counts.
    laws
        A law for each parameter, by its name in `DroneParameters`: a pair of bounds is uniform, a number constant, and
        ``uniform``, ``log_uniform``, ``normal`` and ``choice`` of ``flockstep.variations`` make other laws.

    Returns
    -------
    variations
        One `Variation` for each parameter.

    Examples
    --------
    >>> import flockstep
    >>> laws = flockstep.vary(mass_scale=(0.8, 1.2), action_delay_s=0.02)
    >>> [(law.parameter, law.low, law.high) for law in laws]  # doctest: +SKIP
    [('mass_scale', 0.8, 1.2), ('action_delay_s', 0.02, 0.02)]

    """
    made = {law.parameter: law for preset in presets for law in preset}
    for parameter, law in laws.items():
        if not isinstance(law, Variation):
            low, high = law if isinstance(law, tuple) else (law, law)
            law = Variation(low=low, high=high)
        made[parameter] = _changed(law, parameter=parameter)
    return list(made.values())


def _changed(law: Variation, **changes: Any) -> Variation:
    """Return a copy with other values of some fields."""
    return Variation(**{**{name: getattr(law, name) for name in Variation.__match_args__}, **changes})


class _Named(dict[str, Any]):
    """Values by name; for an unknown name the error lists all."""

    def __init__(self, field: str, values: dict[str, Any]) -> None:
        super().__init__(values)
        self._field = field

    def __missing__(self, name: object) -> Any:
        raise ValueError(f"{self._field}: expected one of {', '.join(self)}, got {name!r}{did_you_mean(name, self)}")


def _presets() -> dict[str, list[Variation]]:
    def around(share: float, **options: Any) -> Variation:
        return uniform(1 - share, 1 + share, **options)

    return {
        # J. Eschmann et al., "Learning to fly in seconds", IEEE RA-L 2024: a force of a twentieth of the weight. The
        # frames of its successor RAPTOR are the drones "random/seed-N".
        "l2f": vary(push_mps2=normal(0.0, 9.81 / 20)),
        # OmniDrones, IEEE RA-L 2024, its Hummingbird. Thrust grows with mass here, so that each drone can fly.
        "omnidrones": vary(
            mass_scale=uniform(0.26, 1.74, group="size"),
            thrust_scale=uniform(0.26, 1.74, group="size"),
            torque_scale=(0.63, 2.5),
            center_m=(-0.05, 0.05),
        ),
        # DiffAero, arXiv:2509.10247: mass and inertia 20 %, torque 25 %, drag 17 %.
        "diffaero": vary(mass_scale=around(0.2), torque_scale=around(0.25), body_drag_scale=around(0.17)),
        # Aerial Gym Simulator, IEEE RA-L 2025: gains 20 %, pushes that change.
        "aerial_gym": vary(
            rate_gain_scale=around(0.2),
            attitude_gain_scale=around(0.2),
            velocity_gain_scale=around(0.2),
            position_gain_scale=around(0.2),
            push_mps2=uniform(-0.75, 0.75, when="interval", interval_s=1.0),
        ),
        # A Crazyflie's lag, of which drones/crazyflie.json has the longest: 69 ms (rl-tools) to 145 ms (Crazyflow).
        "crazyflie": vary(
            lag_up_scale=uniform(0.069 / 0.145, 1.0, group="lag"),
            lag_down_scale=uniform(0.069 / 0.145, 1.0, group="lag"),
        ),
        # Ours: what a drone of which one has the data sheet may be off by.
        "sim2real": vary(
            mass_scale=around(0.1),
            stretch=around(0.1),
            thrust_scale=around(0.1),
            rotor_thrust_scale=around(0.03),
            torque_scale=around(0.25),
            lag_up_scale=around(0.3, group="lag"),
            lag_down_scale=around(0.3, group="lag"),
            body_drag_scale=(0.5, 1.5),
            rotor_drag_scale=(0.5, 1.5),
            rate_gain_scale=around(0.3),
            attitude_gain_scale=around(0.2),
            battery_used=(0.0, 0.8),
            battery_fall=(0.0, 0.1),
            push_mps2=normal(0.0, 0.2),
            action_delay_s=(0.0, 0.02),
            action_jitter_s=0.005,
        ),
    }


#: Lists of variations by name: "l2f", "omnidrones", "diffaero", "aerial_gym", "crazyflie" and "sim2real". The code
#: names their sources.
presets: Mapping[str, Sequence[Variation]] = _Named("presets", _presets())

#: Controllers by name. "gentle": gains by the rotors' lag. "px4": the defaults of PX4 1.15 (MC_ROLL_P 6.5, MC_YAW_P
#: 2.8, MPC_XY_P 0.95, MPC_XY_VEL_P_ACC 1.8, MPC_XY_VEL_I_ACC 0.4; rates: 0.15 and 0.2 times what a unit of torque does
#: to its X500). "betaflight": fitted to the response of Betaflight 4.6 with its default gains, which
#: flies a racer5 (bench/peers/firmware.py).
controllers: Mapping[str, ControllerConfig] = _Named(
    "controllers",
    {
        "gentle": ControllerConfig(),
        "px4": ControllerConfig(
            rate_gain_per_s=45.0,
            yaw_rate_gain_per_s=4.2,
            attitude_gain_per_s=6.5,
            yaw_gain_per_s=2.8,
            velocity_gain_per_s=1.8,
            velocity_integral_per_s2=0.4,
            position_gain_per_s=0.95,
            lead=1.0,
        ),
        "betaflight": ControllerConfig(rate_gain_per_s=58.0, yaw_rate_gain_per_s=20.0, lead=2.6, command_lag_s=0.001),
    },
)


def ramp(first: Sequence[Variation], last: Sequence[Variation], until: float = 0.5) -> Schedule:
    """Return a schedule for `Curriculum` whose laws go from those of ``first`` to those of ``last``.

    Parameters
    ----------
    first, last
        Lists of `vary` of the same parameters with the same kinds of laws. Bounds, means and standard deviations are
        interpolated linearly.
    until
        Fraction of the training, in (0, 1], after which the laws are those of ``last``.
    """
    if [(each.parameter, each.law) for each in first] != [(each.parameter, each.law) for each in last]:
        raise ValueError(
            "first, last: expected laws of the same kind for the same parameters in the same order, "
            f"got {[each.parameter for each in first]} and {[each.parameter for each in last]}"
        )
    if not 0.0 < until <= 1.0:
        raise ValueError(f"until: expected a number in (0, 1], got {until!r}")

    def laws(done: float) -> list[Variation]:
        share = min(done / until, 1.0)
        names = ("low", "high", "mean", "std")
        return [
            _changed(b, **{name: (1.0 - share) * getattr(a, name) + share * getattr(b, name) for name in names})
            for a, b in zip(first, last, strict=True)
        ]

    return laws


class Curriculum:
    """A callback of a training that changes how the drones differ, by `PPO` or by Stable-Baselines3.

    Parameters
    ----------
    env
        The environment that is trained in. Its ``variations`` list every parameter of the schedule from the start, and
        the longest delay.
    schedule
        A function of the fraction of the training that is done, from 0 to 1, which returns a list of `vary`. `ramp`
        makes one. It is called before each rollout, and its laws hold from the next draw on.

    Examples
    --------
    >>> import flockstep, gymnasium
    >>> from flockstep.variations import Curriculum, ramp
    >>> easy, hard = flockstep.vary(mass_scale=(1.0, 1.0)), flockstep.vary(mass_scale=(0.7, 1.3))
    >>> envs = gymnasium.make_vec("flockstep/Hover-v0", num_envs=64, variations=easy)
    >>> model = flockstep.PPO("MlpPolicy", envs, n_steps=16, batch_size=512)
    >>> model = model.learn(4096, Curriculum(envs, ramp(easy, hard)), log_interval=None)
    >>> envs.close()

    """

    need_infos = False  # so that a training in the engine stays there

    def __init__(self, env: Any, schedule: Schedule) -> None:
        if not callable(schedule):
            raise TypeError(f"schedule: expected a function of the fraction that is done, got {schedule!r}")
        self._batch, self._schedule = batch_of(env), schedule
        self._model: Any = None
        self._now: list[Variation] | None = None

    def init_callback(self, model: Any) -> None:
        """Get the model."""
        self._model = model

    def on_training_start(self, local: Any, global_: Any) -> None:
        """Do nothing."""

    def update_locals(self, local: Any) -> None:
        """Do nothing."""

    def on_rollout_start(self) -> None:
        """Set the laws of this rollout."""
        laws = self._schedule(min(self._model.num_timesteps / max(self._model._total_timesteps, 1), 1.0))
        if not isinstance(laws, list) or not all(isinstance(law, Variation) for law in laws):
            raise TypeError(f"schedule: expected a list of Variation, such as vary() returns, got {laws!r}")
        if laws != self._now:
            self._batch.set_variations(laws)
            self._now = laws

    def on_step(self) -> bool:
        """Go on."""
        return True

    def on_rollout_end(self) -> None:
        """Do nothing."""

    def on_training_end(self) -> None:
        """Do nothing."""

    def __call__(self, local: dict[str, Any], global_: dict[str, Any]) -> bool:
        """Set the laws in a step of Stable-Baselines3, which takes functions as callbacks."""
        self._model = local["self"]
        self.on_rollout_start()
        return True


def batch_of(env: Any) -> Batch:
    """Return the `Batch` of an environment."""
    found: Batch = env if isinstance(env, Batch) else getattr(env, "unwrapped", env).batch
    return found


def describe(env: Any) -> str:
    """Return what differs from drone to drone in an environment or a `Batch`, a line for each parameter.

    Parameters
    ----------
    env
        A `DroneVectorEnv`, an environment made by Gymnasium, or a `Batch`.

    Returns
    -------
    text
        Each varied parameter with its law, and the least and greatest value that the drones have now.
    """
    batch = batch_of(env)
    lines = [f"airframes: {len(batch.airframes)}, one for each episode"] if len(batch.airframes) > 1 else []
    for law in batch.variations:
        columns = [i for i, name in enumerate(parameter_names) if law.parameter in (name, name.partition("[")[0])]
        now = batch.params[:, columns]
        lines.append(f"{law.parameter}: {_law(law)}; now {now.min():.4g} to {now.max():.4g}")
    return "\n".join(lines) or "nothing differs"


def _law(law: Variation) -> str:
    if law.law == "choice":
        drawn = "one of " + ", ".join(f"{value:.4g}" for value in law.choices)
    elif law.low == law.high:
        return f"{law.low:.4g}, constant"
    elif law.law == "normal":
        drawn = f"normal, {law.mean:.4g} +- {law.std:.4g}, within [{law.low:.4g}, {law.high:.4g}]"
    else:
        drawn = f"{law.law.replace('_', '-')} in [{law.low:.4g}, {law.high:.4g}]"
    when = {"start": "once", "reset": "each episode", "interval": f"every {law.interval_s:.4g} s"}[law.when]
    return f"{drawn}, {when}" + (f", with group {law.group!r}" if law.group else "")
