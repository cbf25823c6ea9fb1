# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure 5: frames per second by number of samples, kd-tree and inversion (Ergun, Kurt, Ozturk, 2012)."""

from __future__ import annotations

import figure4
import plots
import stage
from context import Context

TITLE = "Figure 5: frame rates by samples per pixel"
INPUTS = ("figure4.py",)
COUNTS = (1, 2, 4, 8, 16, 32, 64)
MAPS = ("uffizi", "doge2")


def make(context: Context) -> None:
    devices = stage.devices()
    counts = COUNTS[:3] if context.quick else COUNTS
    entries = context.maps.some(*MAPS[: 1 if context.quick else None])
    rounds = 1 if context.quick else 2
    context.expect(len(devices) * len(entries) * sum(counts))
    rows = []
    for device, device_name in devices.items():
        for entry in entries:
            for count in counts:
                rows += figure4.frame_rates(entry.name, entry.image(), device, device_name, rounds, count)
                context.step(count)
    rows += figure4.gpu_rows(context, "figure5_times", devices)
    context.table("figure5_times", rows)
    context.plot("figure5_times", plot(rows))


def plot(rows: list[dict]):
    names = list(dict.fromkeys(row["map"] for row in rows))
    devices = list(dict.fromkeys(row["device"] for row in rows))
    figure, axes = plots.axes_grid(len(devices), len(names), 4.2 * len(names), 3.8 * len(devices))
    panels = [(device, name) for device in devices for name in names]
    for axis, (device, name) in zip(axes, panels, strict=True):
        for method in figure4.COMPARED:
            of = [r for r in rows if (r["device"], r["map"], r["method"]) == (device, name, method)]
            counts, values = [r["samples"] for r in of], [r["fps"] for r in of]
            axis.plot(counts, values, "o-", ms=3.5, color=plots.COLORS[method], label=stage.METHODS[method])
        axis.set_xscale("log", base=2)
        axis.set_yscale("log")
        axis.set_xlabel("samples per pixel")
        axis.set_title(f"{name}\n{device}", fontsize=9)
    axes[0].set_ylabel("frames per second")
    axes[0].legend(frameon=False, fontsize=8)
    figure.tight_layout()
    return figure
