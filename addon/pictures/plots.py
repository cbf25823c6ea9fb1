# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures of a map and of the kd-tree that samples it, as numpy images.

After M. Ergun, M. Kurt, A. Ozturk, "Real-time Kd-tree Based Importance Sampling of Environment Maps" (SCCG
2012): the blocks over the map, the map rebuilt from its blocks (Figure 1), the empirical and the fitted pdf
(Figure 2). Maps are (H,W,3) linear, row 0 at the top; pictures are (h,w,3) float32 in sRGB display space
[0,1], row 0 at the top.
"""

from __future__ import annotations

import numpy as np

from ..compare.metrics import usable_radiance
from . import raster

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
KEY = 0.3
STOPS = 16  # of the false-colour scale, even
PAPER, INK, GRID = (0.11, 0.11, 0.12), (0.82, 0.82, 0.84), (0.24, 0.24, 0.26)
EMPIRICAL, FITTED, BORDER = (0.95, 0.45, 0.25), (0.35, 0.70, 1.00), (1.00, 0.85, 0.20)

# Viridis (S. van der Walt, N. Smith 2015, CC0), each sixteenth colour: even in lightness, legible without
# colour vision.
VIRIDIS = np.array([
    (0.267, 0.005, 0.329), (0.283, 0.100, 0.422), (0.277, 0.185, 0.490), (0.254, 0.265, 0.530),
    (0.222, 0.339, 0.549), (0.191, 0.407, 0.556), (0.164, 0.471, 0.558), (0.139, 0.534, 0.555),
    (0.121, 0.596, 0.544), (0.135, 0.659, 0.518), (0.208, 0.719, 0.473), (0.328, 0.774, 0.407),
    (0.478, 0.821, 0.318), (0.647, 0.858, 0.210), (0.825, 0.885, 0.106), (0.993, 0.906, 0.144),
], np.float32)  # fmt: skip


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    linear = np.clip(np.nan_to_num(linear, posinf=1.0), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055).astype(
        np.float32
    )


def exposure_for(image: np.ndarray) -> float:
    """The factor that brings the log-average luminance to KEY (E. Reinhard et al. 2002)."""
    luminance = np.maximum(image @ LUMINANCE, 0.0)
    mean = float(luminance.mean())
    return KEY / float(np.exp(np.log(luminance + 1e-4 * mean).mean())) if mean > 0 else 1.0


def tone_map(image: np.ndarray, exposure: float) -> np.ndarray:
    """Exposure, extended Reinhard per channel (white at 4), the sRGB curve."""
    x = np.maximum(np.nan_to_num(image), 0.0) * exposure
    return encode_srgb(x * (1 + x / 16) / (1 + x))


def colormap(t: np.ndarray) -> np.ndarray:
    """(...) in [0,1] -> (...,3): viridis."""
    at = np.clip(t, 0.0, 1.0) * (len(VIRIDIS) - 1)
    low = np.minimum(at.astype(np.int64), len(VIRIDIS) - 2)
    fraction = (at - low)[..., None].astype(np.float32)
    return VIRIDIS[low] * (1 - fraction) + VIRIDIS[low + 1] * fraction


def map_picture(image: np.ndarray, height: int, width: int, exposure: float | None = None) -> np.ndarray:
    small = raster.resize(usable_radiance(image), height, width)
    return tone_map(small, exposure or exposure_for(small))


def blocks_picture(image: np.ndarray, bounds: np.ndarray, height: int, width: int) -> np.ndarray:
    """The map with the borders of its blocks, bounds (n,4) = x0, y0, x1, y1 in texels."""
    picture = map_picture(image, height, width)
    mask = np.zeros((height, width), np.float32)
    scale = np.array([width / image.shape[1], height / image.shape[0]] * 2)
    raster.rectangle_borders(mask, bounds * scale)
    weight = 0.6 * mask[..., None]
    return picture * (1 - weight) + weight * np.array(BORDER, np.float32)


def rebuilt_picture(image: np.ndarray, reconstruction: np.ndarray, height: int, width: int) -> np.ndarray:
    """The map as its blocks alone tell it, shown with the exposure of the map itself."""
    exposure = exposure_for(raster.resize(usable_radiance(image), height, width))
    return map_picture(reconstruction, height, width, exposure)


def exposure_picture(image: np.ndarray, height: int, width: int) -> np.ndarray:
    """The map in false colours, one a stop about its median; below, the shares of the sphere (grey) and of
    the light (orange) that each stop has. A sun keeps its colour however small: of several texels the
    brightest counts."""
    map_height = width // 2
    luminance = np.maximum(usable_radiance(image) @ LUMINANCE, 0.0)
    positive = luminance[luminance > 0]
    middle = np.log2(np.median(positive)) if positive.size else 0.0
    small = _maximum(_maximum(luminance, map_height, axis=0), width, axis=1)
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = PAPER
    picture[:map_height] = colormap((_stop(small, middle) + STOPS / 2 + 0.5) / STOPS)
    _draw_histogram(picture, luminance, middle, map_height)
    return picture


def _stop(luminance: np.ndarray, middle: float) -> np.ndarray:
    """Whole stops from the middle, -STOPS/2 ... STOPS/2 - 1, the last ones open to their side."""
    stops = np.floor(np.log2(np.maximum(luminance, 1e-30)) - middle)
    return np.clip(stops, -STOPS // 2, STOPS // 2 - 1)


def _draw_histogram(picture: np.ndarray, luminance: np.ndarray, middle: float, top: int) -> None:
    height, width = picture.shape[:2]
    base, scale = height - 36, height - 36 - top - 12
    rows = np.cos(np.linspace(0.0, np.pi, luminance.shape[0] + 1))
    solid_angle = np.broadcast_to((rows[:-1] - rows[1:])[:, None], luminance.shape)
    stop = (_stop(luminance, middle) + STOPS // 2).astype(np.int64).ravel()
    shares = [
        np.bincount(stop, weight.ravel(), STOPS) / max(float(weight.sum()), 1e-30)
        for weight in (solid_angle, solid_angle * luminance)
    ]
    for index in range(STOPS):
        left, right = index * width // STOPS, (index + 1) * width // STOPS
        picture[base + 4 : base + 14, left:right] = colormap(np.array((index + 0.5) / STOPS))
        raster.text(picture, left + 2, base + 20, f"{index - STOPS // 2:+d}", INK)
        bar = (right - left) // 3
        for share, offset, color in zip(
            (s[index] for s in shares), (bar // 2, bar // 2 + bar), (INK, EMPIRICAL), strict=True
        ):
            picture[base - round(scale * share) : base, left + offset : left + offset + bar] = color


def _maximum(values: np.ndarray, count: int, axis: int) -> np.ndarray:
    """Resized to `count` along an axis; where texels are merged the largest stays."""
    length = values.shape[axis]
    starts = np.arange(count) * length // count
    if count >= length:
        return np.take(values, starts, axis=axis)
    return np.maximum.reduceat(values, starts, axis=axis)


def fitted_probabilities(alpha: float, count: int) -> np.ndarray:
    """The paper's p(x) = 1 / (log(1 + n/alpha)(alpha + x)), integrated over each index 0 ... count-1."""
    i = np.arange(count)
    return np.log1p(1.0 / (alpha + i)) / np.log1p(count / alpha)


