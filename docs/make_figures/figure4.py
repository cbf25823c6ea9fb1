# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure 4: frames per second at 16 samples per pixel under different environment maps, kd-tree and
inversion, on the devices of this machine; and what the size of a map does. Ergun, Kurt, Ozturk, SCCG 2012."""

from __future__ import annotations

import numpy as np
import plots
import stage
from context import Context

TITLE = "Figure 4: frame rates by map"
SAMPLES = 16
COMPARED = ("inversion_binary", "inversion", "kdtree_paper", "kdtree")
WIDTH, HEIGHT = 256, 160
SCALES = (1, 2, 4)


def make(context: Context) -> None:
    devices = stage.devices()
    entries = context.maps.some("uffizi", "doge2") if context.quick else context.maps.all
    scales = SCALES[:2] if context.quick else SCALES
    rounds = 1 if context.quick else 2
    context.expect(len(devices) * (len(entries) + 2 * len(scales)))
    rows, sizes = [], []
    for device, device_name in devices.items():
        for entry in entries:
            rows += frame_rates(entry.name, entry.image(), device, device_name, rounds)
            context.step()
        entry = context.maps.named("uffizi")
        for scale in scales:
            image = enlarged(entry.image(), scale)
            sizes += frame_rates(entry.name, image, device, device_name, rounds)
            context.step(2)
    rows += gpu_rows(context, "figure4_times", devices)
    sizes += gpu_rows(context, "figure4_sizes_times", devices)
    context.table("figure4_times", rows)
    context.table("figure4_sizes_times", sizes)
    context.table("figure4_summary_times", summary(rows))
    context.plot("figure4_times", plot(rows))


def gpu_rows(context: Context, name: str, devices: dict[str, str]) -> list[dict]:
    """Where this machine has no GPU: what another one measured on its own, which the table there has."""
    if any(device != "CPU" for device in devices):
        return []
    numbers = {"threads": int, "map_width": int, "samples": int, "fps": float, "fps_over_inversion": float}
    return [
        {key: numbers.get(key, str)(value) for key, value in row.items()}
        for row in context.existing(name)
        if row["on"] != "CPU"
    ]


def frame_rates(
    name: str, image: np.ndarray, device: str, device_name: str, rounds: int, samples=SAMPLES
) -> list[dict]:
    """On a CPU a frame's time is the threads' processor time divided by their number: what a clock on the
    wall says depends on what else the machine does."""
    scene = stage.teapot_stage(image, WIDTH, HEIGHT)
    samplers = {method: stage.build(method, image) for method in COMPARED}
    best = stage.fastest(scene, samplers, samples, rounds, max_bounces=0, device=device)
    rows = []
    for method, render in best.items():
        seconds = render.seconds / (render.threads if device == "CPU" else 1)
        rows.append(
            {
                "on": device.partition(":")[0],
                "device": device_name,
                "threads": render.threads if device == "CPU" else 0,
                "map": name,
                "map_width": image.shape[1],
                "samples": samples,
                "method": method,
                "fps": 1 / seconds,
                "fps_over_inversion": best["inversion"].seconds / render.seconds,
            }
        )
    return rows


def enlarged(image: np.ndarray, scale: int) -> np.ndarray:
    """Repeats texels: the same light in tables scale^2 times as large."""
    return np.ascontiguousarray(image.repeat(scale, axis=0).repeat(scale, axis=1))


def summary(rows: list[dict]) -> list[dict]:
    """Median over the maps of each device and method."""
    found = []
    for device in dict.fromkeys(row["device"] for row in rows):
        for method in COMPARED:
            of = [row for row in rows if row["device"] == device and row["method"] == method]
            ratios = [row["fps_over_inversion"] for row in of]
            found.append(
                {
                    "on": of[0]["on"],
                    "device": device,
                    "threads": of[0]["threads"],
                    "method": method,
                    "maps": len(of),
                    "fps_median": float(np.median([row["fps"] for row in of])),
                    "fps_over_inversion_median": float(np.median(ratios)),
                    "fps_over_inversion_least": min(ratios),
                    "fps_over_inversion_most": max(ratios),
                }
            )
    return found


def plot(rows: list[dict]):
    devices = list(dict.fromkeys(row["device"] for row in rows))
    figure, axes = plots.axes_grid(len(devices), 1, 12, 4.2 * len(devices) + 0.6)
    for axis, device in zip(axes, devices, strict=True):
        names = list(dict.fromkeys(row["map"] for row in rows if row["device"] == device))
        for index, method in enumerate(COMPARED):
            of = [row for row in rows if row["device"] == device and row["method"] == method]
            values = [row["fps"] for row in of]
            place = np.array([names.index(row["map"]) for row in of]) + (index - 1.5) * 0.2
            axis.bar(place, values, 0.19, color=plots.COLORS[method], label=stage.METHODS[method])
        threads = next(row["threads"] for row in rows if row["device"] == device)
        on = f"{device}, {threads} threads" if threads else device
        axis.set_title(f"{on}: the teapot, {WIDTH} × {HEIGHT}, {SAMPLES} samples per pixel", fontsize=10)
        axis.set_ylabel("frames per second")
        axis.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=8)
        axis.grid(axis="x", alpha=0)
        axis.set_ylim(0, 1.16 * axis.get_ylim()[1])
    axes[0].legend(frameon=False, ncol=4, fontsize=9, loc="upper center")
    figure.tight_layout()
    return figure
