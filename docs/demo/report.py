# SPDX-License-Identifier: GPL-3.0-or-later
"""report.json and its short form on the console."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table


def assemble(
    settings: dict,
    versions: dict,
    titles: dict[str, str],
    built: dict,
    build_seconds: dict[str, float],
    sample_nanoseconds: dict[str, float],
    renders: dict[str, dict],
    errors: dict[str, dict],
) -> dict:
    """The report as plain data; times are in the units their names tell."""
    inversion_bytes = built["inversion"].nbytes
    methods = {}
    for name, title in titles.items():
        sampler = built[name]
        entry = {
            "title": title,
            "table_bytes": int(sampler.nbytes),
            "inversion_bytes_ratio": inversion_bytes / sampler.nbytes,
            "build_seconds": build_seconds[name],
            "sample_nanoseconds": sample_nanoseconds[name],
            "inversion_time_ratio": sample_nanoseconds["inversion"] / sample_nanoseconds[name],
            "inversion_binary_time_ratio": sample_nanoseconds["inversion_binary"] / sample_nanoseconds[name],
            "render": renders[name],
            "error": errors[name],
        }
        if hasattr(sampler, "alpha"):
            entry |= {
                "alpha": float(sampler.alpha),
                "fit_error_rms": float(sampler.fit_error),
                "blocks": int(sampler.block_count),
            }
        methods[name] = entry
    return {
        "settings": settings,
        "versions": versions,
        "for_comparison": {
            name: {"sample_nanoseconds": sample_nanoseconds[name], "table_bytes": int(built[name].nbytes)}
            for name in sample_nanoseconds
            if name not in titles
        },
        "methods": methods,
        "reference": {name: times for name, times in renders.items() if name.startswith("reference")},
    }


def bytes_text(count: float) -> str:
    """1536 -> '1.5 KB' (1 KB = 1024 bytes)."""
    if count < 1 << 20:
        return f"{count / 1024:.1f} KB"
    return f"{count / (1 << 20):.2f} MB"


def print_table(report: dict, console: Console) -> None:
    """The figures that matter, a line a method."""
    settings = report["settings"]
    width, height = settings["map_size"]
    title = (
        f"{settings['map']} {width}×{height}, {settings['samples_per_pixel']} samples per pixel "
        f"against a reference of {settings['reference_samples_per_pixel']}"
    )
    table = Table(title=title)
    table.add_column("")
    for heading in ("tables", "build", "a sample", "render", "error", "mean"):
        table.add_column(heading, justify="right")
    for entry in report["methods"].values():
        error = entry["error"]
        table.add_row(
            entry["title"],
            bytes_text(entry["table_bytes"]),
            f"{1e3 * entry['build_seconds']:.1f} ms",
            f"{entry['sample_nanoseconds']:.1f} ns",
            f"{entry['render'].get('render_s', entry['render']['wall_seconds']):.2f} s",
            f"{100 * error['nrmse_tc']:.1f} %",
            f"{100 * error['mean_difference']:+.2f} %",
        )
    console.print(table)
    paper = report["methods"]["kdtree_paper"]
    others = {name: entry["sample_nanoseconds"] for name, entry in report["for_comparison"].items()}
    console.print(
        f"α = {paper['alpha']:.4g}, fit error (rms) {paper['fit_error_rms']:.2e}, {paper['blocks']} blocks. "
        f"Tables {paper['inversion_bytes_ratio']:.0f} times smaller than inversion's; a sample costs "
        f"1/{paper['inversion_time_ratio']:.1f} of inversion with a guide table and "
        f"1/{paper['inversion_binary_time_ratio']:.1f} of inversion by binary search "
        f"({others['inversion_binary']:.1f} ns); uniform directions take {others['uniform']:.1f} ns.",
        highlight=False,
    )
