#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures renders inside real Blenders and writes docs/benchmarks.md.

Processor time per pixel sample of Skytree and of Cycles in interleaved rounds, the error of every sampler at
equal samples, and the time to take over a large scene.

`./build_addon.py bench` runs it; by hand, from an environment that has skytree_core:

    python docs/bench/render_vs_cycles.py [--zip ZIP] [--hdri MAP] [--rounds 4] [--page FILE]
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE.parent / "demo"))
import benchmarks_page  # noqa: E402
import metrics  # noqa: E402
import skytree_core  # noqa: E402
from blender_process import BlenderError, run_in_blender  # noqa: E402
from demo import DemoError, bundled_map, newest_zip  # noqa: E402

WIDTH, HEIGHT = 160, 120
# Two sample counts each: the difference of their times has no start-up in it.
TIMED_SAMPLES = {"SKYTREE": (32, 288), "CYCLES": (16, 112)}
ERROR_SAMPLES = (4, 16, 64)
ERROR_SEEDS = (0, 1, 2, 3)
REFERENCE_SAMPLES = 512  # of each of two halves

METHODS = {
    "Skytree, kd-tree (default)": ("SKYTREE", {}),
    "Skytree, kd-tree as in the paper": (
        "SKYTREE",
        {"sampler": "KDTREE", "split_criterion": "SSE", "block_probability": "FITTED"},
    ),
    "Skytree, inversion": ("SKYTREE", {"sampler": "INVERSION"}),
    "Skytree, texel alias table": ("SKYTREE", {"sampler": "ALIAS"}),
    "Cycles": ("CYCLES", {}),
}


@dataclass(frozen=True)
class Bench:
    """Where the pieces are, and the progress to move."""

    addon: Path
    hdri: Path
    blender: list[str]
    folder: Path
    progress: Progress

    def render(self, title: str, entries: list[dict]) -> list[dict]:
        """Renders the entries in their order in one Blender; -> what was told after each."""
        job = {"zip": str(self.addon), "hdri": str(self.hdri), "renders": entries}
        job |= {"width": WIDTH, "height": HEIGHT}
        bar = self.progress.add_task(title, total=len(entries))
        told = []
        for event in run_in_blender(self.blender, HERE / "render_worker.py", job, self.folder / "bench.log"):
            if event["event"] == "rendered":
                told.append(event)
                self.progress.advance(bar)
        return told


def entry(method: str, samples: int, seed: int, exr: Path | None = None) -> dict:
    engine, settings = METHODS[method]
    file = str(exr) if exr else None
    return {"engine": engine, "settings": settings, "samples": samples, "seed": seed, "exr": file}


def time_per_sample(bench: Bench, rounds: int) -> dict[str, list[float]]:
    """Microseconds of processor time (user and system) per pixel sample by method, one value a round."""
    plan = [
        (method, samples)
        for _ in range(rounds + 1)
        for method, (engine, _) in METHODS.items()
        for samples in TIMED_SAMPLES[engine]
    ]
    told = bench.render("Time per pixel sample", [entry(m, samples, 0) for m, samples in plan])
    values: dict[str, list[float]] = {method: [] for method in METHODS}
    pairs = zip(plan[0::2], plan[1::2], told[0::2], told[1::2], strict=True)
    for (method, few), (_, many), short, long in pairs:
        seconds = long["cpu_seconds"] - short["cpu_seconds"]
        values[method].append(1e6 * seconds / ((many - few) * WIDTH * HEIGHT))
    return {method: times[1:] for method, times in values.items()}  # the first round warms caches


def errors(bench: Bench) -> dict[str, dict[int, list[float]]]:
    """nRMSE_tc of each method against its engine's own reference, by samples per pixel, one value a seed."""
    halves = {}
    plan = []
    for method, engine in (("Skytree, texel alias table", "SKYTREE"), ("Cycles", "CYCLES")):
        halves[engine] = [bench.folder / f"{engine}-{half}.exr" for half in range(2)]
        plan += [entry(method, REFERENCE_SAMPLES, 1001 + i, file) for i, file in enumerate(halves[engine])]
    images = {}
    for method in METHODS:
        for samples in ERROR_SAMPLES:
            for seed in ERROR_SEEDS:
                file = bench.folder / f"image-{len(images)}.exr"
                images[method, samples, seed] = file
                plan.append(entry(method, samples, seed, file))
    bench.render("Error at equal samples", plan)
    references = {e: [skytree_core.read_image(str(f)) for f in files] for e, files in halves.items()}
    ratio = np.mean(references["SKYTREE"]) / np.mean(references["CYCLES"])
    figures: dict[str, dict[int, list[float]]] = {method: {} for method in METHODS}
    for (method, samples, _), file in images.items():
        found = metrics.error_figures(skytree_core.read_image(str(file)), *references[METHODS[method][0]])
        figures[method].setdefault(samples, []).append(found["nrmse_tc"])
    return {"figures": figures, "mean_ratio": float(ratio)}


