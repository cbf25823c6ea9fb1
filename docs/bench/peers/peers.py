#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Skytree against Cycles and Mitsuba: error at equal time and at equal samples, engines timed inside Blender.

`./build_addon.py bench --peers` runs it; by hand, from build/venv:

    python docs/bench/peers/peers.py [--quick] [--case PART] [--set NAME=VALUE] [--zip ZIP] [--llvm LIBRARY]

Each case (cases.py) is measured in rounds in which all methods take turns, and kept in build/peers-cache when
it is done: an interrupted run goes on where it was. References are kept too, so a second run is shorter.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
sys.path[:0] = [str(HERE), str(HERE.parent), str(HERE.parents[1] / "demo")]
import benchmarks_page  # noqa: E402
import figures  # noqa: E402
import peers_page  # noqa: E402
from analysis import Result, rows  # noqa: E402
from cases import HEIGHT, SAMPLES, SEEDS, WIDTH, Case, all_cases, quick_cases  # noqa: E402
from demo import DemoError, bundled_map, newest_zip  # noqa: E402
from measuring import measure, steps_of  # noqa: E402
from stores import Renderers  # noqa: E402
from worker import Worker, WorkerError  # noqa: E402

BLENDER = ROOT / "build" / "bpy-4.5" / "bin" / "python"
MITSUBA = ROOT / "build" / "venv-mitsuba" / "bin" / "python"
CACHE = ROOT / "build" / "peers-cache"
REPORTS = ROOT / "build" / "reports"


@contextmanager
def open_blender(archive: Path, wheel: str = "") -> Iterator[Renderers]:
    """Skytree and Cycles alone."""
    logs = ROOT / "build" / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    CACHE.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory(dir=CACHE) as scratch,
        Worker(
            BLENDER, HERE / "blender_worker.py", {"zip": str(archive)}, logs / "peers-blender.log"
        ) as blender,
    ):
        yield Renderers(blender, None, CACHE, Path(scratch), wheel)


@contextmanager
def open_renderers(archive: Path, wheel: str, llvm: str) -> Iterator[Renderers]:
    """All three."""
    variables = {"DRJIT_LIBLLVM_PATH": llvm} if llvm else {}
    log = ROOT / "build" / "logs" / "peers-mitsuba.log"
    with (
        open_blender(archive, wheel) as renderers,
        Worker(MITSUBA, HERE / "mitsuba_worker.py", {}, log, **variables) as mitsuba,
    ):
        renderers.mitsuba = mitsuba
        yield renderers


def run_folder(wheel: str, cases: list[Case], overrides: dict) -> Path:
    """Where the finished cases of this run lie: those of an interrupted run of the same kind are kept."""
    facts = f"{wheel} {SAMPLES} {SEEDS} {WIDTH} {HEIGHT} {[c.key for c in cases]} {sorted(overrides.items())}"
    folder = CACHE / "runs" / hashlib.sha256(facts.encode()).hexdigest()[:12]
    if (folder / "finished").exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def measure_all(
    cases: list[Case], renderers: Renderers, folder: Path, progress: Progress, minutes: float | None
) -> list[Result]:
    """The cases that are not in folder are measured, and written there: all, or those begun in `minutes`."""
    started = time.monotonic()
    open_cases = [case for case in cases if not (folder / f"{case.key}.json").exists()]
    bar = progress.add_task("", total=steps_of(len(open_cases)))
    for case in open_cases:
        if minutes is not None and time.monotonic() - started > 60 * minutes:
            break
        progress.update(bar, description=case.key)
        map_file = bundled_map(BLENDER, f"{case.map}.exr")
        measured = measure(renderers, case, map_file, lambda: progress.advance(bar))
        unfinished = folder / "unfinished"
        unfinished.write_text(json.dumps(measured))
        unfinished.replace(folder / f"{case.key}.json")
        if not progress.console.is_terminal:
            progress.console.print(
                f"{case.key}: done, {cases.index(case) + 1} of {len(cases)}", highlight=False
            )
    finished = [folder / f"{case.key}.json" for case in cases]
    return [Result.read(json.loads(file.read_text())) for file in finished if file.exists()]


