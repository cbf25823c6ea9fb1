#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""The demo: from an HDRI to an image, kd-tree against inversion at equal samples, in real headless Blender.

`./build_addon.py demo` builds what this needs and runs it; by hand, from an environment that has
skytree_core:

    python docs/demo/demo.py [--hdri MAP] [--out DIR] [--quick]
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import platform
import sys
import time
from pathlib import Path

import metrics
import numpy as np
import OpenImageIO
import pictures
import report
import samplers
import skytree_core
from blender_process import BlenderError
from renders import QUICK, Order, Quality, render_all
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

ROOT = Path(__file__).resolve().parents[2]
DEFAULT_MAP = "courtyard.exr"
BLOCKS = 1024
LIGHT_FROM = math.radians(-10)  # azimuth in the scene; the camera looks along +Y: from its right

METHODS = {
    "inversion": ("Inversion", {"sampler": "INVERSION"}),
    "kdtree_paper": ("Kd-tree as in the paper", {"sampler": "KDTREE", **samplers.PAPER}),
    "kdtree": ("Kd-tree, Skytree's default", {}),
}
CROPS = [
    pictures.Crop("teapot", 0.20, 0.12, 0.64, 0.60),
    pictures.Crop("spheres", 0.50, 0.38, 0.94, 0.86),
]


class DemoError(Exception):
    """Something the user can mend; the message says how."""


def main() -> int:
    arguments = parse(sys.argv[1:])
    console = Console()
    started = time.perf_counter()
    try:
        summary = run(arguments, console)
    except (DemoError, BlenderError) as error:
        console.print(f"demo: {error}", style="red", markup=False, highlight=False)
        return 1
    report.print_table(summary, console)
    seconds = time.perf_counter() - started
    console.print(f"Pictures and report.json are in {arguments.out} ({seconds:.0f} s).", highlight=False)
    return 0


def parse(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "--hdri", type=Path, help=f"lat-long map; default: {DEFAULT_MAP}, which comes with Blender"
    )
    parser.add_argument(
        "--out", type=Path, default=ROOT / "demo", help="folder for what is made (default: demo)"
    )
    parser.add_argument(
        "--zip", type=Path, help="the add-on to install; default: the newest dist/skytree-*.zip"
    )
    parser.add_argument("--blender-python", type=Path, default=ROOT / "build" / "bpy-4.5" / "bin" / "python")
    parser.add_argument("--cache", type=Path, default=ROOT / "build" / "demo", help="for references and logs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--publish", type=Path, metavar="DIR", help="also write small copies for the documentation"
    )
    parser.add_argument(
        "--quick", action="store_true", help="small images and a coarse reference, for a first look"
    )
    return parser.parse_args(words)


