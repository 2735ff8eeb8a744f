"""The bundled policies: their names, and models that fly."""

from __future__ import annotations

from pathlib import Path

from flockstep.errors import did_you_mean
from flockstep.learning import PPO


def directory() -> Path:
    """Return the folder of the bundled policies, inside an installed package or at the root of a checkout."""
    package = Path(__file__).resolve().parent
    installed = package / "policies"
    return installed if installed.is_dir() else package.parents[1] / "policies"


def names() -> list[str]:
    """Return the names of the bundled policies, sorted. Each has the name of its row in `flockstep.presets`."""
    return sorted(file.stem for file in directory().glob("*.zip"))


def load(name: str) -> PPO:
    """Return a bundled policy as a model. It lacks the moments of Adam, so training that goes on begins with new ones.

    >>> model = flockstep.policies.load("lidar")
    >>> flockstep.evaluate(model, "flockstep/LidarNavigation-v0", worlds="validation").success_rate
    1.0

    Raises
    ------
    ValueError
        There is none of this name; the message lists all.
    """
    if name not in names():
        raise ValueError(f"policies: expected one of {', '.join(names())}, got {name!r}{did_you_mean(name, names())}")
    return PPO.load(directory() / f"{name}.zip")
