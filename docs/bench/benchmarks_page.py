# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/benchmarks.md from the numbers that the benchmarks wrote."""

from __future__ import annotations

import os
import platform
import re
import statistics
from pathlib import Path


def page(renders: dict, samplers: dict | None) -> str:
    """The whole page of what render_vs_cycles.py measured and, where it ran, of Google Benchmark's JSON."""
    parts = [
        "# Benchmarks\n",
        "Written by `./build_addon.py bench`; do not edit. Ratios are between methods that took turns in one "
        f"run on one machine, here {machine()}; absolute times differ elsewhere.\n",
        time_section(renders),
        error_section(renders),
        sync_section(renders),
    ]
    if samplers:
        parts.append(sampler_section(samplers))
    return "\n".join(parts)


def machine() -> str:
    """This machine in words."""
    model = "an unknown processor"
    info = Path("/proc/cpuinfo")
    if info.exists() and (found := re.search(r"model name\s*:\s*(.+)", info.read_text())):
        model = f"an {found[1]}" if found[1][0] in "AEIOU" else f"a {found[1]}"
    return f"{model}, {os.cpu_count()} logical cores, {platform.system()}"


def table(head: list[str], rows: list[list[str]]) -> str:
    align = [":--"] + ["--:"] * (len(head) - 1)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [head, align, *rows]) + "\n"


def time_section(renders: dict) -> str:
    width, height = renders["image_size"]
    rows = [
        [
            method,
            f"{statistics.median(values):.3f}",
            f"{min(values):.3f} … {max(values):.3f}",
            f"{renders['ratio_to_cycles'][method]:.2f}",
        ]
        for method, values in renders["microseconds"].items()
    ]
    rounds = len(next(iter(renders["microseconds"].values())))
    return (
        "## Time of a pixel sample inside Blender 4.5\n\n"
        f"Processor time of the Blender process, user and system, in µs per pixel sample: {width}×{height} "
        f"pixels, three spheres on a grey ground under {renders['map']}, direct light only, box filter of "
        "one pixel, all cores, no denoiser; Cycles without its adaptive sampling, every row of Skytree with "
        "all its default estimators. Two sample counts are rendered and their "
        f"times subtracted, so that start-up drops out; {rounds} rounds in which the methods take turns.\n\n"
        + table(["", "median µs", "range", "of Cycles' time (median of rounds)"], rows)
    )


def error_section(renders: dict) -> str:
    figures = renders["errors"]["figures"]
    counts = list(next(iter(figures.values())))
    rows = [
        [method]
        + [f"{statistics.mean(values):.4f} ± {statistics.stdev(values):.4f}" for values in by_count.values()]
        for method, by_count in figures.items()
    ]
    return (
        "## Error at equal samples\n\n"
        "The same scene; nRMSE_tc (skytree_core.metrics) against the engine's own reference of "
        f"{renders['reference_samples']} samples per pixel, mean and standard deviation over "
        f"{renders['seeds']} seeds. The two references' means differ by "
        f"{100 * (renders['errors']['mean_ratio'] - 1):+.2f} % (Skytree against Cycles).\n\n"
        + table(["", *(f"{count} spp" for count in counts)], rows)
    )


def sync_section(renders: dict) -> str:
    rows = [
        [
            f"Blender {version}",
            f"{values[0]['sync_seconds']:.2f} s",
            f"{statistics.median(v['sync_seconds'] for v in values):.2f} s",
            f"{statistics.median(v['whole_seconds'] for v in values):.2f} s",
            f"{statistics.median(v['cpu_seconds'] for v in values):.2f} s",
        ]
        for version, values in renders["sync"].items()
    ]
    triangles = next(iter(renders["sync"].values()))[0]["triangles"]
    return (
        "## Taking over a large scene\n\n"
        f"One mesh of {triangles:,} triangles and a map of 4096×2048 texels, all cores: the synchronisation "
        "(reading mesh and map, building the kd-tree), and the whole of F12 for one sample of 32×18 pixels, "
        "which builds the ray-tracing structure too. These are wall times, which a busy machine stretches; "
        "the last column, processor time of the whole F12, suffers far less from that.\n\n"
        + table(["", "first sync", "median sync", "median F12", "its processor time"], rows)
    )


def sampler_section(samplers: dict) -> str:
    rows = []
    for run in samplers["benchmarks"]:
        if run.get("run_type") == "aggregate" and run.get("aggregate_name") != "median":
            continue
        rows.append([f"`{run['name']}`", f"{run['cpu_time']:.4g} {run['time_unit']}"])
    return (
        "## Samplers alone\n\n"
        "Google Benchmark: processor time of one iteration on one core (native/bench tells what that is).\n\n"
        + table(["", "time"], rows)
    )


def merged(old: str, new: str) -> str:
    """The page `old` with the `##` sections of `new` in place of those of the same title, or at its end."""
    pages = [re.split(r"(?m)^(?=## )", text) for text in (old, new)]
    fresh = {part.split("\n", 1)[0]: part.rstrip("\n") + "\n" for part in pages[1] if part.startswith("## ")}
    kept = [fresh.pop(part.split("\n", 1)[0], part.rstrip("\n") + "\n") for part in pages[0] if part.strip()]
    return "\n".join([*kept, *fresh.values()])
