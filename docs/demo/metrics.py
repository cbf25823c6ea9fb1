# SPDX-License-Identifier: GPL-3.0-or-later
"""How far a noisy image is from a reference, by the figures that the documentation quotes."""

from __future__ import annotations

import numpy as np

TRIMMED_SHARE = 0.001


def error_figures(image: np.ndarray, half_a: np.ndarray, half_b: np.ndarray) -> dict[str, float]:
    """Error of image (H,W,3) linear against the reference R = (half_a + half_b) / 2, two independent renders.

    With d = image - R per pixel and channel and m = mean(R):

    rmse        sqrt(mean d^2), in units of radiance
    nrmse       rmse / m
    relmse      mean of d^2 / (R^2 + 0.01 m^2)
    nrmse_tc    nrmse without the 0.1 % of pixels that are worst (t: trimmed; fireflies on mirrors rule the
    plain
                figure) and with the reference's own expected squared error, (half_a - half_b)^2 / 4,
                subtracted (c: corrected)
    relmse_tc   relmse trimmed and corrected in the same way, each pixel by its own error
    mean_difference   mean(d) / m; what is left of it as samples grow is bias
    """
    if image.shape != half_a.shape or image.shape != half_b.shape:
        raise ValueError(f"images differ in shape: {image.shape}, {half_a.shape}, {half_b.shape}")
    image, half_a, half_b = (a.astype(np.float64) for a in (image, half_a, half_b))
    reference = (half_a + half_b) / 2
    mean = reference.mean()
    if not mean > 0:
        raise ValueError("the reference is black: no relative error can be given")
    squared = (image - reference) ** 2
    rmse = np.sqrt(squared.mean())

    own_squared = (half_a - half_b) ** 2 / 4
    scale = reference**2 + 0.01 * mean**2
    own = own_squared.mean(axis=2).reshape(-1)
    per_pixel = squared.mean(axis=2).reshape(-1)
    relative = ((squared - own_squared) / scale).mean(axis=2).reshape(-1)
    worst = int(np.ceil(TRIMMED_SHARE * per_pixel.size))
    kept = np.argsort(per_pixel, kind="stable")[: per_pixel.size - worst]
    corrected = max(per_pixel[kept].mean() - own[kept].mean(), 0.0)
    return {
        "rmse": float(rmse),
        "nrmse": float(rmse / mean),
        "relmse": float((squared / scale).mean()),
        "relmse_tc": float(max(relative[kept].mean(), 0.0)),
        "nrmse_tc": float(np.sqrt(corrected) / mean),
        "mean_difference": float((image - reference).mean() / mean),
    }
