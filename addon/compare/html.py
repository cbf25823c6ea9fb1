# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison as one HTML page that needs nothing else: images as data URIs, plots as SVG, no library."""

from __future__ import annotations

import base64
import math
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .report import Comparison

COLORS = {"a": "#e0703c", "b": "#3c8ee0"}
FIGURES = (
    ("rmse", "RMSE", "root of the mean squared difference to the reference, in units of radiance"),
    ("relmse", "relMSE", "mean of squared difference / (reference² + 1 % of its squared mean)"),
    (
        "nrmse_tc",
        "nRMSE_tc",
        "RMSE / mean, without the worst 0.1 % of pixels, less the reference's own error",
    ),
    (
        "mean_difference",
        "mean difference",
        "relative to the reference's mean; what stays as samples grow is bias",
    ),
)


def page(comparison: Comparison, document: dict, images: dict[str, bytes]) -> str:
    """`document` as report.document_of makes it, `images` PNG files by name."""
    template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    factor = document["display"]["difference_factor"]
    captions = {
        "a": f"A: {comparison.a.label}",
        "b": f"B: {comparison.b.label}",
        "reference": "Reference",
        "difference_a": f"|A − reference| × {factor:g}",
        "difference_b": f"|B − reference| × {factor:g}",
        "difference_ab": f"|A − B| × {factor:g}",
    }
    figures = "\n".join(
        f'<figure><img id="{name}" alt="{escape(captions[name])}" src="data:image/png;base64,'
        f'{base64.b64encode(data).decode()}"><figcaption>{escape(captions[name])}</figcaption></figure>'
        for name, data in images.items()
    )
    options = "".join(f'<option value="{name}">{escape(captions[name])}</option>' for name in images)
    parts = {
        "title": escape(
            document["settings"].get("scene", "Skytree")
            + ": "
            + comparison.a.label
            + " against "
            + comparison.b.label
        ),
        "options": options,
        "figures": figures,
        "result_rows": _result_rows(comparison),
        "plots": _plots(comparison),
        "settings_rows": _rows(document["settings"] | {"view": document["display"]["view"]}),
        "machine_rows": _rows(document["machine"] | {"started": comparison.started}),
        "notes": "".join(f"<li>{escape(note)}</li>" for note in comparison.notes),
    }
    for name, text in parts.items():
        template = template.replace(f"<!--{name}-->", text)
    return template


def _rows(values: dict) -> str:
    return "".join(f"<tr><th>{escape(str(k))}</th><td>{escape(str(v))}</td></tr>" for k, v in values.items())


def _result_rows(comparison: Comparison) -> str:
    a, b = comparison.a, comparison.b
    rows = [("samples per pixel", "", [f"{side.last.samples}" for side in (a, b)])]
    rows += [(name, what, [_error(side.last.errors, key) for side in (a, b)]) for key, name, what in FIGURES]
    for key, name, what in (
        (
            "largest_weight",
            "largest sample weight",
            "max L/pdf over the map, relative to its mean; 1 is perfect",
        ),
        (
            "sample_variance",
            "variance of a light sample",
            "relative, unoccluded: how well the pdf fits the map",
        ),
        ("nbytes", "bytes of the sampler", "what sampling and pdf read at run time, the map left out"),
    ):
        rows.append((name, what, [_number(side.sampler.get(key)) for side in (a, b)]))
    rows.append(("render time", "seconds", [f"{side.last.render_seconds:.3f}" for side in (a, b)]))
    rows.append(
        (
            "device time",
            "seconds: of all threads together on the CPU, on the clock on a GPU",
            [f"{side.last.device_seconds:.3f}" for side in (a, b)],
        )
    )
    rows.append(
        (
            "efficiency",
            "1 / (nRMSE_tc² × seconds of device time)",
            [_number(side.last.efficiency) for side in (a, b)],
        )
    )
    return "".join(
        f'<tr><th title="{escape(what)}">{escape(name)}</th><td>{x}</td><td>{y}</td></tr>'
        for name, what, (x, y) in rows
    )


def _error(errors: dict[str, float], key: str) -> str:
    return f"{100 * errors[key]:+.2f} %" if key == "mean_difference" else f"{errors[key]:.4g}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.5g}"


def _plots(comparison: Comparison) -> str:
    def curves(axis):
        return {
            key: [(getattr(step, axis), step.errors["nrmse_tc"] ** 2) for step in side.steps]
            for key, side in comparison.sides.items()
        }

    return log_log_plot(curves("samples"), "samples per pixel", "nRMSE_tc²") + log_log_plot(
        curves("device_seconds"), "seconds of device time", "nRMSE_tc²"
    )


def log_log_plot(curves: dict[str, list[tuple[float, float]]], x_label: str, y_label: str) -> str:
    """SVG of squared errors; the dashed guide has slope -1, as variance falls with independent samples."""
    points = [(x, y) for curve in curves.values() for x, y in curve if x > 0 and y > 0]
    if not points:
        return f"<p>{escape(y_label)} is below what the reference can tell.</p>"
    xs, ys = ([math.log10(p[i]) for p in points] for i in (0, 1))
    x0, x1, y0, y1 = (
        math.floor(min(xs)),
        math.ceil(max(xs) + 1e-9),
        math.floor(min(ys)),
        math.ceil(max(ys) + 1e-9),
    )
    x1, y1 = max(x1, x0 + 1), max(y1, y0 + 1)
    width, height, left, below, margin = 460, 320, 58, 44, 12

    def at(x, y):
        return (
            left + (x - x0) / (x1 - x0) * (width - left - margin),
            height - below - (y - y0) / (y1 - y0) * (height - below - margin),
        )

    parts = [
        f'<svg viewBox="0 0 {width} {height}" role="img" '
        f'aria-label="{escape(y_label)} against {escape(x_label)}">'
    ]
    for decade in range(x0, x1 + 1):
        x, bottom = at(decade, y0)
        parts.append(
            f'<path class="grid" d="M{x:.1f} {margin}V{bottom:.1f}"/>'
            f'<text x="{x:.1f}" y="{bottom + 16:.1f}" text-anchor="middle">{10.0**decade:g}</text>'
        )
    for decade in range(y0, y1 + 1):
        x, y = at(x0, decade)
        parts.append(
            f'<path class="grid" d="M{x:.1f} {y:.1f}H{width - margin}"/>'
            f'<text x="{x - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{10.0**decade:g}</text>'
        )
    start_x, start_y = xs[0], ys[0]
    end_x = min(x1, start_x + start_y - y0)
    (gx0, gy0), (gx1, gy1) = at(start_x, start_y), at(end_x, start_y - (end_x - start_x))
    parts.append(f'<path class="guide" d="M{gx0:.1f} {gy0:.1f}L{gx1:.1f} {gy1:.1f}"/>')
    for key, curve in curves.items():
        shown = [at(math.log10(x), math.log10(y)) for x, y in curve if x > 0 and y > 0]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in shown)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{COLORS[key]}" stroke-width="2"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{COLORS[key]}"/>' for x, y in shown]
    parts.append(
        f'<text x="{(left + width) / 2:.0f}" y="{height - 6}" text-anchor="middle">{escape(x_label)}</text>'
        f'<text x="14" y="{height / 2 - 14:.0f}" text-anchor="middle" transform="rotate(-90 14 '
        f'{height / 2 - 14:.0f})">{escape(y_label)}</text></svg>'
    )
    return "".join(parts)
