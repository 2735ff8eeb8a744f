"""Log the reward terms of episodes during training."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback

from flockstep.nearest_name import did_you_mean


class LogTerms(BaseCallback):
    """Logs means over the episodes that ended in a rollout, to TensorBoard and the other log outputs.

    ``terms/NAME`` is the unscaled sum of a reward term over an episode. ``infos/NAME`` is a value that a `Task` reports
    by its ``info_names``. Stable-Baselines3 itself logs the success rate as ``rollout/success_rate``.

    Parameters
    ----------
    info_names
        Names of the infos to log in addition to the terms, as a sequence such as ``("laps",)``.

    Examples
    --------
    >>> model.learn(300_000, callback=flockstep.sb3.LogTerms())
    """

    def __init__(self, info_names: Iterable[str] = ()) -> None:
        super().__init__()
        if isinstance(info_names, str):
            raise TypeError(f"info_names: expected a sequence of names, such as ({info_names!r},), got {info_names!r}")
        self._info_names = tuple(info_names)
        self._values: dict[str, list[float]] = defaultdict(list)

    def _on_step(self) -> bool:
        for info in self.locals["infos"]:
            if "episode_terms" in info:
                self._note("terms", info["episode_terms"])
                missing = [name for name in self._info_names if name not in info]
                if missing:
                    known = [name for name, value in info.items() if isinstance(value, Real)]
                    hint = did_you_mean(missing[0], known)
                    raise ValueError(f"info_names: expected some of {', '.join(known)}, got {missing[0]!r}{hint}")
                self._note("infos", {name: info[name] for name in self._info_names})
        return True

    def _note(self, group: str, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            self._values[f"{group}/{name}"].append(float(value))

    def _on_rollout_end(self) -> None:
        for key, values in self._values.items():
            self.logger.record(key, float(np.mean(values)))
        self._values.clear()
