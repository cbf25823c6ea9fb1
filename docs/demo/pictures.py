# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo's pictures: view transform, labelled comparison sheet, blocks over the map, pdf plot.

Images are (H,W,3) linear float, top row first; pictures are PIL images.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

matplotlib.use("Agg")
import matplotlib.pyplot as plt

VIEW_TRANSFORM = "exposure, a filmic curve per channel (Narkowicz 2016, his fit of ACES), then the sRGB curve"
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
INK, PAPER, SOFT = (28, 28, 30), (255, 255, 255), (110, 110, 116)
GAP = 12


def exposure_for(image: np.ndarray, key: float = 0.16) -> float:
    """The factor that brings the log-average luminance to key (Reinhard et al. 2002)."""
    luminance = np.maximum(image @ LUMINANCE, 0)
    return float(key / np.exp(np.log(luminance + 1e-4).mean()))


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear [0,1] to sRGB bytes."""
    linear = np.clip(linear, 0, 1)
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (255 * curve + 0.5).astype(np.uint8)


def view(image: np.ndarray, exposure: float) -> Image.Image:
    """The image as one looks at it; see VIEW_TRANSFORM."""
    x = np.maximum(np.nan_to_num(image.astype(np.float64)), 0) * exposure
    return Image.fromarray(encode_srgb(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)))


def difference(image: np.ndarray, reference: np.ndarray, exposure: float, factor: float) -> Image.Image:
    """factor * |image - reference| at the given exposure, sRGB curve alone, white where it clips."""
    return Image.fromarray(encode_srgb(np.abs(image.astype(np.float64) - reference) * exposure * factor))


def difference_factor(reference: np.ndarray, images: Iterable[np.ndarray], exposure: float) -> float:
    """The power of two, at least 1, that brings the typical difference of the worst image to a visible
    grey."""
    typical = max(float(np.abs(image - reference).mean()) for image in images) * exposure
    return float(2 ** max(0, round(math.log2(0.15 / max(typical, 1e-9)))))


def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """DejaVu Sans as matplotlib ships it: a bare machine has no fonts."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


@dataclass(frozen=True)
class Column:
    """One column of the comparison sheet."""

    title: str
    notes: list[str]
    image: np.ndarray


@dataclass(frozen=True)
class Crop:
    """A part of the image, in fractions of its width and height."""

    title: str
    left: float
    top: float
    right: float
    bottom: float

    def box(self, width: int, height: int) -> tuple[int, int, int, int]:
        return (
            round(self.left * width),
            round(self.top * height),
            round(self.right * width),
            round(self.bottom * height),
        )