def write_large_map(file: Path) -> None:
    """4096 x 2048, half float, zip: a sky with a sun and grain, so that it does not compress to nothing."""
    rng = np.random.default_rng(7)
    sky = np.linspace(1.5, 0.2, 2048, dtype=np.float32)[:, None, None] * np.array([0.6, 0.8, 1.0], np.float32)
    image = sky * rng.random((2048, 4096, 1), dtype=np.float32)
    image[500:512, 1000:1012] = 5000
    buffer = OpenImageIO.ImageBuf(OpenImageIO.ImageSpec(4096, 2048, 3, OpenImageIO.HALF))
    buffer.set_pixels(OpenImageIO.ROI(), image)
    if not buffer.write(str(file)):
        raise DemoError(f"cannot write {file}: {buffer.geterror()}")


def sync_times(bench: Bench, blenders: dict[str, list[str]], rounds: int) -> dict[str, list[dict]]:
    """What sync_worker.py tells in each Blender, by Blender's version."""
    large_map = bench.folder / "large.exr"
    write_large_map(large_map)
    bar = bench.progress.add_task("A million triangles and a 4k map", total=rounds * len(blenders))
    found = {}
    for name, command in blenders.items():
        job = {"zip": str(bench.addon), "hdri": str(large_map), "rounds": rounds}
        version, values = name, []
        for event in run_in_blender(command, HERE / "sync_worker.py", job, bench.folder / f"sync-{name}.log"):
            if event["event"] == "installed":
                version = event["blender"]
            else:
                values.append(event)
                bench.progress.advance(bar)
        found[version] = values
    return found


def blenders_here() -> dict[str, list[str]]:
    """Commands of the Blenders that can be had: Debian's, and those in build/."""
    found = {}
    if debian := shutil.which("blender"):
        found["debian"] = [debian, "--background", "--factory-startup", "--python-exit-code", "3", "--python"]
    for version in ("4.5", "5.2"):
        python = ROOT / "build" / f"bpy-{version}" / "bin" / "python"
        if python.exists():
            found[version] = [str(python)]
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--zip", type=Path, help="the add-on; default: the newest dist/skytree-*.zip")
    parser.add_argument("--hdri", type=Path, help="lat-long map; default: city.exr, which comes with Blender")
    parser.add_argument("--rounds", type=int, default=4)
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "benchmarks.md")
    parser.add_argument("--samplers", type=Path, default=ROOT / "build" / "reports" / "bench.json")
    arguments = parser.parse_args()
    console = Console()
    blender = ROOT / "build" / "bpy-4.5" / "bin" / "python"
    columns = (TextColumn("{task.description:<34}"), BarColumn(40), MofNCompleteColumn(), TimeElapsedColumn())
    try:
        addon = (arguments.zip or newest_zip()).resolve()
        hdri = (arguments.hdri or bundled_map(blender, "city.exr")).resolve()
        (ROOT / "build").mkdir(exist_ok=True)
        with (
            tempfile.TemporaryDirectory(prefix="bench-", dir=ROOT / "build") as folder,
            Progress(*columns, console=console) as progress,
        ):
            bench = Bench(addon, hdri, [str(blender)], Path(folder), progress)
            sync = sync_times(bench, blenders_here(), 3)
            times = time_per_sample(bench, arguments.rounds)
            error = errors(bench)
    except (BlenderError, DemoError) as failure:
        console.print(f"bench: {failure}", style="red", markup=False, highlight=False)
        return 1
    measured = {
        "map": hdri.name,
        "image_size": [WIDTH, HEIGHT],
        "microseconds": times,
        "ratio_to_cycles": {
            method: statistics.median(a / b for a, b in zip(values, times["Cycles"], strict=True))
            for method, values in times.items()
        },
        "errors": error,
        "seeds": len(ERROR_SEEDS),
        "reference_samples": 2 * REFERENCE_SAMPLES,
        "sync": sync,
    }
    report = ROOT / "build" / "reports" / "render_bench.json"
    report.parent.mkdir(parents=True, exist_ok=True)
    report.write_text(json.dumps(measured, indent=2) + "\n")
    samplers = json.loads(arguments.samplers.read_text()) if arguments.samplers.exists() else None
    page = benchmarks_page.page(measured, samplers)
    old = arguments.page.read_text() if arguments.page.exists() else ""
    arguments.page.write_text(benchmarks_page.merged(old, page))
    console.print(page, markup=False, highlight=False, soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
