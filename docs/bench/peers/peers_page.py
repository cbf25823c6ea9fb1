# SPDX-License-Identifier: GPL-3.0-or-later
"""The section of docs/benchmarks.md that holds Skytree against Cycles and Mitsuba."""

from __future__ import annotations

import statistics

from analysis import JUDGED, MEANS_DIFFER, Result, disagrees, geometric_mean, promises
from benchmarks_page import machine, table
from cases import HEIGHT, METHODS, REFERENCES, SCENES, SEEDS, TIMED, WIDTH

BEST = "Skytree, best"
PAGE_SAMPLES = 16  # of the tables by case; the other counts are in the CSV


def section(results: list[Result], versions: dict[str, str], pictures: str) -> str:
    """Markdown from `##` on. versions: by engine; pictures: path and start of the figures' names."""
    scenes = {r.case.scene for r in results}
    maps = ", ".join(dict.fromkeys(r.case.map for r in results))
    listed = "\n".join(f"- *{name}*: {SCENES[name]}" for name in SCENES if name in scenes)
    return "\n".join(
        [
            "## Against Cycles and Mitsuba\n",
            f"Written by `./build_addon.py bench --peers`: {len(results)} cases, {WIDTH}×{HEIGHT} pixels, "
            "box filter of one pixel, no denoiser, no clamping, on "
            f"{machine()}. {versions['CYCLES']} and Skytree render inside Blender as F12 does; "
            f"{versions['MITSUBA']} renders the same triangles, camera and map, exported from there. "
            f"Maps, which come with Blender: {maps}.\n",
            listed + "\n",
            "Best mode shares out most of its samples by where the first ones, 2 of 4, 4 of 16, found noise, "
            "which keeps every pixel unbiased (docs/rendering.md); *even* is best mode without that. Cycles "
            "renders without its adaptive sampling, which stops pixels by their own samples; Mitsuba has "
            "none.\n",
            f"Each renderer is judged against its own reference ({reference_words()}); the reference's own "
            "error is subtracted; the worst 0.1 % of an image's pixels are left out, and the 0.1 % in which "
            "the reference is least certain (nRMSE_tc and relMSE_tc, `skytree_core.metrics`). "
            f"Values are means of {len(SEEDS)} seeds, one a round, all methods taking "
            "turns in every round; ± is the standard deviation. Time is processor time of the renderer's "
            f"process, of {TIMED[1]} samples less that of {TIMED[0]}, so that start-up drops out. Efficiency "
            "is 1/(nRMSE_tc² · time). FLIP is of the image as a viewport shows it, exposed by the "
            "reference's mean, and has the reference's noise in it.\n",
            "### What is promised, and what was found\n",
            promise_table(results),
            summary(results),
            f"![Error against processor time]({pictures}-error.png)\n",
            f"![Efficiency over the best peer, by case]({pictures}-ratio.png)\n",
            *case_tables(results),
            further_figures(results),
            means_section(results),
        ]
    )


def reference_words() -> str:
    return ", ".join(f"{e.title()} 2 × {n * parts} spp" for e, (_, n, parts) in REFERENCES.items())


def promise_table(results: list[Result]) -> str:
    head = ["efficiency of Skytree's best mode", "promised", *(f"{n} spp" for n in JUDGED), ""]
    lines = [
        [
            p.text,
            f"≥ {p.bound:g}×",
            *(f"{p.found(n):.2f}×" for n in JUDGED),
            "kept" if p.kept else "**not kept**",
        ]
        for p in promises(results)
    ]
    return table(head, lines)


def summary(results: list[Result]) -> str:
    direct = [r for r in results if r.case.bounces == 0] or results
    head = ["direct light, medians (worst case)", "µs a sample", *(f"× Cycles, {n} spp" for n in JUDGED)]
    head += [f"× best peer, {n} spp" for n in JUDGED]
    lines = []
    for method in METHODS:
        line = [method, f"{statistics.median(r.microseconds(method) for r in direct):.2f}"]
        for ratio in (Result.over_cycles, Result.over_best_peer):
            for n in JUDGED:
                values = [ratio(r, method, n) for r in direct]
                line.append(f"{statistics.median(values):.2f} ({min(values):.2f})")
        lines.append(line)
    ahead = " · ".join(f"{n} spp: {sum(r.over_best_peer(BEST, n) > 1 for r in direct)}" for n in JUDGED)
    return (
        table(head, lines) + f"\nBest mode is ahead of every peer in these of {len(direct)} cases: {ahead}.\n"
    )


