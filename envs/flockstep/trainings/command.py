"""The commands ``python -m flockstep train``, ``evaluate`` and ``record``."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from flockstep import policies
from flockstep.errors import did_you_mean
from flockstep.learning import progress_of
from flockstep.progress_line import ProgressLine
from flockstep.recording import record
from flockstep.trainings.flying import Verdict, best_of, judge
from flockstep.trainings.learning import Callback, load, train
from flockstep.trainings.table import TRAININGS
from flockstep.trainings.training import UNSEEN_SEEDS, Training
from flockstep.viewer import view

_KNOWN = f"file of a policy, or a bundled one ({', '.join(policies.names())})"


def add_train(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``train``."""
    _add_training(parser, _train)
    _add_learner(parser)
    _add_flights(parser)
    parser.add_argument("--seed", type=int, default=0, help="seed of the training")
    threads = "threads of simulator and learner; 0: one per core. results are bit-identical for any number"
    parser.add_argument("--threads", type=int, default=0, help=threads)
    parser.add_argument("--steps", type=_count, help="steps of all drones together; default: the row's")
    shown = "show the training in a browser; a row of APG shows only the last step of each window"
    parser.add_argument("--view", action="store_true", help=shown)
    parser.add_argument("--out", type=Path, help="file of the policy; default: TRAINING.zip")


