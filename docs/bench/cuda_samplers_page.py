# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/cuda_samplers.md from what cuda_samplers.py measured and counted."""

from __future__ import annotations

from benchmarks_page import table

TIMES = ("ns per direction", "frames per second")
COUNTS = ("instructions", "loads", "32-byte sectors", "table bytes")


def page(rows: list, gpu: str | None, reason: str | None, samples: int) -> str:
    """`rows` have map, method, samples_per_pixel, quantity and value; `reason`: why there is no `gpu`."""
    parts = [
        "# Drawing a direction on a GPU\n",
        "Written by `./build_addon.py bench --only cuda`; do not edit. The same figures as a table for other "
        "programs: `build/reports/cuda_samplers.csv`.\n",
    ]
    if gpu:
        parts += [time_section(rows, gpu), frame_section(rows, gpu)]
    else:
        parts.append(
            "**No times.** The machine that wrote this page has no NVIDIA GPU to measure "
            f"({reason.rstrip('.')}). On one that has, the command adds nanoseconds per direction and frames "
            "per second, the paper's Figures 4 and 5.\n"
        )
    if any(row.quantity in COUNTS for row in rows):  # else there was no nvcc
        parts.append(count_section(rows, samples))
    return "\n".join(parts)


def time_section(rows: list, gpu: str) -> str:
    chosen = [row for row in rows if row.quantity == "ns per direction"]
    return (
        f"## Time of one direction on {gpu}\n\n"
        "Nanoseconds per direction of a kernel (`draw_directions`) that makes the random numbers and draws, "
        "median of nine times four launches of 2²⁸ directions; `uniform` tells what the random numbers "
        "take.\n\n" + grid(chosen, lambda row: row.map, "{:.4f}")
    )


def frame_section(rows: list, gpu: str) -> str:
    chosen = [row for row in rows if row.quantity == "frames per second"]
    parts = [
        f"## Frames per second on {gpu}\n",
        "512×512 pixels, a chrome sphere in direct light, from the start of a render until its pixels are "
        "on the host, median of five. The paper's Figure 4 is the column of 16 samples per pixel, Figure 5 "
        "all of it.\n",
    ]
    for name in dict.fromkeys(row.map for row in chosen):
        part = [row for row in chosen if row.map == name]
        parts.append(f"{name}:\n\n" + grid(part, lambda row: f"{row.samples_per_pixel} spp", "{:.1f}"))
    return "\n".join(parts)


def count_section(rows: list, samples: int) -> str:
    chosen = [row for row in rows if row.quantity in COUNTS]
    parts = [
        "## Instructions and memory of one direction\n",
        f"Executed PTX per direction, means of {samples}: instructions, loads from the method's tables, and "
        "the 32-byte sectors of memory that these touch. Every direction and pdf was the CPU's to the last "
        "bit.\n",
    ]
    for name in dict.fromkeys(row.map for row in chosen):
        part = [row for row in chosen if row.map == name]
        parts.append(f"{name}:\n\n" + grid(part, lambda row: row.quantity, "{:.4g}"))
    return "\n".join(parts)


def grid(rows: list, column, form: str) -> str:
    """Methods down, `column(row)` across."""
    columns = list(dict.fromkeys(map(column, rows)))
    cells: dict[str, dict] = {}
    for row in rows:
        number = f"{row.value:,.0f}" if row.value >= 10000 else form.format(row.value)
        cells.setdefault(row.method, {})[column(row)] = number
    return table(["method", *columns], [[m, *(c.get(k, "") for k in columns)] for m, c in cells.items()])
