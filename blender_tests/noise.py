# SPDX-License-Identifier: GPL-3.0-or-later
"""Comparison of noisy pictures: what differs by more than the noise of both explains."""

import numpy as np

REGION = 8  # pixels


def mean_and_variance(pictures: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean of independent renders of a scene, and the variance of that mean, per region and channel."""
    regions = np.stack([to_regions(picture[..., :3].astype(np.float64)) for picture in pictures])
    return regions.mean(axis=0), regions.var(axis=0, ddof=1) / len(pictures)


def to_regions(picture: np.ndarray) -> np.ndarray:
    height, width = (size // REGION * REGION for size in picture.shape[:2])
    blocks = picture[:height, :width].reshape(height // REGION, REGION, width // REGION, REGION, -1)
    return blocks.mean(axis=(1, 3))


def assert_agree(ours: list[np.ndarray], theirs: list[np.ndarray], mean_tolerance: float = 0.01):
    """Image means within `mean_tolerance` and their own noise; regions within noise.

    The variance of a region is known from few renders only, so that of its neighbours is taken along. With
    that, one region in a thousand may pass 5 standard deviations, none 10; 1 % is left for the filters' and
    the meshes' differences."""
    a, var_a = mean_and_variance(ours)
    b, var_b = mean_and_variance(theirs)
    assert b.mean() > 0.0
    noise = np.hypot(standard_error(ours), standard_error(theirs))
    assert abs(a.mean() - b.mean()) <= mean_tolerance * b.mean() + 3.0 * noise, (
        f"means {a.mean():.6g} and {b.mean():.6g}, standard error {noise:.2g}"
    )
    deviation = np.sqrt(smooth(var_a) + smooth(var_b)) + 0.01 * b / 5.0
    score = np.abs(a - b) / deviation
    worst = np.unravel_index(score.argmax(), score.shape)
    text = f"region {worst}: {a[worst]:.5g} and {b[worst]:.5g}, {score.max():.1f} standard deviations"
    assert np.mean(score > 5.0) <= 0.01, f"{np.mean(score > 5.0):.2%} of the regions differ; {text}"
    assert score.max() <= 10.0, text


def standard_error(pictures: list[np.ndarray]) -> float:
    """Of the mean over the renders' image means, whose pixels need not be independent."""
    return float(np.std([picture[..., :3].mean() for picture in pictures], ddof=1) / np.sqrt(len(pictures)))


def smooth(variance: np.ndarray) -> np.ndarray:
    """The larger of a region's variance and the mean over it and its eight neighbours."""
    padded = np.pad(variance, ((1, 1), (1, 1), (0, 0)), mode="edge")
    height, width = variance.shape[:2]
    shifted = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.maximum(np.mean(shifted, axis=0), variance)
