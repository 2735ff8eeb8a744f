"""Record a flight."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from flockstep._core import NativeTask
from flockstep.errors import refuse_masked
from flockstep.progress_line import ProgressLine
from flockstep.recordings import Recording
from flockstep.recordings.recording import require_saveable
from flockstep.registration import make_same_step
from flockstep.stepping import BoolArray
from flockstep.task import Task
from flockstep.vector_env import DroneVectorEnv

_FILMS = (".mp4", ".gif")

#: A policy: from observations (N, ...), and a mask (N,) of those that begin an episode, to actions (N, ...).
Act: TypeAlias = Callable[[Any, BoolArray], Any]


def record(
    path: str | PathLike[str],
    policy: Any = None,
    env: str | Task | type[Task] | NativeTask = "flockstep/LidarNavigation-v0",
    *,
    steps: int = 400,
    seed: int = 0,
    until_success: int | None = None,
    render_view: str | npt.ArrayLike = "fleet",
    fps: float | None = None,
    paths: Sequence[npt.ArrayLike] = (),
    quiet: bool = False,
    watch: bool = False,
    **kwargs: Any,
) -> int:
    """Fly one env and record one episode: the first one, or the first that succeeds.

    The env has one drone, unless the task's default is another or you pass ``drones_per_env``. With several drones, the
    film follows the first one, and it ends when all of their episodes have ended. A policy that learned with other
    drones needs the same keywords about drones here as in its training.

    Films need imageio with ffmpeg, which the extra ``film`` installs, and ``.mcap`` the extra ``mcap``.

    Parameters
    ----------
    path
        The file. ``.html``: a page that replays the flight in a browser, from any side. ``.mp4`` or ``.gif``: a film.
        ``.mcap``: a file for `Recording`.
    policy
        A model of `flockstep.PPO`, Stable-Baselines3 or sb3-contrib, flown deterministically, or a function from
        observations to actions, which have a row for each drone. Recurrent models keep their state from step to step.
        None: random actions. To load a model from a file, call its class:
        ``PPO.load("policy.zip")``. With Stable-Baselines3 that runs code from the file, which holds pickled objects:
        load only policies you trust.
    env
        A Gymnasium id, a `Task` (an object, or its class) or a `NativeTask`.
    steps
        Maximum number of steps.
    seed
        Seed of the episode and of random actions.
    until_success
        Maximum number of episodes to try, seeded ``seed``, ``seed + 1`` and so on. The first that succeeds, for all
        drones, within ``steps`` is filmed: episodes are flown without pictures, then the successful actions are
        replayed. None: film the first episode, whether it succeeds or not.
    render_view
        As in `DroneVectorEnv`; ``render_size``, ``render_camera``, ``render_style``, such as ``"dark"``,
        ``render_samples``, ``render_beams`` and ``drone_mesh`` are also accepted.
    fps
        Pictures per second. The film has one picture before the first step and one after each step. None: the speed of
        flight, ``policy_hz / frame_skip``, rounded, at least 1. Browsers show at most 50 pictures per second of a GIF.
    paths
        Planned paths, as in `Recording.writer`. Films have none.
    quiet
        True: show no progress. Otherwise standard error shows the number of pictures so far: one line, kept up to date
        on a terminal, printed every ten seconds to a file.
    watch
        Show the flight in a browser, too, at the speed of flight, from when the page of `flockstep.view` is open.
    **kwargs
        Further keywords of `DroneVectorEnv`, such as ``worlds`` and ``through``.

    Returns
    -------
    int
        Number of pictures in the film, or of moments.

    Raises
    ------
    RuntimeError
        None of the ``until_success`` episodes succeeds; then no film is written. Or the replay of the successful
        episode ends differently, because its task draws random numbers from a source other than ``batch.random``.
    """
    is_film = Path(path).suffix.lower() in _FILMS
    if steps < 1:
        raise ValueError(f"steps: expected an integer >= 1, got {steps}")
    is_count = isinstance(until_success, (int, np.integer)) and not isinstance(until_success, bool)
    if until_success is not None and not (is_count and until_success >= 1):
        raise ValueError(f"until_success: expected None or an integer >= 1, got {until_success!r}")
    if is_film and len(paths):
        raise ValueError(f"paths: expected none for {Path(path).suffix}, got {len(paths)}")
    if is_film:
        _imageio()  # refused before the first step
        kwargs |= {"render_mode": "rgb_array", "render_view": render_view}
    else:
        require_saveable(path, _FILMS)
    envs = make_same_step("record", env, 1, ends_stay=True, watch=watch, **kwargs)
    act = actions_of(policy, envs, "record", seed)
    progress = None if quiet else ProgressLine()
    if until_success is not None:
        seed, actions = _succeeding(envs, act, steps, range(seed, seed + until_success), progress)
        act = _replaying(actions)
    observation, starts = envs.reset(seed=seed)[0], np.ones(envs.num_envs, bool)
    fps = envs.metadata["render_fps"] if fps is None else fps
    moments, what = 0, "images" if is_film else "moments"
    with _Film(path, envs, fps) if is_film else Recording.writer(path, envs, paths=paths) as sink:
        for step in range(steps + 1):
            chosen = None
            if step > 0:
                chosen = act(observation, starts)
                observation, _, terminated, truncated, _ = envs.step(chosen)
                starts = np.zeros_like(starts)
            sink.add(chosen)
            moments += 1
            if progress is not None and progress.is_due:
                progress.show(f"{fspath(path)}: {moments} of at most {steps + 1} {what}, {progress.seconds:.0f} s")
            if step > 0 and (terminated | truncated).all():
                break
    if until_success is not None and not envs.batch.success.all():
        raise RuntimeError(
            f"until_success: the episode of seed {seed} succeeded, but its replay did not: its task must draw all "
            "random numbers from batch.random"
        )
    envs.close()
    if progress is not None:
        progress.show(f"{fspath(path)}: {moments} {what}, {progress.seconds:.0f} s", is_last=True)
    return moments


class _Film:
    """Writes the pictures of the first env to a file, completely or not at all."""

    def __init__(self, path: str | PathLike[str], envs: DroneVectorEnv, fps: float) -> None:
        # By default imageio makes both sides multiples of 16; the codec needs only even ones.
        is_gif = Path(path).suffix.lower() == ".gif"
        settings: dict[str, Any]
        settings = {"duration": 1000 / fps, "loop": 0} if is_gif else {"fps": fps, "quality": 8, "macro_block_size": 2}
        self._envs = envs
        self._path, self._part = Path(path), Path(path).with_suffix(f".part{Path(path).suffix}")
        self._film: Any = _imageio().get_writer(self._part, **settings)  # its own type for writers has no append_data

    def add(self, actions: Any) -> None:
        frames = self._envs.render()
        assert frames is not None
        self._film.append_data(frames[0])

    def __enter__(self) -> _Film:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self._film.close()
            if kind is None:
                self._part.replace(self._path)
        finally:
            self._part.unlink(missing_ok=True)


def _imageio() -> Any:
    try:
        import imageio.v2 as imageio
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "record needs imageio, which is not installed: pip install 'imageio[ffmpeg]' pillow", name="imageio"
        ) from error
    return imageio


def _succeeding(
    envs: DroneVectorEnv, act: Act, steps: int, seeds: range, progress: ProgressLine | None
) -> tuple[int, list[Any]]:
    """Return the first seed whose episode succeeds within ``steps`` steps, and its actions.

    Raises
    ------
    RuntimeError
        No episode succeeds.
    """
    for tried, seed in enumerate(seeds):
        if progress is not None and progress.is_due:
            progress.show(f"{tried} of at most {len(seeds)} episodes without a success, {progress.seconds:.0f} s")
        observation, starts = envs.reset(seed=seed)[0], np.ones(envs.num_envs, bool)
        actions = []
        for _ in range(steps):
            chosen = act(observation, starts)
            refuse_masked("actions", chosen)
            actions.append(np.array(chosen))
            observation, _, terminated, truncated, _ = envs.step(actions[-1])
            starts = np.zeros_like(starts)
            if (terminated | truncated).all():
                break
        if envs.batch.success.all():
            return seed, actions
    which = f"the episodes of the seeds {seeds.start} to {seeds.stop - 1}"
    raise RuntimeError(f"until_success: none of {which} succeeded within {steps} steps")


def _replaying(actions: list[Any]) -> Act:
    following = iter(actions)
    return lambda observation, starts: next(following)


def actions_of(policy: Any, envs: DroneVectorEnv, caller: str, seed: int) -> Act:
    """Return a policy (a model, a function or None for random actions) as a function to actions.

    It takes the observations and a mask (N,) of the rows in which they are the first of an episode: a model with memory
    forgets there.

    Raises
    ------
    ValueError
        The model was trained with observations or actions that differ from those of the envs.
    TypeError
        The policy is neither, or its ``predict`` has other arguments than the models of Stable-Baselines3.
    """
    if policy is None:
        action_space = envs.action_space
        action_space.seed(seed)
        return lambda observation, starts: action_space.sample()
    if hasattr(policy, "predict"):
        _require_spaces_of(policy, envs, caller)
        return _predicting(policy, caller)
    if not callable(policy):
        hint = ""
        if isinstance(policy, (str, PathLike)):
            hint = ": load it first, as by PPO.load(path); that runs code from the file: load only policies you trust"
        raise TypeError(f"policy: expected a model with predict, a function or None, got {policy!r}{hint}")
    return lambda observation, starts: policy(observation)


def _predicting(model: Any, caller: str) -> Act:
    """Return a model's deterministic actions; from step to step it gets back the state that it returned."""
    name = f"{type(model).__name__}.predict"
    accepted = _accepted_by(model.predict, f"{caller}: {name}")
    state: Any = None

    def act(observation: Any, starts: BoolArray) -> Any:
        nonlocal state
        keywords = {"state": state, "episode_start": starts, "deterministic": True}
        predicted = model.predict(observation, **{keyword: keywords[keyword] for keyword in accepted})
        if not isinstance(predicted, tuple) or len(predicted) != 2:
            raise TypeError(f"{caller}: {name}: expected a pair (actions, state), got {type(predicted).__name__}")
        actions, state = predicted
        if state is not None and "state" not in accepted:
            raise TypeError(f"{caller}: {name} returns a state but does not take it back: give it an argument state")
        return actions

    return act


