# SPDX-License-Identifier: GPL-3.0-or-later
"""How far an image is from a reference, and how well a sampler fits its map; numpy alone.

nRMSE_tc and relMSE are defined as in docs/benchmarks.md; the efficiency is that of J. Arvo and D. Kirk,
"Particle Transport and Image Synthesis" (SIGGRAPH 1990): the inverse of variance times time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .. import latlong

TRIMMED_SHARE = 0.001
RELMSE_FLOOR = 0.01
ROWS_PER_CHUNK = 64


@dataclass(frozen=True)
class Reference:
    """Two independent renders (H,W,3) of the same image, linear; their mean is the reference."""

    half_a: np.ndarray
    half_b: np.ndarray

    def __post_init__(self):
        if self.half_a.shape != self.half_b.shape:
            raise ValueError(
                f"The reference's halves differ in shape: {self.half_a.shape}, {self.half_b.shape}"
            )

    @property
    def image(self) -> np.ndarray:
        """(H,W,3) float32"""
        return ((self.half_a.astype(np.float64) + self.half_b) / 2).astype(np.float32)


def error_figures(image: np.ndarray, reference: Reference) -> dict[str, float]:
    """Error of an image (H,W,3), linear. With d = image - R per pixel and channel and m = mean(R):

    rmse        sqrt(mean d^2), in units of radiance
    relmse      mean of d^2 / (R^2 + 0.01 m^2)
    nrmse_tc    sqrt(mean d^2) / m without the worst 0.1 % of pixels (t: trimmed, as single fireflies rule the
                plain figure) and less the reference's own expected squared error, (half_a - half_b)^2 / 4
                (c: corrected)
    mean_difference   mean(d) / m: what is left of it as samples grow is bias

    Raises ValueError if the shapes differ or the reference is black.
    """
    if image.shape != reference.half_a.shape:
        raise ValueError(
            f"The image is {image.shape}, its reference {reference.half_a.shape}: render both alike"
        )
    half_a, half_b = (half.astype(np.float64) for half in (reference.half_a, reference.half_b))
    truth = (half_a + half_b) / 2
    mean = float(truth.mean())
    if not mean > 0:
        raise ValueError("The reference is black: no relative error can be given; light the scene")
    difference = image - truth
    squared = difference**2
    own = ((half_a - half_b) ** 2 / 4).mean(axis=2).ravel()
    per_pixel = squared.mean(axis=2).ravel()
    kept = per_pixel.size - math.ceil(TRIMMED_SHARE * per_pixel.size)
    best = np.argpartition(per_pixel, kept)[:kept]
    corrected = max(per_pixel[best].mean() - own[best].mean(), 0.0) if kept else 0.0
    return {
        "rmse": float(np.sqrt(squared.mean())),
        "relmse": float((squared / (truth**2 + RELMSE_FLOOR * mean**2)).mean()),
        "nrmse_tc": math.sqrt(corrected) / mean,
        "mean_difference": float(difference.mean()) / mean,
    }


def efficiency(nrmse_tc: float, seconds: float) -> float | None:
    """1 / (relative variance x seconds), per second; None where the error is below what the reference can
    tell."""
    cost = nrmse_tc**2 * seconds
    return 1.0 / cost if cost > 0 else None


def sampler_figures(sampler, image: np.ndarray, points: int = 2) -> dict[str, float] | None:
    """How well a sampler's pdf fits the bilinearly interpolated map (H,W,3), at points x points places in
    each texel; None for a black map.

    With w = L/pdf (mean of the channels) and m = the integral of L over the sphere, its expectation:

    largest_weight    max w / m: 1 for a perfect sampler; the brightest firefly that a light sample can be
    sample_variance   (integral of w L) / m^2 - 1: relative variance of one light sample, unoccluded
    """
    image = usable_radiance(image)
    height, width = points * image.shape[0], points * image.shape[1]
    edges = np.cos(np.linspace(0.0, np.pi, height + 1))
    solid_angle = (edges[:-1] - edges[1:]) * (2.0 * np.pi / width)
    u = (np.arange(width) + 0.5) / width
    total = second_moment = largest = 0.0
    for start in range(0, height, ROWS_PER_CHUNK):
        rows = slice(start, min(start + ROWS_PER_CHUNK, height))
        v = (np.arange(height)[rows, None] + 0.5) / height
        radiance = latlong.lookup(image, *np.broadcast_arrays(u, v)).mean(axis=2, dtype=np.float64)
        directions = latlong.texel_directions(height, width, rows).reshape(-1, 3)
        pdf = sampler.pdf(np.ascontiguousarray(directions, np.float32)).reshape(radiance.shape)
        weight = np.divide(radiance, pdf, out=np.full_like(radiance, np.inf), where=pdf > 0)
        weight[radiance == 0] = 0.0
        total += (radiance.sum(axis=1) * solid_angle[rows]).sum()
        second_moment += ((radiance * weight).sum(axis=1) * solid_angle[rows]).sum()
        largest = max(largest, float(weight.max()))
    if not total > 0:
        return None
    return {"largest_weight": largest / total, "sample_variance": float(second_moment / total**2 - 1.0)}


def usable_radiance(image: np.ndarray) -> np.ndarray:
    """The image with texels that are no radiance (NaN, Inf, negative) black, as the samplers' statistics
    have it."""
    usable = np.isfinite(image) & (image >= 0)
    return image if usable.all() else np.where(usable, image, 0.0).astype(image.dtype)
