"""The picture of what sensors read on one flight, exact beside erring.

.venv/bin/python -m tools.readings_picture
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import tyro
from matplotlib.axes import Axes

import flockstep

SECONDS, RATE_HZ = 60, 100
#: Sensors without errors, and with, by their keywords.
EXACT: dict[str, Any] = {
    "pose_sensor": flockstep.PoseSensorConfig(),
    "imu": flockstep.ImuConfig(),
    "barometer": flockstep.BarometerConfig(),
    "magnetometer": flockstep.MagnetometerConfig(),
    "gps_receiver": flockstep.GpsReceiverConfig(),
    "optical_flow": flockstep.OpticalFlowConfig(max_range_m=10.0),
}
ERRING: dict[str, Any] = {
    "pose_sensor": flockstep.PoseSensorConfig(
        position_noise_std_m=0.005, position_random_walk=0.1, yaw_random_walk=0.5
    ),
    "imu": flockstep.ImuConfig.preset("mpu-6000"),
    "barometer": flockstep.BarometerConfig.preset("px4-sih"),
    "magnetometer": flockstep.MagnetometerConfig.preset("px4-sih"),
    "gps_receiver": flockstep.GpsReceiverConfig.preset("consumer"),
    "optical_flow": flockstep.OpticalFlowConfig.preset("pmw3901"),
}
ERRING["imu"].accelerometer_vibration_mps2 = 0.3
ERRING["optical_flow"].max_range_m = 10.0

Readings = dict[str, npt.NDArray[np.float32]]


def flown(sensors: dict[str, Any]) -> Readings:
    """Return the readings of a flight along a figure-8 that rises and sinks, by the names of their arrays."""
    ground = {"min": [-30, -30, 0], "max": [30, 30, 30]}
    world = flockstep.World.from_dict({"flockstep_scene": 1, "name": "hall", "room": ground})
    batch = flockstep.Batch(
        [world],
        drone="x500",
        dynamics=flockstep.DynamicsConfig(motion="rotors", control="position"),
        clock=flockstep.ClockConfig(policy_hz=RATE_HZ),
        **sensors,
    )
    batch.set_pose(np.array([[0, 0, 3]], np.float32))
    found: dict[str, list[Any]] = {}
    for step in range(SECONDS * RATE_HZ):
        turn = 2 * np.pi * step / RATE_HZ / 20
        batch.fly(np.array([[6 * np.sin(turn), 3 * np.sin(2 * turn), 3 + np.sin(turn / 3), 0]], np.float32))
        batch.sense()
        for name in (
            "sensed_position",
            "gps_position",
            "pressure_height",
            "accelerometer",
            "magnetic_field",
            "optical_flow",
        ):
            found.setdefault(name, []).append(getattr(batch, name)[0].copy())
    return {name: np.array(values) for name, values in found.items()}


@dataclass
class Args:
    """Draw the picture."""

    out: Path = Path("docs/images/gallery/readings.png")
    """File of the picture."""


def main(args: Args) -> None:
    """Fly with exact and with erring sensors, and draw."""
    exact, erring = flown(EXACT), flown(ERRING)
    time = np.arange(SECONDS * RATE_HZ) / RATE_HZ
    figure, axes = plt.subplots(2, 3, figsize=(11, 6), layout="constrained")

    def draw(
        pane: Axes, title: str, name: str, labels: tuple[str, str], columns: list[int], until: int = SECONDS
    ) -> None:
        """Draw columns of an array: one over time, or two over each other."""
        shown = time < until
        for label, readings, color in (("with errors", erring, "C1"), ("exact", exact, "0.15")):
            values = readings[name].reshape(len(time), -1)[shown]
            pane.plot(*([time[shown]] * (len(columns) == 1)), *values[:, columns].T, color=color, lw=0.9, label=label)
        pane.set(title=title, xlabel=labels[0], ylabel=labels[1])
        pane.grid(alpha=0.3)

    draw(axes[0, 0], "estimated position", "sensed_position", ("x (m)", "y (m)"), [0, 1])
    draw(axes[0, 1], "GPS receiver", "gps_position", ("x (m)", "y (m)"), [0, 1])
    draw(axes[0, 2], "barometer", "pressure_height", ("s", "height (m)"), [0])
    draw(axes[1, 0], "accelerometer, near rotors", "accelerometer", ("s", "along x (m/s²)"), [0], 10)
    draw(axes[1, 1], "magnetometer", "magnetic_field", ("s", "along x (µT)"), [0], 20)
    draw(axes[1, 2], "optical flow", "optical_flow", ("s", "about y (rad/s)"), [0], 20)
    axes[0, 2].legend()
    args.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(args.out, dpi=110)
    print(f"the picture is {args.out}")


if __name__ == "__main__":
    main(tyro.cli(Args))
