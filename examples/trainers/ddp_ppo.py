"""Train on the LiDAR task with hand-written PPO in several processes, on one machine or more: DistributedDataParallel.

.venv/bin/torchrun --nproc-per-node 2 examples/trainers/ddp_ppo.py

Every process flies its share of the drones and learns from their steps; the gradients are averaged.
"""

import os

import gymnasium
import torch
import torch.distributed as dist
import tyro
from torch import Tensor, nn
from torch.distributions import Categorical
from torch.nn.parallel import DistributedDataParallel

from cleanrl_ppo import AUTORESET, BATCH_SIZE, CLIP, ENTROPY, EPOCHS, MAX_GRADIENT, STEPS, VALUE, advantages
from lidar_task import ID, NUM_ENVS, SETTINGS, Options, Run, network
from processes import drones_of_each, end_process, threads_of_each

if "RANK" not in os.environ:
    raise SystemExit("start this program by torchrun: torchrun --nproc-per-node 2 ddp_ppo.py")
RANK, PROCESSES = int(os.environ["RANK"]), int(os.environ["WORLD_SIZE"])
DRONES, THREADS = drones_of_each(PROCESSES), threads_of_each(int(os.environ["LOCAL_WORLD_SIZE"]))
MINIBATCHES = STEPS * NUM_ENVS // BATCH_SIZE  # of BATCH_SIZE / PROCESSES rows in each process


class ActorCritic(nn.Module):
    """Both networks in one module, as DistributedDataParallel needs them."""

    def __init__(self) -> None:
        super().__init__()
        self.actor, self.critic = network(6, gain=0.01), network(1, gain=1.0)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return logits (..., 6) and values (...,)."""
        return self.actor(observation), self.critic(observation).squeeze(-1)


def make_envs(seed: int) -> tuple[gymnasium.vector.VectorEnv, Tensor]:
    """Return this process's drones and their first observations; the processes share the seeds of a single one."""
    envs = gymnasium.make_vec(ID, DRONES, autoreset_mode=AUTORESET, num_threads=THREADS, **SETTINGS)
    return envs, torch.from_numpy(envs.reset(seed=seed * NUM_ENVS + RANK * DRONES)[0])


def goes_on(run: Run, flown: int, nets: ActorCritic) -> bool:
    """Let the first process decide whether another update is due."""
    answer = [RANK == 0 and run.goes_on(flown, lambda seen: nets.actor(torch.from_numpy(seen)).argmax(1).numpy())]
    dist.broadcast_object_list(answer)
    return answer[0]


def main(options: Options) -> nn.Module:
    """Train and return actor and critic."""
    dist.init_process_group("gloo")
    run, nets = Run("torch", AUTORESET, options), ActorCritic()  # Run seeds PyTorch: all begin with the same networks
    model = DistributedDataParallel(nets)
    torch.manual_seed(options.seed * PROCESSES + RANK)  # their actions and minibatches differ
    optimizer = torch.optim.Adam(nets.parameters(), lr=3e-3, eps=1e-5)
    observation = torch.zeros(STEPS + 1, DRONES, 38)
    action, reward, log_prob = torch.zeros(3, STEPS, DRONES)
    terminated, ended = torch.zeros(2, STEPS + 1, DRONES, dtype=torch.bool)  # row t: flags of the previous step
    (envs, observation[-1]), flown = make_envs(options.seed), 0
    while goes_on(run, flown, nets):
        observation[0], ended[0] = observation[-1], ended[-1]
        for t in range(STEPS):
            with torch.no_grad():
                policy = Categorical(logits=nets.actor(observation[t]))
            action[t] = policy.sample()
            log_prob[t] = policy.log_prob(action[t])
            seen, earned, dead, cut = map(torch.as_tensor, envs.step(action[t].long().numpy())[:4])
            observation[t + 1], reward[t], terminated[t + 1], ended[t + 1] = seen, earned, dead, dead | cut
        with torch.no_grad():
            value = nets.critic(observation).squeeze(-1)
        advantage = advantages(reward, value, terminated[1:], ended[1:])
        data = [part.flatten(0, 1) for part in (observation[:-1], action, log_prob, advantage, advantage + value[:-1])]
        rows = (~ended[:-1]).flatten().nonzero().squeeze(1)  # excludes the steps that began an episode
        flown += len(rows) * PROCESSES
        for _ in range(EPOCHS):
            for batch in rows[torch.randperm(len(rows))].tensor_split(MINIBATCHES):  # as many in every process
                seen, chosen, old_log_prob, gain, target = (part[batch] for part in data)
                logits, now = model(seen)
                policy = Categorical(logits=logits)
                ratio = (policy.log_prob(chosen) - old_log_prob).exp()
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                loss = -torch.min(gain * ratio, gain * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
                loss += VALUE * nn.functional.mse_loss(now, target) - ENTROPY * policy.entropy().mean()
                optimizer.zero_grad()
                loss.backward()  # averages the gradients of the processes
                nn.utils.clip_grad_norm_(nets.parameters(), MAX_GRADIENT)
                optimizer.step()
    dist.barrier()
    dist.destroy_process_group()
    return nets


if __name__ == "__main__":
    main(tyro.cli(Options))
    end_process()
