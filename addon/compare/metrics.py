# SPDX-License-Identifier: GPL-3.0-or-later
"""How far an image is from a reference, and how well a sampler fits its map."""

from __future__ import annotations

import importlib
import threading
from dataclasses import dataclass

import numpy as np

from .. import latlong, native

# About 10 ms of work: whoever stops it wants the processor.
POINTS_PER_CHUNK = 1 << 16


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
    """skytree_core.metrics.error_figures of an image (H,W,3), linear. Raises ValueError if the shapes differ
    or the reference is black."""
    return _metrics().error_figures(image, reference.half_a, reference.half_b)


def efficiency(nrmse_tc: float, seconds: float) -> float | None:
    """1 / (relative variance x seconds), or None; see skytree_core.metrics.efficiency."""
    return _metrics().efficiency(nrmse_tc, seconds)


def _metrics():
    native.core()  # finds the package in Blender versions that know no wheels
    return importlib.import_module("skytree_core.metrics")


class StoppedError(Exception):
    """Somebody asked to stop; nothing is wrong."""


def sampler_figures(
    sampler, image: np.ndarray, points: int = 2, stop: threading.Event | None = None
) -> dict[str, float] | None:
    """How well a sampler's pdf fits the bilinearly interpolated map (H,W,3), at points x points places in
    each texel; None for a black map. Raises StoppedError soon after `stop` is set.

    With w = L/pdf (mean of the channels) and m = the integral of L over the sphere, its expectation:

    largest_weight    max w / m: 1 for a perfect sampler; the brightest firefly that a light sample can be
    sample_variance   (integral of w L) / m^2 - 1: relative variance of one light sample, unoccluded
    """
    image = usable_radiance(image, stop)
    height, width = points * image.shape[0], points * image.shape[1]
    edges = np.cos(np.linspace(0.0, np.pi, height + 1))
    solid_angle = (edges[:-1] - edges[1:]) * (2.0 * np.pi / width)
    u = (np.arange(width) + 0.5) / width
    total = second_moment = largest = 0.0
    for rows in _chunks(height, width, stop):
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


def usable_radiance(image: np.ndarray, stop: threading.Event | None = None) -> np.ndarray:
    """The image with texels that are no radiance (NaN, Inf, negative) black, as the samplers' statistics
    have it. Raises StoppedError as sampler_figures does."""

    def usable(part):
        return np.isfinite(part) & (part >= 0)

    if all(usable(image[rows]).all() for rows in _chunks(*image.shape[:2], stop)):
        return image
    return np.where(usable(image), image, 0.0).astype(image.dtype)


def _chunks(height: int, width: int, stop: threading.Event | None):
    """The rows of an image in parts; raises StoppedError between two once `stop` is set."""
    count = max(POINTS_PER_CHUNK // width, 1)
    for start in range(0, height, count):
        if stop is not None and stop.is_set():
            raise StoppedError
        yield slice(start, min(start + count, height))
