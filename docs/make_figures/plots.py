# SPDX-License-Identifier: GPL-3.0-or-later
"""One look for all plots and sheets of pictures."""

from __future__ import annotations

import matplotlib.pyplot as plt
import pictures
from PIL import Image, ImageDraw

COLORS = {
    "empirical": "#c8502d",
    "inversion": "#b5542b",
    "inversion_binary": "#dba783",
    "kdtree_paper": "#6c8ebf",
    "kdtree": "#1f4e79",
}


def axes_grid(rows: int, columns: int, width: float, height: float, **options):
    """(figure, flat list of axes) without the boxes around them."""
    figure, axes = plt.subplots(rows, columns, figsize=(width, height), squeeze=False, **options)
    for entry in axes.flat:
        tidy(entry)
    return figure, list(axes.flat)


def tidy(axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.25)


def labelled_grid(
    rows: list[list[tuple[Image.Image, str]]], title: str, row_titles: list[str] | None = None
) -> Image.Image:
    """Pictures of one size in a grid, each with lines of text above it."""
    gap, line = pictures.GAP, 21
    width, height = rows[0][0][0].size
    lines = max(text.count("\n") + 1 for row in rows for _, text in row)
    caption = lines * line + 8
    left = gap if row_titles is None else 150
    columns = max(map(len, rows))
    page = Image.new(
        "RGB", (left + columns * (width + gap), 50 + len(rows) * (height + caption + gap)), pictures.PAPER
    )
    draw = ImageDraw.Draw(page)
    draw.text((gap, 12), title, pictures.INK, pictures.font(22, bold=True))
    for index, row in enumerate(rows):
        y = 50 + index * (height + caption + gap)
        if row_titles:
            draw.multiline_text(
                (gap, y + caption + height // 2 - 14),
                row_titles[index],
                pictures.INK,
                pictures.font(17, bold=True),
            )
        for column, (picture, text) in enumerate(row):
            x = left + column * (width + gap)
            first, _, rest = text.partition("\n")
            draw.text((x, y), first, pictures.INK, _fitting(draw, first, width, 16, bold=True))
            small = _fitting(draw, rest, width, 15)
            draw.multiline_text((x, y + line), rest, pictures.SOFT, small, spacing=4)
            page.paste(picture, (x, y + caption))
    return page


def _fitting(draw: ImageDraw.ImageDraw, text: str, width: int, size: int, bold: bool = False):
    """The font at this size, or as much smaller as the text needs to stay over its picture."""
    while size > 7 and draw.multiline_textbbox((0, 0), text, pictures.font(size, bold))[2] > width:
        size -= 1
    return pictures.font(size, bold)
