# SPDX-License-Identifier: GPL-3.0-or-later
"""Ways of the related work to use any sampler, in numpy: for figures and teaching (docs/related.md)."""

import math
from collections.abc import Callable

import numpy as np


def stratified(count: int, seed: int = 0) -> np.ndarray:
    """Random numbers for sample(): (count, 3) float32 in [0, 1), stratified where independent numbers clump.

    count: a square number n*n. u[:, 0] has one number in each of count equal intervals, so that each block
    of a kd-tree gets its share of samples to within one (Arvo 2001: strata of any shape by a map that keeps
    areas); (u[:, 1], u[:, 2]) has one point in each cell of an n x n grid. Which number meets which point is
    shuffled. ValueError if count is no square.
    """
    side = math.isqrt(max(count, 0))
    if side * side != count or count < 1:
        raise ValueError(f"count is {count}; stratified() needs a square number, such as {(side + 1) ** 2}")
    generator = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), axis=-1).reshape(-1, 2)
    u = np.empty((count, 3))
    u[:, 0] = (generator.permutation(count) + generator.random(count)) / count
    u[:, 1:] = (cells + generator.random((count, 2))) / side
    return np.minimum(u.astype(np.float32), np.float32(1 - 2**-24))


def resampled(
    sampler, target: Callable[[np.ndarray], np.ndarray], u: np.ndarray, choice: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Directions in proportion to a product, by choosing among candidates (Burke et al. 2005, in the
    unbiased form of Talbot et al. 2005).

    sampler: draws the candidates. target: (n, 3) unit directions -> (n,) values >= 0, such as BSDF times
    luminance. u: (count, candidates, 3) numbers for sample(); choice: (count,) independent ones in [0, 1).

    Returns (directions (count, 3), weights (count,)): the mean of f(direction) * weight is the integral of f
    over the sphere for any f that is 0 where target is. There is no density to return: it would be an
    integral over all candidates.
    """
    count, candidates = u.shape[:2]
    directions, pdf = sampler.sample(u.reshape(-1, 3))
    value = np.asarray(target(directions), np.float64).reshape(count, candidates)
    weight = np.where(value > 0, value / pdf.reshape(count, candidates), 0.0)
    cumulative = np.cumsum(weight, axis=1)
    total = cumulative[:, -1]
    chosen = np.minimum((cumulative <= (choice * total)[:, None]).sum(axis=1), candidates - 1)
    rows = np.arange(count)
    kept = value[rows, chosen]
    with np.errstate(divide="ignore", invalid="ignore"):
        result = np.where(total > 0, total / (candidates * kept), 0.0)
    return directions.reshape(count, candidates, 3)[rows, chosen], result
