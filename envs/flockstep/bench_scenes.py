"""Two benchmark scenes with the same layout: one made of boxes, one of detailed textured meshes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from flockstep._core import World, WorldBuilder

_SIDE_M = 24.0
_STEPS_AROUND, _STEPS_UP = 40, 38


def simple() -> World:
    """Return an open floor with a few boxes."""
    builder = WorldBuilder("bench/simple")
    _add_floor(builder)
    colors = ([0.55, 0.16, 0.1], [0.14, 0.3, 0.5], [0.55, 0.42, 0.12])
    materials = [builder.material(f"box {i + 1}", color) for i, color in enumerate(colors)]
    for i, (place, size) in enumerate(_places()):
        if i % 3 == 0:
            builder.box([*place, size[2] / 2], size, materials[i // 3 % 3])
    return builder.build()


def complex_() -> World:
    """Return the same floor full of vases and boulders, 109,000 textured triangles."""
    builder = WorldBuilder("bench/complex")
    _add_floor(builder)
    rng = np.random.default_rng(0)
    clay = builder.material("clay", texture=builder.texture("clay", _glaze(rng)))
    stone = builder.material("stone", texture=builder.texture("stone", _speckle(rng)))
    for i, (place, size) in enumerate(_places()):
        vertices, uv = _boulder(rng, size) if i % 3 == 2 else _vase(rng, size)
        builder.mesh(vertices + np.array([*place, 0]), _faces(), stone if i % 3 == 2 else clay, uv)
    return builder.build()


def _places() -> list[tuple[list[float], list[float]]]:
    """Return positions and sizes of the objects on the floor, in m: every other square of a chessboard."""
    rng = np.random.default_rng(1)
    places = []
    for row in range(6):
        for column in range(row % 2, 12, 2):
            width, height = rng.uniform(0.9, 1.3), rng.uniform(1.2, 2.8)
            places.append(([2.0 * column + 1.0, 4.0 * row + 2.0], [width, width, height]))
    return places


def _add_floor(builder: WorldBuilder) -> None:
    rows, columns = np.mgrid[:128, :128]
    shade = 150 + 40 * ((rows // 64 + columns // 64) % 2) - 60 * ((rows % 64 < 2) | (columns % 64 < 2))
    pixels = np.repeat(shade[..., None], 3, axis=2).astype(np.uint8)
    floor = builder.material("floor", texture=builder.texture("floor", pixels))
    builder.heightfield(np.zeros((2, 2)), floor, cell_m=_SIDE_M, texture_m=4)
    builder.start([1, 4, 1.5])
    builder.goal([23, 20, 1.5])
    builder.spawn_box([0.8, 3.8, 1.3], [1.2, 4.2, 1.7])


def _grid(around: float, up: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return each vertex's angle, its height as a fraction of the total, and its uv with texture repetitions."""
    share, turn = np.mgrid[0 : 1 : (_STEPS_UP + 1) * 1j, 0 : 1 : (_STEPS_AROUND + 1) * 1j].reshape(2, -1)
    return 2 * np.pi * turn, share, np.stack([around * turn, -up * share], 1)


def _vase(rng: np.random.Generator, size: list[float]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return vertices around (0, 0, 0) and uv of a vase with a fluted belly."""
    angle, share, uv = _grid(3, 2)
    belly = 0.32 + 0.1 * np.sin(np.pi * (1.5 * share + rng.uniform(0, 0.4))) - 0.25 * share**2 + 0.2 * share**12
    radius = size[0] * belly * (1 + 0.06 * np.sin(np.pi * share) * np.cos(rng.integers(6, 14) * angle))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), size[2] * share], 1), uv


def _boulder(rng: np.random.Generator, size: list[float]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return vertices around (0, 0, 0) and uv of a half-ball, dented by waves from all sides."""
    angle, share, uv = _grid(4, 2)
    across = np.cos(0.5 * np.pi * 0.97 * share)
    way = np.stack([across * np.cos(angle), across * np.sin(angle), np.sin(0.5 * np.pi * 0.97 * share)], 1)
    dents = np.sin(way @ rng.normal(0, 5, (3, 6)) + rng.uniform(0, 6, 6)).sum(1)
    way[:, :2] *= 1 + 0.05 * dents[:, None]
    way[:, 2] *= 1 + 0.05 * dents
    return way * [0.6 * size[0], 0.6 * size[1], 0.6 * size[2]], uv


def _glaze(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Return a mottled pattern of ornamental bands."""
    row, column = np.mgrid[:256, :256] / 256
    band = np.sin(2 * np.pi * 4 * row) > 0.2
    figure = np.sin(2 * np.pi * (6 * column + np.sin(2 * np.pi * 8 * row))) > 0
    base = np.where((band & figure)[..., None], [46, 34, 30], np.where(band[..., None], [196, 150, 96], [164, 84, 50]))
    return np.clip(base + rng.normal(0, 7, (256, 256, 1)), 0, 255).astype(np.uint8)


def _speckle(rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Return grey noise of several sizes."""
    grey = np.full((256, 256), 128.0)
    for step in (2, 4, 16, 64):
        grey += np.kron(rng.normal(0, 11, (256 // step, 256 // step)), np.ones((step, step)))
    pixels: npt.NDArray[np.uint8] = np.clip(grey[..., None] * [1.0, 0.97, 0.91], 0, 255).astype(np.uint8)
    return pixels


def _faces() -> npt.NDArray[np.int32]:
    across, up = np.meshgrid(np.arange(_STEPS_AROUND), np.arange(_STEPS_UP))
    a = (up * (_STEPS_AROUND + 1) + across).ravel()
    b, c, d = a + 1, a + _STEPS_AROUND + 2, a + _STEPS_AROUND + 1
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