def case_tables(results: list[Result]) -> list[str]:
    made = []
    for bounces in sorted({r.case.bounces for r in results}):
        chosen = [r for r in results if r.case.bounces == bounces]
        title = f"{bounces} bounces" if bounces else "Direct light"
        made.append(f"### {title}: error at {PAGE_SAMPLES} samples, and at equal time\n")
        head = ["scene, map", *(f"{m}: {PAGE_SAMPLES} spp" for m in METHODS), *METHODS]
        head += [f"best over best peer at {' / '.join(map(str, JUDGED))} spp"]
        made.append(
            f"nRMSE_tc. First at {PAGE_SAMPLES} samples per pixel, then after the processor time in which "
            "Mitsuba with multijitter takes 16, interpolated between sample counts (~: extrapolated).\n"
        )
        made.append(table(head, [case_row(r) for r in chosen]))
    return made


def case_row(result: Result) -> list[str]:
    row = [f"{result.case.scene}, {result.case.map}"]
    for method in METHODS:
        error, spread = (f(method, PAGE_SAMPLES) for f in (result.error, result.spread))
        row.append(f"{error:.4f} ± {spread:.4f}")
    for method in METHODS:
        error, inside = result.error_at_time(method, result.common_time())
        row.append(f"{'' if inside else '~'}{error:.4f}")
    row.append(" / ".join(f"{result.over_best_peer(BEST, n):.2f}" for n in JUDGED))
    return row


def further_figures(results: list[Result]) -> str:
    parts = [f"### relMSE_tc and FLIP at {PAGE_SAMPLES} samples\n"]
    parts.append("Geometric means over the maps; every case is in `build/reports/peers.csv`.\n")
    groups = list(dict.fromkeys((r.case.scene, r.case.bounces) for r in results))
    for figure, name in (("relmse_tc", "relMSE_tc"), ("flip", "FLIP")):
        lines = []
        for scene, bounces in groups:
            chosen = [r for r in results if (r.case.scene, r.case.bounces) == (scene, bounces)]
            values = [geometric_mean([r.error(m, PAGE_SAMPLES, figure) for r in chosen]) for m in METHODS]
            title = f"{scene}, {bounces} bounces" if bounces else scene
            lines.append([title, *(f"{v:.4f}" for v in values)])
        parts.append(table([name, *METHODS], lines))
    return "\n".join(parts)


def means_section(results: list[Result]) -> str:
    """Whether the renderers, and Skytree's modes, converge to one picture."""
    lines, wrong = [], []
    for pair in ("SKYTREE/CYCLES", "SKYTREE/MITSUBA", "MITSUBA/CYCLES"):
        found = {r.case.key: r.mean_differences()[pair] for r in results}
        worst = max(found, key=lambda key: abs(found[key][0]))
        median = statistics.median(abs(d) for d, _ in found.values())
        many = [key for key, (d, noise) in found.items() if disagrees(d, noise)]
        wrong += [f"{pair} {key}: {100 * found[key][0]:+.2f} %" for key in many]
        difference, noise = found[worst]
        text = f"{100 * difference:+.2f} % ± {100 * noise:.2f} ({worst})"
        lines.append([pair.title().replace("/", " against "), f"{100 * median:.3f} %", text, str(len(many))])
    biases = []
    for method in METHODS:
        values = [r.error(method, TIMED[1], "mean_difference") for r in results]
        biases.append(f"{method} {100 * statistics.median(values):+.3f} %")
    flagged = "\n".join(f"- {text}" for text in wrong) or "- none"
    return "\n".join(
        [
            "### Do they render the same picture?\n",
            "The means of the references; ± is the standard error, from the halves' difference.\n",
            table(["", "median difference", "largest", "cases that differ"], lines),
            f"Cases that differ by more than {100 * MEANS_DIFFER:g} % and four standard errors:\n",
            flagged + "\n",
            f"Mean of a method's images at {TIMED[1]} samples less its reference's, median of the cases: "
            f"{'; '.join(biases)}.\n",
        ]
    )
