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
model = flockstep.PPO("MlpPolicy", envs, learning_rate=lambda left: 1e-3 * left, policy_kwargs={"net_arch": [32]})
actions: npt.NDArray[np.float32] = flockstep.PPO.load("policy").learn(1_000).predict(envs.reset())[0]
flockstep.testing.check_vector_env(lambda n: flockstep.DroneVectorEnv(n, task=flockstep.HoverConfig(), hold_m=0.1))

client = flockstep.connect("127.0.0.1:41451", token="secret", timeout_s=5)
drone: flockstep.client.Drone = client.spawn_drone((2, 4, 2), claim=True)
hit: bool = drone.set_location_and_rotation((2, 4, 2), flockstep.client.Angles(yaw_deg=90), teleport=False).hit
ranges: npt.NDArray[np.float32] = drone.get_lidar_data(directions=False).ranges
jpeg = bytes(drone.get_camera_data(format="jpeg", quality=80))
client.set_camera_capture_mode("on_demand")
step: int = client.get_arrays(["position"]).time.step
for scan in drone.subscribe_lidar(rate_hz=10):
    nearest: float = scan.ranges.min()
observation, infos = client.vector_env(reward_scale=0.1).reset(seed=0)


async def main() -> None:
    async with await flockstep.connect_async("unix:/run/flockstep") as client:
        drones: list[flockstep.client.AsyncDrone] = await client.get_drones()
        location: npt.NDArray[np.float32] = await drones[0].get_location()
        async for arrays in client.subscribe_arrays(["position"], rate_hz=30):
            position = arrays["position"] - location
            print(position.shape, arrays.time.time_s)
