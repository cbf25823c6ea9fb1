# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a noisy image is from a reference: the figures that the add-on shows and the documentation quotes.

The efficiency is that of J. Arvo and D. Kirk, "Particle Transport and Image Synthesis" (SIGGRAPH 1990): the
inverse of variance times time.
"""

from __future__ import annotations

import math

import numpy as np

TRIMMED_SHARE = 0.001
RELMSE_FLOOR = 0.01


def error_figures(image: np.ndarray, half_a: np.ndarray, half_b: np.ndarray) -> dict[str, float]:
    """Error of image (H,W,3) linear against the reference R = (half_a + half_b) / 2, two independent renders.

    With d = image - R per pixel and channel and m = mean(R):

    rmse        sqrt(mean d^2), in units of radiance
    nrmse       rmse / m
    relmse      mean of d^2 / (R^2 + 0.01 m^2)
    nrmse_tc    nrmse without the 0.1 % of pixels that are worst (t: trimmed, as single fireflies rule the
                plain figure) and less the reference's own expected squared error, (half_a - half_b)^2 / 4
                (c: corrected)
    relmse_tc   relmse trimmed and corrected in the same way, each pixel by its own error
    mean_difference   mean(d) / m; what is left of it as samples grow is bias

    Raises ValueError if the shapes differ or the reference is black.
    """
    if half_a.shape != half_b.shape:
        raise ValueError(f"The reference's halves differ in shape: {half_a.shape}, {half_b.shape}")
    if image.shape != half_a.shape:
        raise ValueError(
            f"The image has shape {image.shape}, its reference {half_a.shape}: render both alike"
        )
    half_a, half_b = (half.astype(np.float64) for half in (half_a, half_b))
    reference = (half_a + half_b) / 2
    mean = float(reference.mean())
    if not mean > 0:
        raise ValueError("The reference is black: no relative error can be given; light the scene")
    difference = image - reference
    squared = difference**2
    own_squared = (half_a - half_b) ** 2 / 4
    own = own_squared.mean(axis=2).ravel()
    per_pixel = squared.mean(axis=2).ravel()
    scale = reference**2 + RELMSE_FLOOR * mean**2
    relative = ((squared - own_squared) / scale).mean(axis=2).ravel()
    kept = per_pixel.size - math.ceil(TRIMMED_SHARE * per_pixel.size)
    best = np.argpartition(per_pixel, kept)[:kept]
    corrected = max(per_pixel[best].mean() - own[best].mean(), 0.0) if kept else 0.0
    rmse = float(np.sqrt(squared.mean()))
    return {
        "rmse": rmse,
        "nrmse": rmse / mean,
        "relmse": float((squared / scale).mean()),
        "relmse_tc": max(float(relative[best].mean()), 0.0) if kept else 0.0,
        "nrmse_tc": math.sqrt(corrected) / mean,
        "mean_difference": float(difference.mean()) / mean,
    }


def efficiency(nrmse_tc: float, seconds: float) -> float | None:
    """1 / (relative variance x seconds), per second; None where the error is below what the reference can
    tell."""
    cost = nrmse_tc**2 * seconds
    return 1.0 / cost if cost > 0 else None
