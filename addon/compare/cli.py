# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison report from the command line.

./build_addon.py compare FILE.blend --a kdtree --b inversion --out DIR      from a checkout
blender -b FILE.blend --command skytree_compare --a kdtree --b inversion    Blender 4.2 and later
bpy.ops.skytree.compare_report(folder=..., a=..., b=...)                    from a script
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy

from .job import ReportJob, side_choice
from .render import Progress

COMMAND = "skytree_compare"
METHOD_HELP = (
    "scene, kdtree, inversion, alias, uniform, bsdf, or for teaching median_cut, hierarchy, resampled or "
    "filtered (biased); kdtree may go on with blocks, split criterion and "
    "block probability: kdtree:1024:SSE:FITTED"
)


def parser() -> argparse.ArgumentParser:
    result = argparse.ArgumentParser(
        prog=COMMAND, description="Compare two ways to sample the world of this file."
    )
    add_arguments(result)
    return result


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.add_argument(
        "--a", default="scene", metavar="METHOD", help=f"what A is: {METHOD_HELP} (default: scene)"
    )
    to.add_argument("--b", default="inversion", metavar="METHOD", help="what B is (default: inversion)")
    clock = to.add_mutually_exclusive_group()
    clock.add_argument("--samples", type=int, help="equal samples: this many per pixel (default: the file's)")
    clock.add_argument(
        "--seconds",
        type=float,
        help="equal time: seconds of the device each: processor time of all threads, or a GPU's time",
    )
    to.add_argument("--reference-samples", type=int, help="samples per pixel of the reference")
    to.add_argument("--seed", type=int, help="start of the random numbers (default: the file's)")
    to.add_argument("--size", metavar="WxH", help="resolution (default: the file's)")
    to.add_argument("--out", type=Path, default=Path("skytree_compare"), help="folder for the report")


def main(arguments: list[str]) -> int:
    """Runs the comparison on the open file; returns an exit status."""
    options = parser().parse_args(arguments)
    scene = bpy.context.scene
    try:
        overrides = SimpleNamespace(
            a=side_choice(options.a),
            b=side_choice(options.b),
            samples=options.samples,
            seconds=options.seconds,
            reference_samples=options.reference_samples,
        )
        _set_size(scene, options.size)
        if options.seed is not None:
            scene.skytree.seed = options.seed
        job = ReportJob(scene, overrides)
        paths = job.run(options.out.resolve(), _Printer())
    except (ValueError, RuntimeError, OSError) as error:
        print(f"\nThe comparison failed: {error}", file=sys.stderr)
        return 1
    for line in job.summary():
        print(line)
    print(f"The report is {paths['html']}")
    return 0


def _set_size(scene, size: str | None) -> None:
    if size is None:
        return
    width, _, height = size.lower().partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise ValueError(f"--size {size}: give width and height in pixels, such as 640x360")
    scene.render.resolution_x, scene.render.resolution_y = int(width), int(height)
    scene.render.resolution_percentage = 100


class _Printer:
    """One line that is written again and again on a terminal, one line a stage elsewhere."""

    def __init__(self):
        self.stage = ""

    def __call__(self, progress: Progress) -> None:
        if sys.stdout.isatty():
            bar = "#" * round(30 * progress.fraction)
            print(
                f"\r[{bar:<30}] {100 * progress.fraction:3.0f} %  {progress.text:<50.50}", end="", flush=True
            )
            if progress.fraction >= 1.0:
                print()
        elif progress.text != self.stage:
            self.stage = progress.text
            print(progress.text, flush=True)


_handle = None


def register():
    global _handle
    if hasattr(bpy.utils, "register_cli_command"):
        _handle = bpy.utils.register_cli_command(COMMAND, main)


def unregister():
    global _handle
    if _handle is not None:
        bpy.utils.unregister_cli_command(_handle)
        _handle = None
