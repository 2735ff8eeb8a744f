"""A picture of the camera task's image processing: the capture, the green pixels, the box and its direction.

.venv/bin/python -m training.plot_blob out/train/camera/policy.zip --out out/blob.png

The policy flies the playground, and the picture shows moments of its flight with the goal in view. Without a policy the
drone flies straight towards the goal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import tyro
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

import flockstep
from training.evaluate import Policy, greedy
from training.tasks import Setup, load_policy, setup_of

Image = npt.NDArray[np.uint8]

SEEN_PX = 12  # minimum width of the blob in the large picture: smaller ones are hard to see on paper


def draw_capture(axes: Axes, image: Image) -> None:
    """Draw the camera's image."""
    axes.imshow(image)
    axes.set_title("capture")


def draw_mask(axes: Axes, blob: flockstep.GreenBlob) -> None:
    """Draw the mask of green pixels."""
    axes.imshow(blob.mask, cmap="gray", vmin=0, vmax=1)
    axes.set_title("green: G > 1.25 max(R, B) + 16")


def draw_direction(axes: Axes, image: Image, blob: flockstep.GreenBlob) -> None:
    """Draw the box around the green, and an arrow from the middle of the image to its centre."""
    height, width = image.shape[:2]
    axes.imshow(image)
    if not blob.found:
        axes.set_title("nothing green: offset 0, area 0")
        return
    axes.add_patch(Rectangle((blob.x - 0.5, blob.y - 0.5), blob.width, blob.height, fill=False, color="red", lw=1.5))
    middle = (width / 2 - 0.5, height / 2 - 0.5)
    tip = (blob.x + blob.width / 2 - 0.5, middle[1])
    axes.axvline(middle[0], color="0.4", linestyle=":", linewidth=1)
    axes.annotate("", xy=tip, xytext=middle, arrowprops={"arrowstyle": "->", "color": "tab:blue", "lw": 2})
    axes.set_title(f"offset {blob.offset:+.3f}, area {100 * blob.area:.2f} %")


def plot(images: Sequence[Image], path: Path) -> None:
    """Write a picture with a row for each image."""
    figure, grid = plt.subplots(len(images), 3, figsize=(12, 3.4 * len(images)), layout="constrained", squeeze=False)
    for row, image in zip(grid, images, strict=True):
        blob = flockstep.green_blob(image)
        draw_capture(row[0], image)
        draw_mask(row[1], blob)
        draw_direction(row[2], image, blob)
        for axes in row:
            axes.set_xticks([])
            axes.set_yticks([])
    figure.savefig(path, dpi=90)
    plt.close(figure)


def captures(policy: Policy | None, setup: Setup, world: flockstep.World, width_px: int, max_steps: int) -> list[Image]:
    """Return the images of a large camera during a flight, while the goal is in view."""
    eye = flockstep.Batch(
        [world], cameras=[flockstep.CameraConfig(width_px=width_px, height_px=width_px * 3 // 4, samples_per_pixel=4)]
    )
    envs = setup.make(1, worlds=[world], autoreset_mode="disabled")
    observation, _ = envs.reset(seed=0)
    seen = []
    for _ in range(max_steps):
        eye.set_pose(envs.batch.position, envs.batch.quat_wxyz)
        eye.sense()
        image = eye.camera().rgb[0].copy()
        if flockstep.green_blob(image).width >= SEEN_PX:
            seen.append(image)
        actions = np.zeros(1, np.int64) if policy is None else policy(observation)
        observation, _, terminated, truncated, _ = envs.step(actions)
        if terminated[0] or truncated[0]:
            break
    envs.close()
    return seen


@dataclass
class Args:
    """Options for drawing the green blob along a flight."""

    policy: tyro.conf.Positional[Path | None] = None
    """A model saved by training/train_ppo.py --task camera or pixels (.zip). Loading it runs code from the file:
    load only policies you trust."""
    world: str = "playground/camera-train-1"
    """A scene name or path."""
    out: Path = Path("out/blob.png")
    """The picture."""
    moments: int = 3
    """Number of images to show, evenly spread over those with the goal in view."""
    width_px: int = 640
    """Width of the images in the picture; the policy's own images are independent of it."""
    max_steps: int = 400
    """Maximum number of steps of the flight."""


def main(args: Args) -> None:
    """Fly and draw."""
    model = None if args.policy is None else load_policy(args.policy)
    setup = Setup("camera") if model is None else setup_of(model)
    if not setup.has_camera:
        raise SystemExit(f"{args.policy} was trained for {setup.task}: expected a policy of camera or pixels")
    world = flockstep.scenes.load(args.world)[0]
    images = captures(None if model is None else greedy(model), setup, world, args.width_px, args.max_steps)
    if not images:
        raise SystemExit(f"the goal of {args.world} was never in view")
    chosen = np.linspace(0, len(images) - 1, min(args.moments, len(images))).round().astype(int)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    plot([images[i] for i in chosen], args.out)
    print(f"{len(chosen)} of {len(images)} images with the goal in view are in {args.out}")


if __name__ == "__main__":
    main(tyro.cli(Args))
