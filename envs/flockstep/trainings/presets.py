"""The trainings of the bundled tasks as keywords of `flockstep.PPO`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from flockstep.errors import did_you_mean
from flockstep.trainings.learning import make
from flockstep.trainings.table import TRAININGS
from flockstep.trainings.training import Training


class Preset(Mapping[str, Any]):
    """The hyperparameters of one training as keywords of `PPO`, with its environments and its number of steps.

    Attributes
    ----------
    env
        The Gymnasium id of the task.
    steps
        Steps of all drones together, for ``learn``.
    num_envs
        Environments that fly at once.
    """

    def __init__(self, training: Training) -> None:
        self._training = training
        self.env, self.steps, self.num_envs = training.env, training.steps, training.num_envs
        self._keywords = dict(training.settings)
        rate = self._keywords["learning_rate"]
        if training.falls:
            self._keywords["learning_rate"] = lambda left: rate * left
        if training.entropy:
            self._keywords["ent_coef"] = 0.4 * training.entropy  # its mean: it falls to 0 over 80 % of the steps

    def make_envs(self, num_threads: int = 0) -> Any:
        """Make the environments that the policy trains in, worlds included.

        Parameters
        ----------
        num_threads
            As for `DroneVectorEnv`; 0: one per physical core.

        Returns
        -------
        envs
            A `DroneVectorEnv`. Those of swap, which trains with several numbers of drones, are a ``VecEnv`` and need
            the extra ``sb3``.
        """
        return make(self._training, self.num_envs, num_threads)

    def keywords(self) -> dict[str, Any]:
        """Return the keywords of these environments; those of the lidar preset generate a thousand worlds."""
        return self._training.learns()

    def __getitem__(self, key: str) -> Any:
        """Return a keyword's value."""
        return self._keywords[key]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the keywords."""
        return iter(self._keywords)

    def __len__(self) -> int:
        """Return the number of keywords."""
        return len(self._keywords)

    def __repr__(self) -> str:
        """Return the keywords as text."""
        return f"Preset({self.env!r}, steps={self.steps}, num_envs={self.num_envs}, {self._keywords})"


class Presets(Mapping[str, Preset]):
    """The presets by name: settings with which a policy of each bundled task is known to learn.

    They are the rows that ``python -m flockstep train`` trains, with ``--learner sb3`` by Stable-Baselines3, too. The
    learning rate falls to 0. The command also lets the entropy bonus fall, of which a preset holds the mean.

    >>> lidar = flockstep.presets["lidar"]
    >>> model = flockstep.PPO("MlpPolicy", lidar.make_envs(), **lidar)
    >>> model.learn(lidar.steps, progress_bar=True)
    """

    def __getitem__(self, name: str) -> Preset:
        """Return a preset.

        Raises
        ------
        ValueError
            There is none of this name; the message lists all.
        """
        if name not in TRAININGS:
            hint = did_you_mean(name, TRAININGS)
            raise ValueError(f"presets: expected one of {', '.join(TRAININGS)}, got {name!r}{hint}")
        return Preset(TRAININGS[name])

    def __contains__(self, name: object) -> bool:
        """Return whether there is a preset of this name."""
        return name in TRAININGS

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names."""
        return iter(TRAININGS)

    def __len__(self) -> int:
        """Return the number of presets."""
        return len(TRAININGS)


presets = Presets()
"""Settings with which a policy of each bundled task is known to learn, by name, as keywords of `PPO`.

>>> lidar = flockstep.presets["lidar"]
>>> model = flockstep.PPO("MlpPolicy", lidar.make_envs(), **lidar)
>>> model.learn(lidar.steps, progress_bar=True)
"""