def pdf_picture(empirical: np.ndarray, alpha: float, height: int, width: int) -> np.ndarray:
    """Figure 2 on logarithmic axes: block probabilities in descending order (dots) and the fitted model
    (line)."""
    fitted = fitted_probabilities(alpha, len(empirical))
    index = np.arange(len(empirical)) + 1.0
    positive = empirical[empirical > 0]
    top = np.ceil(np.log10(max(fitted.max(), empirical.max())))
    bottom = np.floor(np.log10(min(fitted.min(), max(positive.min(), 1e-9)))) if positive.size else top - 6
    picture, to_x, to_y = _axes(height, width, (0.0, max(np.log10(len(empirical)), 1.0)), (bottom, top))
    shown = empirical > 10.0**bottom
    raster.points(picture, to_x(np.log10(index[shown])), to_y(np.log10(empirical[shown])), EMPIRICAL, size=3)
    raster.curve(picture, to_x(np.log10(index)), to_y(np.log10(fitted)), FITTED, size=2)
    return picture


def _axes(height: int, width: int, x_range: tuple[float, float], y_range: tuple[float, float]):
    """A picture with a grid at powers of ten, and the maps from exponents to pixels."""
    left, right, above, below = 44, 10, 10, 26
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = PAPER

    def to_x(value):
        return left + (np.asarray(value) - x_range[0]) / (x_range[1] - x_range[0]) * (width - left - right)

    def to_y(value):
        return (
            height
            - below
            - (np.asarray(value) - y_range[0]) / (y_range[1] - y_range[0]) * (height - above - below)
        )

    for decade in range(int(np.ceil(x_range[0])), int(np.floor(x_range[1])) + 1):
        picture[above : height - below, int(to_x(decade))] = GRID
        label = f"1e{decade}"
        raster.text(
            picture,
            min(int(to_x(decade)) - 6, width - raster.text_width(label)),
            height - below + 8,
            label,
            INK,
        )
    for decade in range(int(y_range[0]), int(y_range[1]) + 1):
        picture[min(int(to_y(decade)), height - 1), left : width - right] = GRID
        raster.text(picture, 4, int(to_y(decade)) - 5, f"1e{decade}", INK)
    return picture, to_x, to_y