def _accepted_by(predict: Any, name: str) -> list[str]:
    """Return the keywords of Stable-Baselines3's ``predict`` that a model accepts, besides the observation."""
    known = ["state", "episode_start", "deterministic"]
    try:
        parameters = inspect.signature(predict).parameters.values()
    except (TypeError, ValueError):  # of some functions in C
        return known
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return known
    needed = [p.name for p in parameters if p.default is p.empty and p.kind is not p.VAR_POSITIONAL]
    others = [argument for argument in needed[1:] if argument not in known]
    if others:
        raise TypeError(
            f"{name} also needs {' and '.join(others)}: expected only {', '.join(['observation', *known])}; "
            "give a function from observations to actions instead"
        )
    return [keyword for keyword in known if keyword in (parameter.name for parameter in parameters)]


def _require_spaces_of(model: Any, envs: DroneVectorEnv, caller: str) -> None:
    """Raise ValueError if a Stable-Baselines3 model was trained with other spaces; other models have no spaces."""
    for what in ("observation", "action"):
        trained, flown = getattr(model, f"{what}_space", None), getattr(envs, f"single_{what}_space")
        if isinstance(trained, spaces.Space) and not _is_alike(trained, flown):
            is_own = isinstance(envs.task, Task) or envs.spec is None
            name = type(envs.task).__name__ if is_own else envs.spec.id
            raise ValueError(
                f"{caller}: the model was trained with {what}s {_shown(trained)}, {name} has {_shown(flown)}: "
                f"give {caller} the task that it was trained with, and the keywords of its env"
            )


def _shown(space: spaces.Space[Any]) -> str:
    """Return a short description of a space: the shapes of its boxes."""
    if isinstance(space, spaces.Dict):
        return f"Dict({', '.join(f'{name}: {_shown(part)}' for name, part in space.items())})"
    return f"Box{space.shape}" if isinstance(space, spaces.Box) else str(space)


def _is_alike(trained: spaces.Space[Any], flown: spaces.Space[Any]) -> bool:
    """Return whether two spaces have the same shapes; bounds may differ, and channels may come first."""
    if isinstance(trained, spaces.Dict) and isinstance(flown, spaces.Dict):
        return trained.keys() == flown.keys() and all(_is_alike(trained[name], flown[name]) for name in flown)
    if isinstance(trained, spaces.Box) and isinstance(flown, spaces.Box):
        return trained.shape == flown.shape or (
            len(flown.shape) == 3 and trained.shape == (flown.shape[2], *flown.shape[:2])
        )
    return bool(trained == flown)
