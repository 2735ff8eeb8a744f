"""The engine's random numbers, written again from the paper."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def philox(counter: list[int], key: list[int]) -> list[int]:
    """Philox 4x32-10 from the paper (Salmon et al., SC11)."""
    c, k = list(counter), list(key)
    for _ in range(10):
        a, b = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
        c = [(b >> 32) ^ c[1] ^ k[0], b & 0xFFFFFFFF, (a >> 32) ^ c[3] ^ k[1], a & 0xFFFFFFFF]
        k = [(k[0] + 0x9E3779B9) & 0xFFFFFFFF, (k[1] + 0xBB67AE85) & 0xFFFFFFFF]
    return c


def words(stream: int, first: int, count: int, seed: int, *, episode: int = 0, member: int = 0) -> list[NDArray]:
    """Four random words of each of consecutive draws of a drone, 4 x (count,)."""
    index = (np.arange(count, dtype=np.uint64) + np.uint64(first)) & np.uint64(0xFFFFFFFF)
    return philox([index, stream, episode, member << 12], [seed, 0])


def normals(radius: NDArray, angle: NDArray) -> NDArray:
    """Standard normal numbers of pairs of words, (2 count,), by Box and Muller."""
    length = np.sqrt(-2 * np.log(((radius >> np.uint64(1)).astype(float) + 1) / 2**31))
    turn = 2 * np.pi * angle / 2**32
    return np.stack([length * np.cos(turn), length * np.sin(turn)], 1).ravel()


def uniform_pairs(one: NDArray, other: NDArray) -> NDArray:
    """Numbers in [0, 1) of pairs of words, (2 count,)."""
    return np.stack([one >> np.uint64(8), other >> np.uint64(8)], 1).ravel() / 2**24


def named_stream(name: str) -> int:
    """The stream of an instrument: a hash of its name, FNV-1a."""
    value = 2166136261
    for byte in name.encode():
        value = (value ^ byte) * 16777619 & 0xFFFFFFFF
    return value | 0x80000000


def uniforms(seed: int, episode: int, stream: int, index: int, member: int = 0) -> list[float]:
    """Four numbers in [0, 1) of a drone: of its env's seed and episode, and of its place in the env."""
    words = philox(
        [index, stream, episode & 0xFFFFFFFF, (episode >> 32) ^ (member << 12)], [seed & 0xFFFFFFFF, seed >> 32]
    )
    return [(word >> 8) / 2**24 for word in words]


def uniform(seed: int, episode: int, stream: int, index: int, member: int = 0) -> float:
    """The first of these numbers."""
    return uniforms(seed, episode, stream, index, member)[0]
