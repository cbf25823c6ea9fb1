# SPDX-License-Identifier: GPL-3.0-or-later
"""What the demo measures with skytree_core alone, without Blender: tables, fit, build times and time per
sample."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import skytree_core

KDTREE = {"split_criterion": "MIN_VARIANCE", "block_probability": "MIN_VARIANCE"}
PAPER = {"split_criterion": "SSE", "block_probability": "FITTED"}


def build_all(image: np.ndarray, block_count: int) -> dict[str, object]:
    """The samplers that the demo compares, by name, for a map (H,W,3)."""
    return {
        "kdtree": skytree_core.KdTreeSampler(image, block_count, **KDTREE),
        "kdtree_paper": skytree_core.KdTreeSampler(image, block_count, **PAPER),
        "inversion": skytree_core.InversionSampler(image),
        "inversion_binary": skytree_core.InversionSampler(image, method="binary"),
        "uniform": skytree_core.UniformSampler(),
    }


def build_times(image: np.ndarray, block_count: int, rounds: int = 5) -> dict[str, float]:
    """Fastest of several builds of each sampler in seconds of processor time, in rounds that interleave
    them."""
    makers = {
        "kdtree": lambda: skytree_core.KdTreeSampler(image, block_count, **KDTREE),
        "kdtree_paper": lambda: skytree_core.KdTreeSampler(image, block_count, **PAPER),
        "inversion": lambda: skytree_core.InversionSampler(image),
        "inversion_binary": lambda: skytree_core.InversionSampler(image, method="binary"),
    }
    return _fastest(makers, rounds)


def sample_times(
    samplers: dict[str, object], seed: int, rounds: int = 9, count: int = 1 << 18
) -> dict[str, float]:
    """Nanoseconds of processor time for one direction with its pdf: fastest of several interleaved rounds.

    Every call gets the same random numbers, in random order as a renderer would have them. Checking the array
    and writing the results is part of it; "uniform" has little else and tells how much that is.
    """
    u = np.random.default_rng(seed).random((count, 3), dtype=np.float32)
    calls = {name: (lambda s=sampler: s.sample(u)) for name, sampler in samplers.items()}
    return {name: 1e9 * seconds / count for name, seconds in _fastest(calls, rounds).items()}


def _fastest(calls: dict[str, Callable], rounds: int) -> dict[str, float]:
    best = dict.fromkeys(calls, float("inf"))
    for _ in range(rounds):
        for name, call in calls.items():
            started = time.process_time()
            call()
            best[name] = min(best[name], time.process_time() - started)
    return best


def brightest_azimuth(image: np.ndarray) -> float:
    """Azimuth in radians, as Blender shows the map, of the 20 degrees of longitude that hold the most
    power."""
    height, width = image.shape[:2]
    solid_angle = np.sin((np.arange(height) + 0.5) * np.pi / height)
    finite = np.clip(np.nan_to_num(image, nan=0, posinf=0, neginf=0), 0, None)
    power = (finite.sum(axis=2, dtype=np.float64) * solid_angle[:, None]).sum(axis=0)
    reach = max(1, round(width * 10 / 360))
    around = np.concatenate([power[-reach:], power, power[:reach]])
    column = int(np.argmax(np.convolve(around, np.ones(2 * reach + 1), mode="valid")))
    return float(np.pi - 2 * np.pi * (column + 0.5) / width)
