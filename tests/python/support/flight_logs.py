"""Flight logs of drones whose numbers are known: flown by the engine, under a pilot that shakes every axis."""

import struct
import zlib

import numpy as np
from conftest import world_of

import flockstep
from flockstep.rotations import quat_from_rpy, rotate, rpy_from_quat

OPEN = world_of(room={"min": [-5e3] * 3, "max": [5e3] * 3})
HZ, TICKS = 500, 2
GYRO, ACCELEROMETER = 0.02, 0.15  # standard deviations of noise, rad/s and m/s^2
#: A drone that is not like any bundled one, with all effects that are fitted.
TRUTH = {
    "flockstep_drone": 1,
    "name": "truth",
    "mass_kg": 0.03,
    "inertia_kgm2": [1.9e-5, 2.3e-5, 3.4e-5],
    "size_m": [0.11, 0.11, 0.04],
    "rotors": {
        "position_m": [[0.033, -0.033, 0], [-0.033, 0.033, 0], [0.033, 0.033, 0], [-0.033, -0.033, 0]],
        "spin": ["ccw", "ccw", "cw", "cw"],
        "thrust_n": [0.004, 1e-5, 2.2e-8],
        "max_speed_radps": 2400,
        "torque_ratio_m": 0.0085,
        "lag_s": 0.06,
        "inertia_kgm2": 4e-8,
    },
    "drag": {"linear_n_per_mps": [0.012, 0.015, 0.02]},
}
#: The fields of a drone file from which a fit begins, far from the truth.
GUESS = {**TRUTH, "name": "guess", "inertia_kgm2": [1.26e-5, 1.26e-5, 2.04e-5], "drag": {}} | {
    "rotors": {**TRUTH["rotors"], "thrust_n": [0, 0, 2.5e-8], "lag_s": 0.1, "torque_ratio_m": 0.012}
}
TRIM = np.array([0.994, 1.006, 1.003, 0.997])  # gains of the motors


