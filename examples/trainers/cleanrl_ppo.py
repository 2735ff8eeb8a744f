"""Train on the LiDAR task with hand-written PPO, like CleanRL: PyTorch and Gymnasium's VectorEnv, no library.

.venv/bin/python examples/trainers/cleanrl_ppo.py
"""

import gymnasium
import torch
import tyro
from torch import Tensor, nn
from torch.distributions import Categorical

from lidar_task import ID, NUM_ENVS, SETTINGS, Options, Run, network

# Gymnasium's default. The step after the end of an episode ignores its action and begins the next episode, so it must
# be excluded from learning; forgetting this is the usual mistake.
AUTORESET = "next_step"
STEPS, EPOCHS, BATCH_SIZE = 64, 4, 4096  # per update: steps of each env, passes over them, rows of a minibatch
GAMMA, LAMBDA, CLIP, ENTROPY, VALUE, MAX_GRADIENT = 0.98, 0.95, 0.2, 0.01, 0.5, 0.5


def advantages(reward: Tensor, value: Tensor, terminated: Tensor, ended: Tensor) -> Tensor:
    """Return generalised advantages (T, N) of rewards and flags (T, N) and values (T + 1, N).

    The observation after a last step still belongs to the old episode, so a truncated episode bootstraps from its
    value.
    """
    result, later = torch.zeros_like(reward), torch.zeros_like(reward[0])
    for t in reversed(range(len(reward))):
        later = reward[t] + GAMMA * value[t + 1] * ~terminated[t] - value[t] + GAMMA * LAMBDA * later * ~ended[t]
        result[t] = later
    return result


def main(options: Options) -> nn.Module:
    """Train and return actor and critic."""
    run = Run("torch", AUTORESET, options)
    envs = gymnasium.make_vec(ID, NUM_ENVS, autoreset_mode=AUTORESET, **SETTINGS)
    actor, critic = network(6, gain=0.01), network(1, gain=1.0)
    both = nn.ModuleList([actor, critic])
    optimizer = torch.optim.Adam(both.parameters(), lr=3e-3, eps=1e-5)
    observation = torch.zeros(STEPS + 1, NUM_ENVS, 38)
    action, reward, log_prob = torch.zeros(3, STEPS, NUM_ENVS)
    terminated, ended = torch.zeros(2, STEPS + 1, NUM_ENVS, dtype=torch.bool)  # row t: flags of the previous step
    observation[-1] = torch.from_numpy(envs.reset(seed=options.seed * NUM_ENVS)[0])
    flown = 0
    while run.goes_on(flown, lambda seen: actor(torch.from_numpy(seen)).argmax(1).numpy()):
        observation[0], ended[0] = observation[-1], ended[-1]
        for t in range(STEPS):
            with torch.no_grad():
                policy = Categorical(logits=actor(observation[t]))
            action[t] = policy.sample()
            log_prob[t] = policy.log_prob(action[t])
            seen, earned, dead, cut = map(torch.as_tensor, envs.step(action[t].long().numpy())[:4])
            observation[t + 1], reward[t], terminated[t + 1], ended[t + 1] = seen, earned, dead, dead | cut
        with torch.no_grad():
            value = critic(observation).squeeze(-1)
        advantage = advantages(reward, value, terminated[1:], ended[1:])
        data = [part.flatten(0, 1) for part in (observation[:-1], action, log_prob, advantage, advantage + value[:-1])]
        rows = (~ended[:-1]).flatten().nonzero().squeeze(1)  # excludes the steps that began an episode
        flown += len(rows)
        for _ in range(EPOCHS):
            for batch in rows[torch.randperm(len(rows))].split(BATCH_SIZE):
                seen, chosen, old_log_prob, gain, target = (part[batch] for part in data)
                policy = Categorical(logits=actor(seen))
                ratio = (policy.log_prob(chosen) - old_log_prob).exp()
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                loss = -torch.min(gain * ratio, gain * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
                loss += VALUE * nn.functional.mse_loss(critic(seen).squeeze(-1), target)
                loss -= ENTROPY * policy.entropy().mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(both.parameters(), MAX_GRADIENT)
                optimizer.step()
    return both


if __name__ == "__main__":
    main(tyro.cli(Options))
