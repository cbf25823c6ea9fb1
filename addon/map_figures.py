# SPDX-License-Identifier: GPL-3.0-or-later
"""What a lat-long map is like to light with: texels that cannot be used, a sun that was cut off, evenness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
# Larger maps are judged by every n-th row and column; clipping and bad texels are looked for everywhere.
JUDGED_TEXELS = 1 << 20
# That many texels that share the largest value exactly, far above the mean, are a limit and no sun.
CLIPPED_TEXELS = 4
CLIPPED_CONTRAST = 16.0
# Share of the mean.
RINGING = 0.01
# Below this importance sampling of the map saves less than a tenth of the samples.
SMOOTH_GAIN = 1.1


@dataclass(frozen=True)
class MapFigures:
    bad_texels: int  # NaN, infinite or clearly negative in a channel
    largest: float
    clipped_texels: int  # texels at `largest`, if that looks like the limit of a format; else 0
    gain: float  # second moment of a sample by uniform directions over that by the map's own density

    @property
    def is_smooth(self) -> bool:
        return self.gain < SMOOTH_GAIN


def map_figures(image: np.ndarray) -> MapFigures:
    """`image`: (height, width, 3) float32, row 0 at the top.

    The gain compares second moments of one-sample estimates of the light from all directions, with L the
    luminance: uniform directions have 4 pi * integral of L^2, the map's own density has (integral of L)^2."""
    usable = (image >= 0.0) & (image <= np.finfo(np.float32).max)
    clean = image if usable.all() else np.where(usable, image, 0.0)
    brightest = clean.max(axis=2)
    largest = float(brightest.max())

    step = max(int(np.sqrt(brightest.size / JUDGED_TEXELS)), 1)
    rows = np.arange(0, image.shape[0], step)
    luminance = (clean[rows, ::step] @ LUMINANCE).astype(np.float64)
    weight = np.sin((rows + 0.5) * (np.pi / image.shape[0]))[:, None] / luminance.shape[1]
    weight = weight / (weight.sum() * luminance.shape[1])
    mean = float((luminance * weight).sum())
    gain = float((luminance**2 * weight).sum()) / mean**2 if mean > 0.0 else 1.0

    # Ringing of a filter or a codec, or a saturated light's colour out of gamut, leaves values just below
    # zero, which nobody needs to repair.
    floor = -RINGING * np.maximum(brightest, mean)
    passable = usable | ((image < 0.0) & (image > floor[..., None]))
    bad = int(np.count_nonzero(~passable.all(axis=2)))

    at_limit = int(np.count_nonzero(brightest == largest))
    is_clipped = at_limit >= CLIPPED_TEXELS and largest > CLIPPED_CONTRAST * mean > 0.0
    return MapFigures(bad, largest, at_limit if is_clipped else 0, gain)


def repaired(image: np.ndarray) -> np.ndarray:
    """The map with bad texels replaced by the mean of their good neighbours, zero where there is none.

    A value below zero in a texel that shines all the same becomes zero: its neighbours are no measure of a
    sun."""
    finite = (np.abs(image) <= np.finfo(np.float32).max).all(axis=2)
    clean = np.where(finite[..., None], np.maximum(image, 0.0), 0.0).astype(np.float32)
    good = finite & (image.min(axis=2) >= -clean.max(axis=2))
    for y, x in np.argwhere(~good):
        rows = np.clip(np.arange(y - 1, y + 2), 0, image.shape[0] - 1)
        columns = np.arange(x - 1, x + 2) % image.shape[1]
        near = np.ix_(rows, columns)
        clean[y, x] = clean[near][good[near]].mean(axis=0) if good[near].any() else 0.0
    return clean