def add_evaluate(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``evaluate``."""
    _add_training(parser, _evaluate)
    flyer = f"{_KNOWN}, or the name of a flyer without a policy, such as straight"
    parser.add_argument("policy", metavar="POLICY", help=flyer)
    _add_learner(parser)
    _add_flights(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    _add_view(parser)


def add_record(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``record``."""
    _add_training(parser, _record)
    parser.add_argument("policy", metavar="POLICY", help=_KNOWN)
    _add_learner(parser)
    kinds = ".mp4, .gif, .html or .mcap; default: TRAINING.mp4"
    parser.add_argument("film", metavar="FILM", nargs="?", type=Path, help=kinds)
    parser.add_argument("--seed", type=int, default=UNSEEN_SEEDS.start, help="seed of the flight")
    _add_view(parser)


def _add_training(parser: argparse.ArgumentParser, run: Callable[[argparse.Namespace], None]) -> None:
    rows = f"one of {', '.join(TRAININGS)}, or module:NAME of a flockstep.trainings.Training of yours"
    parser.add_argument("name", metavar="TRAINING", help=rows)
    parser.set_defaults(run=run)


def _add_learner(parser: argparse.ArgumentParser) -> None:
    learner = "flockstep.PPO, or Stable-Baselines3's, whose files run code when they are loaded"
    parser.add_argument("--learner", choices=("flockstep", "sb3"), default="flockstep", help=learner)


def _add_view(parser: argparse.ArgumentParser) -> None:
    shown = "show the flights in a browser, at the speed of flight; they begin when its page is open"
    parser.add_argument("--view", action="store_true", help=shown)


def _add_flights(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--flights", type=_count, help="evaluation flights of each kind; default: the row's")


def training_of(name: str) -> Training:
    """Return a training of the table, or ``module:NAME``, for which the working directory is searched, too.

    Raises
    ------
    ValueError
        There is none; the message lists those of the table.
    """
    if name in TRAININGS:
        return TRAININGS[name]
    module, colon, attribute = name.partition(":")
    if colon:
        sys.path.append(os.getcwd())
        try:
            found = getattr(importlib.import_module(module), attribute, None)
        except ModuleNotFoundError as error:
            raise ValueError(f"TRAINING: {name!r}: {error}") from None
        if isinstance(found, Training):
            return found
        raise ValueError(f"TRAINING: expected a flockstep.trainings.Training, got {name!r}, which is {found!r}")
    hint = did_you_mean(name, TRAININGS)
    raise ValueError(f"TRAINING: expected one of {', '.join(TRAININGS)}, or module:NAME, got {name!r}{hint}")


class Progress(Callback):
    """Prints the steps, the time and the success rate of a training to standard error."""

    def on_training_start(self, local: Any, global_: Any) -> None:
        """Begin."""
        self._line = ProgressLine()

    def on_step(self) -> bool:
        """Print when it is time."""
        if self._line.is_due:
            self._line.show(progress_of(self.model, self._line.seconds))
        return True

    def on_training_end(self) -> None:
        """Print the last line."""
        self._line.show(progress_of(self.model, self._line.seconds), is_last=True)


class _View(Callback):
    """Shows a training in a browser, until its environments are closed."""

    need_infos = False

    def on_training_start(self, local: Any, global_: Any) -> None:
        """Begin."""
        view(self.model.get_env())


def _train(arguments: argparse.Namespace) -> None:
    training = _asked(arguments)
    out = arguments.out or Path(f"{arguments.name.rpartition(':')[2]}.zip")
    out.parent.mkdir(parents=True, exist_ok=True)
    before = time.perf_counter()
    callbacks = [Progress(), *([_View()] if arguments.view else [])]
    try:
        model = train(training, arguments.learner, arguments.seed, arguments.threads, callbacks)
    except KeyboardInterrupt:
        print(f"interrupted: nothing is saved to {out}", file=sys.stderr)
        raise
    seconds = time.perf_counter() - before
    model.save(out)
    print(f"{model.num_timesteps:,} steps in {seconds:.1f} s; {out}", flush=True)
    verdict = judge(training, load(out, arguments.learner), _flights(training, arguments), _UNSEEN, ProgressLine())
    print(_said(verdict, _flights(training, arguments)))


def _evaluate(arguments: argparse.Namespace) -> None:
    training = _asked(arguments)
    if arguments.policy in training.baselines:
        flyer = best_of(training, training.baselines[arguments.policy])
    elif arguments.policy in policies.names() or Path(arguments.policy).exists():
        flyer = _policy(arguments)
    else:
        flyers = ", ".join(training.baselines) or "none"
        raise ValueError(f"POLICY: expected a {_KNOWN}, or a flyer without one ({flyers}), got {arguments.policy!r}")
    flights = _flights(training, arguments)
    verdict = judge(training, flyer, flights, _UNSEEN, ProgressLine(), watch=arguments.view)
    if arguments.json:
        asked = {"training": arguments.name, "policy": arguments.policy, "flights": flights}
        print(json.dumps({**asked, "success": verdict.success, "crashed": verdict.crashed, **verdict.more}))
    else:
        print(_said(verdict, flights))


def _record(arguments: argparse.Namespace) -> None:
    training, path = _asked(arguments), arguments.film or Path(f"{arguments.name.rpartition(':')[2]}.mp4")
    model = _policy(arguments)
    path.parent.mkdir(parents=True, exist_ok=True)
    record(path, model, training.env, seed=arguments.seed, watch=arguments.view, **training.film)
    print(path)


def _policy(arguments: argparse.Namespace) -> Any:
    """Return the model of a file or, if there is none, the bundled one of this name."""
    if arguments.policy in policies.names() and not Path(arguments.policy).exists():
        return policies.load(arguments.policy)
    if not any(Path(arguments.policy + suffix).exists() for suffix in ("", ".zip")):
        hint = did_you_mean(arguments.policy, policies.names())
        raise ValueError(f"POLICY: expected a {_KNOWN}, got {arguments.policy!r}{hint}")
    return load(arguments.policy, arguments.learner)


def _asked(arguments: argparse.Namespace) -> Training:
    training = training_of(arguments.name)
    steps = getattr(arguments, "steps", None)
    return training if steps is None else replace(training, steps=steps)


def _flights(training: Training, arguments: argparse.Namespace) -> int:
    return arguments.flights or training.flights


def _said(verdict: Verdict, flights: int) -> str:
    figures = "".join(f", {name} {value:.3f}" for name, value in verdict.more.items())
    return f"{verdict.success:.1%} of {flights:,} flights succeed, {verdict.crashed:.1%} crash{figures}"


def _count(text: str) -> int:
    count = int(text)
    if count < 1:
        raise ValueError
    return count


_count.__name__ = "number above 0"  # of argparse's message
_UNSEEN = UNSEEN_SEEDS.start
