#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the figures of Ergun, Kurt and Ozturk (SCCG 2012) from real maps, and the pages that show them.

`./build_addon.py figures` builds what this needs and runs it.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib
import json
import os
import sys
import time
import traceback
from collections.abc import Iterator
from pathlib import Path

# Pictures, error figures and the teapot are the demo's.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "demo"))

import pages
import skytree_core
from context import Context
from maps import MapError, Maps
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
# Modules beside this file, in the order of docs/results.md.
FIGURES = (
    "figure1",
    "figure2",
    "figure3",
    "figure4",
    "figure5",
    "figure6",
    "figure7",
    "methods",
    "brdf",
    "tutorial",
)
# What several figures are made with: a change makes all of them again.
COMMON = (
    *(HERE / name for name in ("context.py", "maps.py", "stage.py", "plots.py")),
    *(
        HERE.parent / "demo" / name
        for name in ("metrics.py", "pictures.py", "samplers.py", "shapes.py", "teapot.py")
    ),
)


def main() -> int:
    arguments, console = parse(sys.argv[1:]), Console()
    started = time.monotonic()
    try:
        maps = Maps(arguments.blender_python if arguments.blender_python.exists() else None)
        if arguments.pages:
            page, missing = pages.write(HERE / "text", arguments.out, FIGURES, maps)
            without = f", without {', '.join(missing)}, which have not been made" if missing else ""
            console.print(f"Wrote {page}{without}", highlight=False)
            return 0
        failed = make_all(arguments, maps, console)
    except KeyboardInterrupt:
        console.print(
            "Stopped. What is finished is kept; the same command goes on from there.", highlight=False
        )
        return 130
    except (MapError, pages.PageError) as error:
        console.print(f"figures: {error}", style="red", markup=False, highlight=False)
        return 1
    minutes, worked = (time.monotonic() - started) / 60, time.process_time() / 60
    console.print(
        f"{len(arguments.only) - failed} of {len(arguments.only)} figures are in {arguments.out} "
        f"({minutes:.1f} minutes, {worked:.1f} of processor time).",
        highlight=False,
    )
    return 1 if failed else 0


def parse(words: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="build_addon.py figures", description=__doc__.split("\n")[0])
    parser.add_argument(
        "--only",
        nargs="+",
        choices=FIGURES,
        default=list(FIGURES),
        metavar="NAME",
        help=f"leave the others out: {', '.join(FIGURES)}",
    )
    parser.add_argument("--quick", action="store_true", help="two maps and coarse renders, for a first look")
    parser.add_argument("--again", action="store_true", help="also make what is finished")
    parser.add_argument(
        "--pages",
        action="store_true",
        help="write results.md from the tables that are there, and nothing else",
    )
    parser.add_argument("--out", type=Path, help="folder for pictures and tables (default: docs/figures)")
    parser.add_argument("--blender-python", type=Path, default=ROOT / "build" / "bpy-4.5" / "bin" / "python")
    arguments = parser.parse_args(words)
    if arguments.out is None:
        arguments.out = ROOT / ("build/figures-quick" if arguments.quick else "docs/figures")
    arguments.out = arguments.out.resolve()
    return arguments


def make_all(arguments: argparse.Namespace, maps: Maps, console: Console) -> int:
    """Makes what is not finished, then the pages; returns how many figures failed."""
    arguments.out.mkdir(parents=True, exist_ok=True)
    failed = 0
    columns = (
        TextColumn("{task.description:<46}"),
        BarColumn(40),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        bar = progress.add_task("[bold]All figures", total=len(arguments.only))
        for name in arguments.only:
            failed += not make_one(name, arguments, maps, progress)
            progress.advance(bar)
    if not failed and set(arguments.only) == set(FIGURES):
        pages.write(HERE / "text", arguments.out, FIGURES, maps)
    return failed


def make_one(name: str, arguments: argparse.Namespace, maps: Maps, progress: Progress) -> bool:
    """False if it failed; the traceback is printed and the other figures are still made."""
    module = importlib.import_module(name)
    context = Context(maps, arguments.out, arguments.quick)
    stamp = stamp_file(name, arguments.out)
    digest = inputs_digest(name, module, context)
    if not arguments.again and is_finished(stamp, digest, arguments.out):
        progress.console.print(f"{module.TITLE}: finished before", highlight=False)
        return True
    bar = progress.add_task(module.TITLE, total=1)
    context.on_progress = lambda done, total: progress.update(bar, completed=done, total=total)
    started = time.monotonic()
    try:
        module.make(context)
    except Exception:
        progress.console.print(f"{module.TITLE} failed:", style="red", highlight=False)
        progress.console.print(traceback.format_exc(), markup=False, highlight=False)
        return False
    finally:
        progress.stop_task(bar)
    stamp.parent.mkdir(parents=True, exist_ok=True)
    with replacing(stamp) as file:
        file.write_text(
            json.dumps({"inputs": digest, "outputs": output_digests(arguments.out, context.outputs)})
        )
    if not progress.console.is_terminal:
        progress.console.print(f"{module.TITLE}: {time.monotonic() - started:.0f} s", highlight=False)
    return True


def stamp_file(name: str, out: Path) -> Path:
    place = hashlib.sha256(str(out).encode()).hexdigest()[:8]
    return ROOT / "build" / "figures" / f"{name}-{place}.json"


def inputs_digest(name: str, module, context: Context) -> str:
    """Of all that a figure depends on: code, core, maps, coarseness."""
    digest = hashlib.sha256(repr((name, context.quick)).encode())
    extra = [HERE / file for file in getattr(module, "INPUTS", ())]
    package = Path(skytree_core.__file__).parent
    core = [Path(skytree_core._native.__file__), *sorted(package.glob("*.py"))]
    for file in (HERE / f"{name}.py", *COMMON, *extra, *core):
        digest.update(file.read_bytes())
    for entry in context.maps.all:
        digest.update(f"{entry.name} {entry.digest()}".encode())
    return digest.hexdigest()


def output_digests(out: Path, names: list[str]) -> dict[str, str]:
    return {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in names}


def is_finished(stamp: Path, digest: str, out: Path) -> bool:
    try:
        told = json.loads(stamp.read_text())
        return told["inputs"] == digest and output_digests(out, list(told["outputs"])) == told["outputs"]
    except (OSError, ValueError, KeyError, TypeError):
        return False


@contextlib.contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """A name to write to that becomes `file` when all is written."""
    part = file.with_name(f"{file.name}.{os.getpid()}.part")
    yield part
    os.replace(part, file)


if __name__ == "__main__":
    sys.exit(main())
