"""Change a drone while it hovers, and let its policy adapt within a second.

Keys: m and M change the mass, t and T the thrust, l and L the lag of the rotors, a adapts the policy, q quits. The bar
shows how far the drone is from its point. Without a terminal, or with --steps, a fixed change is made instead.
"""

from __future__ import annotations

import argparse
import curses
import sys
import time
from typing import Any

import numpy as np

import flockstep

KEYS = {"m": ("mass_scale", 0.9), "M": ("mass_scale", 1.1), "t": ("thrust_scale", 0.95), "T": ("thrust_scale", 1.05)}
KEYS |= {"l": ("lag_up_scale", 0.8), "L": ("lag_up_scale", 1.25)}
POINT = {"features_extractor_class": "PointFeatures"}


class Live:
    """A drone that hovers, and the policy that flies it."""

    def __init__(self) -> None:
        self.numbers = {"mass_scale": 1.0, "thrust_scale": 1.0, "lag_up_scale": 1.0}
        self.flown, self.trained = self._envs(1, max_episode_steps=100_000), self._envs(32)
        self.observation, _ = self.flown.reset(seed=0)
        self.model = flockstep.APG("MlpPolicy", self.trained, policy_kwargs=POINT, seed=0, num_threads=1)
        self.model.learn(307_200)

    def _envs(self, count: int, **keywords: Any) -> flockstep.DroneVectorEnv:
        return flockstep.DroneVectorEnv(
            count, task=flockstep.HoverConfig(), variations=self._laws(), num_threads=1, **keywords
        )

    def _values(self) -> dict[str, float]:
        return {**self.numbers, "lag_down_scale": self.numbers["lag_up_scale"]}

    def _laws(self) -> Any:
        return flockstep.vary(**{name: (value, value) for name, value in self._values().items()})

    def change(self, key: str) -> None:
        """Change a number of the drone that flies."""
        name, factor = KEYS[key]
        self.numbers[name] = float(np.clip(self.numbers[name] * factor, 0.75, 1.3))
        params = self.flown.batch.params.copy()
        for each, value in self._values().items():
            params[:, flockstep.parameter_names.index(each)] = value
        self.flown.batch.set_params(params)
        self.flown.batch.set_variations(self._laws())  # of the next episodes, too

    def adapt(self) -> float:
        """Train the policy on drones like this one, from what it knows; return the seconds."""
        begun = time.perf_counter()
        self.trained.batch.set_variations(self._laws())
        self.model.learn(307_200)
        return time.perf_counter() - begun

    def step(self) -> float:
        """Fly a step; return the distance to the point, m."""
        action, _ = self.model.predict(self.observation, deterministic=True)
        self.observation = self.flown.step(action)[0]
        return float(np.linalg.norm(self.observation[0, :3]))


def scripted(live: Live, steps: int) -> None:
    """Add 21 % to the mass and print the error before, after, and after adapting."""

    def error() -> float:
        return float(np.mean([live.step() for _ in range(steps)][steps // 2 :]))

    print(f"before: {100 * error():.1f} cm")
    for _ in range(2):
        live.change("M")
    print(f"{live.numbers['mass_scale']:.2f} times the mass: {100 * error():.1f} cm")
    seconds = live.adapt()
    print(f"adapted in {seconds:.1f} s: {100 * error():.1f} cm")


def interactive(screen: Any, live: Live) -> None:
    """Fly in real time."""
    screen.nodelay(True)
    said = ""
    while True:
        key = screen.getch()
        if key == ord("q"):
            return
        if key == ord("a"):
            said = f"adapted in {live.adapt():.1f} s"
        elif key >= 0 and chr(key) in KEYS:
            live.change(chr(key))
            said = "changed; press a to adapt"
        distance = live.step()
        screen.erase()
        screen.addstr(0, 0, "  ".join(f"{name} {value:.2f}" for name, value in live.numbers.items()))
        screen.addstr(1, 0, f"{100 * distance:6.1f} cm  " + "#" * min(int(200 * distance), 60))
        screen.addstr(2, 0, said)
        screen.refresh()
        time.sleep(0.02)


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=0, help="steps of each part of a fixed change; 0: by keys")
    steps = parser.parse_args().steps
    live = Live()
    if steps > 0 or not sys.stdout.isatty():
        scripted(live, steps or 200)
    else:
        curses.wrapper(interactive, live)


if __name__ == "__main__":
    main()
