"""A vector env whose transitions are written down in advance, in every autoreset mode."""

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv


class ScriptedEpisodes(VectorEnv):
    """Row r's episode e has the same observations, rewards and end in every mode, whatever the actions are."""

    def __init__(self, num_envs=3, mode="same_step", as_dict=False, ends=("terminated", "truncated", "both")):
        self.num_envs, self.ends, self.as_dict = num_envs, ends, as_dict
        self.mode = {
            "next_step": AutoresetMode.NEXT_STEP,
            "same_step": AutoresetMode.SAME_STEP,
            "disabled": AutoresetMode.DISABLED,
        }[mode]
        self.metadata = {"autoreset_mode": self.mode}
        box = spaces.Box(-np.inf, np.inf, (3,), np.float32)
        parts = [("second", spaces.Box(-9, 9, (2, 2), np.float32)), ("first", spaces.Box(-9, 9, (), np.float64))]
        self.single_observation_space = spaces.Dict(parts) if as_dict else box
        self.single_action_space = spaces.Box(-1, 1, (2,), np.float32)
        self.episode = np.full(num_envs, -1)
        self.age = np.zeros(num_envs, int)
        self.over = np.zeros(num_envs, bool)

    def _numbers(self, row, size):
        return np.random.default_rng((row, int(self.episode[row]), int(self.age[row]))).normal(size=size)

    def _observe(self, row):
        numbers = self._numbers(row, 8)
        if not self.as_dict:
            return numbers[:3].astype(np.float32)
        return {"second": numbers[:4].reshape(2, 2).astype(np.float32), "first": numbers[4]}

    def _observations(self):
        rows = [self._observe(row) for row in range(self.num_envs)]
        if not self.as_dict:
            return np.stack(rows)
        return {name: np.stack([row[name] for row in rows]) for name in ("first", "second")}  # in another order

    def _begin(self, rows):
        self.episode[rows] += 1
        self.age[rows] = 0
        self.over[rows] = False

    def reset(self, *, seed=None, options=None):
        self._begin(np.ones(self.num_envs, bool) if options is None else options["reset_mask"])
        return self._observations(), {}

    def step(self, actions):
        assert actions.shape == (self.num_envs, 2)
        assert (np.abs(actions) <= 1).all()
        resets = self.over.copy()
        assert not (self.mode is not AutoresetMode.NEXT_STEP and resets.any()), "an ended env was not reset"
        self.age += ~resets
        self._begin(resets)
        reward = np.array([0.0 if resets[row] else self._numbers(row, 8)[7] for row in range(self.num_envs)])
        ended = ~resets & (self.age >= 2 + (np.arange(self.num_envs) + 2 * self.episode) % 5)
        kind = np.array([self.ends[(row + e) % len(self.ends)] for row, e in enumerate(self.episode)])
        terminated, truncated = ended & (kind != "truncated"), ended & (kind != "terminated")
        infos = {}
        if self.mode is AutoresetMode.SAME_STEP and ended.any():
            final = np.full(self.num_envs, None, dtype=object)
            for row in np.flatnonzero(ended):
                final[row] = self._observe(row)
            infos = {"final_obs": final, "_final_obs": ended, "final_info": {"age": self.age.copy(), "_age": ended}}
            self._begin(ended)
        else:
            if ended.any():
                infos = {"age": self.age.copy(), "_age": ended}
            self.over = ended
        return self._observations(), reward, terminated, truncated, infos