def write_reports(results: list[Result], versions: dict[str, str], name: str) -> None:
    REPORTS.mkdir(parents=True, exist_ok=True)
    table = rows(results)
    with (REPORTS / f"{name}.csv").open("w", newline="") as sink:
        writer = csv.DictWriter(sink, table[0].keys())
        writer.writeheader()
        writer.writerows(table)
    checks = {result.case.key: result.mean_differences() for result in results}
    document = {"versions": versions, "size": [WIDTH, HEIGHT], "seeds": len(SEEDS), "rows": table}
    (REPORTS / f"{name}.json").write_text(
        json.dumps({**document, "mean_differences": checks}, indent=1) + "\n"
    )


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "--quick", action="store_true", help="two scenes under two maps; docs stay as they are"
    )
    parser.add_argument(
        "--case", default="", metavar="PART", help="cases with this in their names, as room-city"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a setting of scene.skytree for best mode, as compensation=1; docs stay as they are",
    )
    parser.add_argument(
        "--minutes", type=float, help="start no further case after so long; the page says how many there are"
    )
    parser.add_argument("--zip", type=Path, help="the add-on; default: the newest dist/skytree-*.zip")
    parser.add_argument("--llvm", default="", help="LLVM's shared library for Mitsuba")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "benchmarks.md")
    parser.add_argument("--figures", type=Path, default=ROOT / "docs" / "images")
    return parser.parse_args()


def parse_settings(texts: list[str]) -> dict:
    """NAME=VALUE; a value that is no JSON is a text."""
    found = {}
    for text in texts:
        name, separator, value = text.partition("=")
        if not separator:
            raise DemoError(f"--set {text}: give NAME=VALUE, as compensation=1")
        try:
            found[name] = json.loads(value)
        except json.JSONDecodeError:
            found[name] = value
    return found


def chosen_cases(quick: bool, part: str) -> list[Case]:
    cases = [case for case in (quick_cases() if quick else all_cases()) if part in case.key]
    if not cases:
        raise DemoError(f"--case {part}: no case has that in its name, which is scene-map-bounces")
    return cases


def main() -> int:
    arguments, console = parse(), Console()
    columns = (TextColumn("{task.description:<20}"), BarColumn(40), TextColumn("{task.percentage:>3.0f} %"))
    try:
        archive = (arguments.zip or newest_zip()).resolve()
        wheel = hashlib.sha256(archive.read_bytes()).hexdigest()[:12]
        overrides = parse_settings(arguments.set)
        cases = chosen_cases(arguments.quick, arguments.case)
        with open_renderers(archive, wheel, arguments.llvm) as renderers:
            renderers.overrides = overrides
            if renderers.mitsuba.ready["variant"] != "llvm_ad_rgb":
                console.print("No LLVM: Mitsuba renders in scalar_rgb, several times slower.", style="yellow")
            folder = run_folder(wheel, cases, overrides)
            with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as progress:
                results = measure_all(cases, renderers, folder, progress, arguments.minutes)
            versions = renderers.versions
    except (WorkerError, DemoError) as failure:
        console.print(f"bench --peers: {failure}", style="red", markup=False, highlight=False)
        return 1
    if not results:
        console.print("bench --peers: no case was finished", style="red")
        return 1
    if len(results) == len(cases):
        (folder / "finished").touch()
    else:
        console.print(f"{len(results)} of {len(cases)} cases; the same command goes on with the others.")
    trial = arguments.quick or arguments.case or overrides
    name = "peers-quick" if trial else "peers"
    write_reports(results, versions, name)
    pictures = REPORTS if trial else arguments.figures
    figures.draw(results, pictures, name)
    section = peers_page.section(results, versions, f"images/{name}")
    console.print(section, markup=False, highlight=False, soft_wrap=True)
    if not trial:
        old = arguments.page.read_text() if arguments.page.exists() else ""
        arguments.page.write_text(benchmarks_page.merged(old, section))
    return 0


if __name__ == "__main__":
    sys.exit(main())
