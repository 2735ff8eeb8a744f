"""Trainings of the bundled tasks: ``python -m flockstep train``, ``evaluate`` and ``record``.

A training is a row of `TRAININGS`: the environments that it learns in, the hyperparameters, and the flights that judge
it.
"""

from flockstep.trainings.flying import Flights, Flyer, Verdict, best_of, fly, judge
from flockstep.trainings.learning import Callback, train
from flockstep.trainings.table import TRAININGS
from flockstep.trainings.training import CHOOSING_SEEDS, TRAINING_SEEDS, UNSEEN_SEEDS, Training, first_env_seed

__all__ = [
    "CHOOSING_SEEDS",
    "TRAININGS",
    "TRAINING_SEEDS",
    "UNSEEN_SEEDS",
    "Callback",
    "Flights",
    "Flyer",
    "Training",
    "Verdict",
    "best_of",
    "first_env_seed",
    "fly",
    "judge",
    "train",
]