def sheet(
    title: str, columns: list[Column], crops: list[Crop], exposure: float, factor: float
) -> Image.Image:
    """Side by side as the paper's Figures 3 and 6: whole images above, enlarged crops with the scaled
    difference as
    an inset below. The first column is the reference."""
    height, width = columns[0].image.shape[:2]
    reference = columns[0].image
    boxes = [crop.box(width, height) for crop in crops]
    crop_heights = [round((bottom - top) * width / (right - left)) for left, top, right, bottom in boxes]
    header, caption = 58, 84
    total = header + caption + height + sum(h + GAP for h in crop_heights) + GAP
    page = Image.new("RGB", (len(columns) * (width + GAP) + GAP, total), PAPER)
    draw = ImageDraw.Draw(page)
    draw.text((GAP, 14), title, INK, font(26, bold=True))
    for index, column in enumerate(columns):
        x, y = GAP + index * (width + GAP), header
        draw.text((x, y), column.title, INK, font(21, bold=True))
        for line, note in enumerate(column.notes):
            draw.text((x, y + 29 + 22 * line), note, SOFT, font(16))
        y += caption
        page.paste(view(column.image, exposure), (x, y))
        y += height + GAP
        for box, crop_height in zip(boxes, crop_heights, strict=True):
            part = (
                view(column.image, exposure).crop(box).resize((width, crop_height), Image.Resampling.NEAREST)
            )
            page.paste(part, (x, y))
            if index:
                inset = difference(column.image, reference, exposure, factor).crop(box)
                inset = inset.resize((width * 2 // 5, crop_height * 2 // 5), Image.Resampling.BOX)
                _inset(page, inset, f"difference × {factor:g}", (x + width, y + crop_height))
            y += crop_height + GAP
    return page


def _inset(page: Image.Image, picture: Image.Image, label: str, corner: tuple[int, int]) -> None:
    """Pastes a framed, labelled picture with its lower right corner at corner."""
    x, y = corner[0] - picture.width, corner[1] - picture.height
    draw = ImageDraw.Draw(page)
    draw.rectangle((x - 2, y - 2, corner[0] - 1, corner[1] - 1), PAPER)
    page.paste(picture, (x, y))
    draw.text((x + 6, y + 4), label, PAPER, font(15, bold=True), stroke_width=2, stroke_fill=(0, 0, 0))


def shrunk(file: Path, width: int) -> Image.Image:
    """The picture in a file at this width, in 256 colours: small enough for a repository."""
    with Image.open(file) as picture:
        size = (width, round(picture.height * width / picture.width))
        small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        return small.quantize(palette=small.quantize(256), dither=Image.Dither.FLOYDSTEINBERG)


def blocks(image: np.ndarray, bounds: np.ndarray, title: str, width: int = 2048) -> Image.Image:
    """The map with the borders of its blocks; bounds (n,4) are x0, y0, x1, y1 in texels, upper ends
    exclusive."""
    scale = width / image.shape[1]
    height = max(1, round(image.shape[0] * scale))
    picture = view(image, exposure_for(image)).resize((width, height), Image.Resampling.BILINEAR)
    lines = Image.new("L", picture.size, 0)
    draw = ImageDraw.Draw(lines)
    for x0, y0, x1, y1 in bounds * scale:
        # Blocks of cells reach half a texel over the right edge, where the map wraps.
        right, bottom = min(x1, width - 1), min(y1, height - 1)
        draw.rectangle((min(x0, right), min(y0, bottom), right, bottom), outline=190)
    picture.paste((225, 30, 60), mask=lines)
    return _titled(picture, title)


def rebuilt(image: np.ndarray, reconstruction: np.ndarray, title: str, width: int = 1024) -> Image.Image:
    """The map above, the map as its blocks alone tell it below (the paper's Figure 1)."""
    exposure = exposure_for(image)
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    page = Image.new("RGB", (width, 2 * height + GAP), PAPER)
    for row, picture in enumerate((image, reconstruction)):
        page.paste(
            view(picture, exposure).resize((width, height), Image.Resampling.BILINEAR),
            (0, row * (height + GAP)),
        )
    return _titled(page, title)


def _titled(picture: Image.Image, title: str) -> Image.Image:
    page = Image.new("RGB", (picture.width, picture.height + 44), PAPER)
    page.paste(picture, (0, 44))
    ImageDraw.Draw(page).text((10, 9), title, INK, font(20, bold=True))
    return page


def fitted_pdf(alpha: float, count: int) -> np.ndarray:
    """The paper's equation (2), integrated over each block index 0 ... count-1."""
    i = np.arange(count)
    return np.log((alpha + i + 1) / (alpha + i)) / np.log(1 + count / alpha)


def pdf_plot(path: Path, empirical: np.ndarray, alpha: float, fit_error: float, map_name: str) -> None:
    """Figure 2: block probabilities in descending order and the fitted model, linear and logarithmic."""
    fitted = fitted_pdf(alpha, len(empirical))
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.6), dpi=120)
    index = np.arange(len(empirical))
    for axes in (left, right):
        axes.plot(index, empirical, ".", ms=3.5, color="#c8502d", label="empirical: sorted block powers")
        axes.plot(
            index,
            fitted,
            "-",
            lw=1.6,
            color="#1f4e79",
            label=f"fitted: 1 / (log(1 + n/α)(α + x)), α = {alpha:.4g}",
        )
        axes.set_xlabel("block index")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    left.set_ylabel("probability of the block")
    left.set_xlim(-1, min(len(empirical), 150))
    left.legend(frameon=False)
    right.set_yscale("log")
    positive = empirical[empirical > 0]
    floor = min(positive.min(), fitted.min()) if len(positive) else fitted.min()
    right.set_ylim(max(floor, 1e-9) * 0.5, 2 * max(empirical.max(), fitted.max()))
    left.set_title("first blocks, linear", fontsize=10)
    right.set_title("all blocks, logarithmic", fontsize=10)
    figure.suptitle(
        f"Block probabilities of {map_name}: n = {len(empirical)}, fit error (rms) {fit_error:.2e}",
        fontsize=12,
    )
    figure.tight_layout()
    figure.savefig(path, metadata={"Software": None})
    plt.close(figure)
