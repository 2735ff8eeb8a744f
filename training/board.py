"""The board: how long trainings take, from `flockstep.PPO` and from Stable-Baselines3 with the same settings.

./dev board             # all trainings, five seeds each; about an hour
./dev board hover       # one of them

Every seed is reported. A policy is the last of its training: nothing chooses among policies. It is judged by flights whose
seeds nothing else uses. The settings of each training were found with the seeds 100 and above.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro

import flockstep
from bench import results
from flockstep.sb3 import DroneVecEnv, GoalFeatures, PointFeatures, evaluate
from training.flight import Flights, fly, make, position_control
from training.rotor_navigation import RotorNavigation
from training.tasks import CHOOSING_SEEDS, TRAINING_SEEDS, UNSEEN_SEEDS, Setup, first_env_seed
from training.train_flight import Args as FlightArgs
from training.train_flight import baseline as flight_baseline

