# SPDX-License-Identifier: GPL-3.0-or-later
"""What a figure's module gets: maps, where to write, how far it is. Everything written is
remembered, so that the command knows what belongs to the figure."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib.pyplot as plt
from maps import Maps
from PIL import Image


def cell(value) -> str:
    """How a number stands in a table: six digits, the same on every machine that computes the same bits."""
    return f"{value:.6g}" if isinstance(value, float) else str(value)


@dataclass
class Context:
    maps: Maps
    out: Path
    quick: bool = False  # coarse: for tests and a first look
    on_progress: Callable[[float, float], None] = lambda done, total: None
    outputs: list[str] = field(default_factory=list)
    _total: float = 1
    _done: float = 0

    def expect(self, steps: float) -> None:
        """How many step()s there will be."""
        self._total, self._done = max(steps, 1), 0
        self.on_progress(0, self._total)

    def step(self, count: float = 1) -> None:
        self._done += count
        self.on_progress(self._done, self._total)

    def path(self, name: str) -> Path:
        self.outputs.append(name)
        return self.out / name

    def existing(self, name: str) -> list[dict[str, str]]:
        """Rows of NAME.csv as it was before this run; none where it has not been made."""
        file = self.out / f"{name}.csv"
        if not file.exists():
            return []
        with open(file, newline="") as lines:
            return list(csv.DictReader(lines))

    def table(self, name: str, rows: list[dict]) -> None:
        """Writes rows of one shape to NAME.csv. What a clock measured goes into tables named ..._times:
        the others are the same in every run."""
        with open(self.path(f"{name}.csv"), "w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(
                {
                    key: cell(float(value) if hasattr(value, "dtype") and value.dtype.kind == "f" else value)
                    for key, value in row.items()
                }
                for row in rows
            )

    def picture(self, name: str, picture: Image.Image, width: int | None = None) -> None:
        """Writes NAME.png at this width, in 256 colours: small enough for a repository."""
        picture = picture.convert("RGB")
        if width and width < picture.width:
            height = round(picture.height * width / picture.width)
            picture = picture.resize((width, height), Image.Resampling.LANCZOS)
        picture = picture.quantize(palette=picture.quantize(256), dither=Image.Dither.FLOYDSTEINBERG)
        picture.save(self.path(f"{name}.png"), optimize=True)

    def plot(self, name: str, figure: plt.Figure) -> None:
        """Writes a matplotlib figure to NAME.png and closes it."""
        figure.savefig(self.path(f"{name}.png"), metadata={"Software": None}, dpi=110)
        plt.close(figure)
