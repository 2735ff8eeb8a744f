"""Code that users write passes `mypy --strict`; ./dev lint checks it."""

import numpy as np
import numpy.typing as npt

import flockstep

world = flockstep.World.load("playground/train-1")
path: npt.NDArray[np.float32] | None = flockstep.plan(world, world.start, [world.goal])
named = flockstep.plan("playground/train-1", world.start, [*world.waypoints, world.goal], drone="crazyflie")
if world.start is None:
    raise ValueError("the world has no start marker")

batch = flockstep.Batch("train", 4, drone="racer5")
ends = [flockstep.EpisodeEnd(code).name for code in batch.episode_end.tolist()]
envs = flockstep.sb3.make_vec("flockstep/Hover-v0", 4, start_tilt_deg=10)
rates: dict[str, float] = flockstep.sb3.evaluate(None, "flockstep/Hover-v0").ends
flockstep.testing.check_vector_env(lambda n: flockstep.DroneVectorEnv(n, task=flockstep.HoverConfig(), hold_m=0.1))