def run(arguments: argparse.Namespace, console: Console) -> dict:
    """Makes everything in arguments.out and returns the report."""
    if not arguments.blender_python.exists():
        raise DemoError(f"no Blender at {arguments.blender_python}: ./build_addon.py demo installs it")
    addon = arguments.zip or newest_zip()
    if not addon.is_file():
        raise DemoError(f"there is no {addon}: ./build_addon.py package makes the zip")
    hdri = (arguments.hdri or bundled_map(arguments.blender_python)).resolve()
    image = read_map(hdri)
    try:
        arguments.out.mkdir(parents=True, exist_ok=True)
        arguments.cache.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DemoError(f"cannot make {error.filename}: {error.strerror}; give another with --out") from error
    order = Order(
        blender_python=arguments.blender_python,
        addon=addon,
        hdri=hdri,
        rotation=samplers.brightest_azimuth(image) - LIGHT_FROM,
        quality=QUICK if arguments.quick else Quality(),
        seed=arguments.seed,
        methods={name: settings for name, (_, settings) in METHODS.items()},
    )
    columns = (TextColumn("{task.description:<34}"), BarColumn(40), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("Build and time the samplers", total=3)
        built = samplers.build_all(image, BLOCKS)
        progress.advance(task)
        build_seconds = samplers.build_times(image, BLOCKS)
        progress.advance(task)
        sample_nanoseconds = samplers.sample_times(built, order.seed)
        progress.advance(task)

        rendered = render_all(order, arguments.out, arguments.cache, progress)

        task = progress.add_task("Error figures and pictures", total=len(METHODS) + 1)
        halves = [skytree_core.read_image(str(file)) for file in rendered.reference]
        reference = (halves[0] + halves[1]) / 2
        images = {name: skytree_core.read_image(str(file)) for name, file in rendered.images.items()}
        write_exr(arguments.out / "reference.exr", reference)
        errors = {}
        for name in METHODS:
            errors[name] = metrics.error_figures(images[name], *halves)
            progress.advance(task)
        exposure = pictures.exposure_for(reference)
        summary = report.assemble(
            settings=settings_of(order, image, exposure),
            versions={**rendered.versions, "python": platform.python_version(), "numpy": np.__version__},
            titles={name: title for name, (title, _) in METHODS.items()},
            built=built,
            build_seconds=build_seconds,
            sample_nanoseconds=sample_nanoseconds,
            renders=rendered.times,
            errors=errors,
        )
        draw(arguments.out, image, built, reference, images, exposure, summary)
        if arguments.publish:
            publish(arguments.out, arguments.publish)
        progress.advance(task)
    (arguments.out / "report.json").write_text(json.dumps(summary, indent=2, ensure_ascii=False) + "\n")
    return summary


def newest_zip() -> Path:
    found = sorted((ROOT / "dist").glob("skytree-*.zip"), key=lambda file: file.stat().st_mtime)
    if not found:
        raise DemoError("there is no dist/skytree-*.zip yet: ./build_addon.py demo makes it")
    return found[-1]


def bundled_map(blender_python: Path, name: str = DEFAULT_MAP) -> Path:
    pattern = f"lib/python3*/site-packages/bpy/*/datafiles/studiolights/world/{name}"
    found = sorted(blender_python.parent.parent.glob(pattern))
    if not found:
        raise DemoError(f"this Blender has no {name} among its data files: give a map with --hdri")
    return found[-1]


def read_map(file: Path) -> np.ndarray:
    try:
        return skytree_core.read_image(str(file))
    except (OSError, ValueError, RuntimeError) as error:
        raise DemoError(f"the map cannot be read: {error}") from error


def write_exr(file: Path, image: np.ndarray) -> None:
    """Writes (H,W,3) as 32-bit float."""
    spec = OpenImageIO.ImageSpec(image.shape[1], image.shape[0], 3, OpenImageIO.FLOAT)
    spec["compression"] = "zip"
    buffer = OpenImageIO.ImageBuf(spec)
    buffer.set_pixels(OpenImageIO.ROI(), np.ascontiguousarray(image, np.float32))
    if not buffer.write(str(file)):
        raise DemoError(f"cannot write {file}: {buffer.geterror()}")


def settings_of(order: Order, image: np.ndarray, exposure: float) -> dict:
    """Everything that a second run needs to make the same images."""
    quality = order.quality
    return {
        "map": order.hdri.name,
        "map_sha256": hashlib.sha256(order.hdri.read_bytes()).hexdigest(),
        "map_size": [image.shape[1], image.shape[0]],
        "map_rotation_degrees": math.degrees(order.rotation),
        "image_size": [quality.width, quality.height],
        "samples_per_pixel": quality.samples,
        "reference_samples_per_pixel": 2 * quality.reference_samples,
        "max_bounces": quality.max_bounces,
        "block_count": BLOCKS,
        "seed": order.seed,
        "methods": order.methods,
        "view_transform": f"{pictures.VIEW_TRANSFORM}; exposure factor {exposure:.4g}",
    }


def draw(out: Path, image, built: dict, reference, images: dict, exposure: float, summary: dict) -> None:
    """All pictures of the demo."""
    settings = summary["settings"]
    map_name, spp = settings["map"], settings["samples_per_pixel"]
    count = settings["reference_samples_per_pixel"]
    columns = [
        pictures.Column("Reference", [f"{count} samples per pixel", f"exposure × {exposure:.3g}"], reference)
    ]
    pictures.view(reference, exposure).save(out / "reference.png")
    factor = pictures.difference_factor(reference, images.values(), exposure)
    for name, (title, _) in METHODS.items():
        figures = summary["methods"][name]
        tables = "tables " + report.bytes_text(figures["table_bytes"])
        error, nanoseconds = figures["error"]["nrmse_tc"], figures["sample_nanoseconds"]
        notes = [
            f"{spp} samples per pixel, error {100 * error:.1f} %",
            f"{tables}, {nanoseconds:.0f} ns a sample",
        ]
        columns.append(pictures.Column(title, notes, images[name]))
        pictures.view(images[name], exposure).save(out / f"{name}.png")
        pictures.difference(images[name], reference, exposure, factor).save(out / f"{name}_difference.png")
    title = f"Light of {map_name}, the environment sampled in three ways at equal samples"
    pictures.sheet(title, columns, CROPS, exposure, factor).save(out / "comparison.png")
    for name in ("kdtree", "kdtree_paper"):
        tree, method = built[name], METHODS[name][0]
        text = f"{map_name}: {tree.block_count} blocks. {method}"
        pictures.blocks(image, tree.bounds, text).save(out / f"blocks_{name}.png")
        text = f"{map_name}, and rebuilt from {tree.block_count} blocks. {method}"
        pictures.rebuilt(image, tree.reconstruct(), text).save(out / f"rebuilt_{name}.png")
    paper = built["kdtree_paper"]
    pictures.pdf_plot(out / "pdf.png", paper.empirical, paper.alpha, paper.fit_error, map_name)


def publish(out: Path, folder: Path) -> None:
    """Small copies of the pictures that the documentation shows."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures.shrunk(out / "comparison.png", 1400).save(folder / "demo.png", optimize=True)
    pictures.shrunk(out / "blocks_kdtree.png", 1024).save(folder / "blocks.png", optimize=True)
    pictures.shrunk(out / "rebuilt_kdtree_paper.png", 640).save(folder / "rebuilt.png", optimize=True)
    pictures.shrunk(out / "pdf.png", 1024).save(folder / "pdf.png", optimize=True)


if __name__ == "__main__":
    sys.exit(main())