def fly_logs(flights, seconds, *, data=TRUTH, shaken=(1, 1, 1, 1), delay_ticks=0, hz=HZ, seed=0, noise=1.0):
    """Return columns, by their names in a CSV file, of flights in still air.

    Roll, pitch, yaw and thrust are shaken by these shares, which may be 0.
    """
    random = np.random.default_rng(seed)
    drone, rotors = flockstep.DroneModel.from_dict(data), data["rotors"]
    batch = flockstep.Batch(
        [OPEN],
        flights,
        drone=drone,
        dynamics=flockstep.DynamicsConfig(motion="rotors", control="rotor_speeds"),
        clock=flockstep.ClockConfig(policy_hz=HZ, physics_hz=HZ * TICKS),
    )
    batch.set_pose([0, 0, 0])
    steps = round(seconds * HZ)
    place, spins = np.array(rotors["position_m"]), np.array([1, 1, -1, -1])
    mixer = np.linalg.inv(
        np.stack([np.ones(4), place[:, 1], -place[:, 0], -rotors["torque_ratio_m"] * spins])
    )  # rotor thrusts of thrust and torques
    inertia, mass = np.array(data["inertia_kgm2"]), data["mass_kg"]
    goals = np.repeat(random.uniform(-1, 1, (-(-steps // 150), flights, 4)), 150, axis=0)[:steps] * shaken
    flicker = np.repeat(random.uniform(-1, 1, (-(-steps // 25), flights, 4)), 25, axis=0)[:steps] * shaken
    c0, c1, c2 = rotors["thrust_n"]
    kept = {name: [] for name in ("command", "gyro", "velocity", "position", "rpy", "force")}
    queue = [np.full((flights, 4), drone.hover_speed_radps / 2400)] * (delay_ticks + 1)
    for goal, shake in zip(goals, flicker, strict=True):
        rpy = rpy_from_quat(np.array(batch.quat_wxyz, float))
        rates, velocity = np.array(batch.angular_velocity, float), np.array(batch.velocity, float)
        body = rotate(quat_from_rpy(np.stack([0 * rpy[:, 0], 0 * rpy[:, 0], rpy[:, 2]], 1)), velocity, inverse=True)
        lean = np.clip(np.stack([body[:, 1], -body[:, 0], 0 * body[:, 0]], axis=1) / 10, -0.25, 0.25)
        error = lean + goal[:, :3] * [0.3, 0.3, 0.8] - rpy
        error[:, 2] = (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
        turn = (3 * error - rates) * [9, 9, 3] + shake[:, :3] * [25, 25, 4]
        lift = 9.81 + 2.5 * goal[:, 3] - 0.3 * velocity[:, 2] - 0.05 * np.array(batch.position)[:, 2]
        thrust = np.concatenate([mass * lift[:, None], inertia * turn], axis=1) @ mixer.T
        speed = (-c1 + np.sqrt(np.maximum(c1**2 - 4 * c2 * (c0 - np.maximum(thrust, c0)), 0))) / (2 * c2)
        command = np.clip(speed / rotors["max_speed_radps"], 0.1, 0.95)
        for name, value in (("gyro", rates), ("velocity", velocity), ("rpy", rpy), ("position", batch.position)):
            kept[name].append(np.array(value, float))
        quat = np.array(batch.quat_wxyz, float)
        kept["command"].append(command)
        queue = [*queue[1:], command]
        batch.fly((queue[0] * TRIM * rotors["max_speed_radps"]).astype(np.float32))
        change = (np.array(batch.velocity, float) - velocity) * HZ
        middle = quat + np.array(batch.quat_wxyz, float)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        kept["force"].append(rotate(middle, change + np.array([0, 0, 9.81]), inverse=True))
    force = np.stack(kept["force"])  # means over the steps, of which those before and after a sample make it
    kept["force"] = np.concatenate([force[:1], (force[1:] + force[:-1]) / 2])
    told = {name: np.stack(values)[:: HZ // hz] for name, values in kept.items()}
    return [_columns({name: values[:, k] for name, values in told.items()}, hz, random, noise) for k in range(flights)]


def _columns(told, hz, random, noise):
    """Return one flight's columns, with noise and an offset of the accelerometer."""
    count = len(told["gyro"])
    gyro = told["gyro"] + noise * GYRO * random.standard_normal((count, 3))
    force = told["force"] + noise * ACCELEROMETER * random.standard_normal((count, 3)) + [0.1, -0.1, 0]
    columns = {"time_s": np.arange(count) / hz + 3.0}
    columns |= {f"motor_{k + 1}": told["command"][:, k] for k in range(4)}
    for axis, name in enumerate("xyz"):
        columns[f"gyro_{name}_radps"] = gyro[:, axis]
        columns[f"accelerometer_{name}_mps2"] = force[:, axis]
        columns[f"position_{name}_m"] = told["position"][:, axis]
        columns[f"velocity_{name}_mps"] = told["velocity"][:, axis]
    columns |= {name: told["rpy"][:, k] for k, name in enumerate(("roll_rad", "pitch_rad", "yaw_rad"))}
    return columns


def csv_text(columns):
    """Return a CSV file."""
    rows = np.stack(list(columns.values()), axis=1)
    return "\n".join([",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n"


#: What a Crazyflie calls the columns, its type, and our unit in its unit.
CRAZYFLIE = {
    "motor_1": ("motor.m1", "I", 65535),
    "motor_2": ("motor.m3", "I", 65535),
    "motor_3": ("motor.m4", "I", 65535),
    "motor_4": ("motor.m2", "I", 65535),
    **{f"gyro_{a}_radps": (f"gyro.{a}", "f", 180 / np.pi) for a in "xyz"},
    **{f"accelerometer_{a}_mps2": (f"acc.{a}", "f", 1 / 9.81) for a in "xyz"},
}


def crazyflie_bytes(columns):
    """Return a log as a Crazyflie's SD card holds it: a table of events, records, a checksum."""
    names = [name for name in columns if name in CRAZYFLIE]
    told = [CRAZYFLIE[name] for name in names]
    head = struct.pack("<BHH", 0xBC, 2, 2)
    head += struct.pack("<H", 7) + b"other\0" + struct.pack("<H", 1) + b"flag(B)\0"
    head += struct.pack("<H", 0xFFFF) + b"fixedFrequency\0" + struct.pack("<H", len(names))
    head += b"".join(f"{label}({kind})".encode() + b"\0" for label, kind, _ in told)
    record = struct.Struct("<HQ" + "".join(kind for _, kind, _ in told))
    rows = [struct.pack("<HQB", 7, 1, 1)]
    for k, time in enumerate(columns["time_s"]):
        values = [columns[name][k] * factor for name, (_, _, factor) in zip(names, told, strict=True)]
        whole = [round(v) if kind == "I" else v for v, (_, kind, _) in zip(values, told, strict=True)]
        rows.append(record.pack(0xFFFF, round(time * 1e6), *whole))
    data = head + b"".join(rows)
    return data + struct.pack("<I", zlib.crc32(data))
