#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds, packages, tests and demonstrates Skytree, from a bare Debian 12 with git and python3 on.

Needs Python 3.11 and its standard library only. What else a command needs it installs itself: Debian
packages (as root or through sudo) and private virtual environments under build/, with the versions pinned
in pyproject.toml. Steps whose inputs have not changed since the last run are skipped. The steps themselves
are in .ci/skytree_build.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

if sys.version_info < (3, 11):  # noqa: UP036 (told before the imports below fail)
    sys.exit("build_addon.py needs Python 3.11 or newer; this is %s (%s)." % (sys.version, sys.executable))  # noqa: UP031

sys.path.insert(0, str(Path(__file__).resolve().parent / ".ci"))
from skytree_build import environments
from skytree_build.benchmarks import bench_samplers, run_visibly
from skytree_build.environments import (
    BLENDERS,
    blender_module,
    cuda_compiler,
    environment,
    find_python,
    mitsuba_module,
)
from skytree_build.gpu_check import pack_gpu_check
from skytree_build.packaging import DIST, build_wheel, megabytes, package
from skytree_build.steps import ROOT, BuildError, relative
from skytree_build.testing import TEST_PARTS, run_tests

CUDA_BENCH = ROOT / "docs" / "bench" / "cuda_samplers.py"
RENDER_BENCH = ROOT / "docs" / "bench" / "render_vs_cycles.py"
PEERS_BENCH = ROOT / "docs" / "bench" / "peers" / "peers.py"


def command_build(_: argparse.Namespace) -> str:
    wheel = build_wheel()
    return f"Built {relative(wheel)} ({megabytes(wheel)}); build/venv/bin/python has it installed."


def command_package(_: argparse.Namespace) -> str:
    archive = package()
    wheel = next(DIST.glob("skytree_core-*.whl"))
    return f"Made {relative(archive)} ({megabytes(archive)}) for Blender, and {relative(wheel)} for pip."


def command_test(options: argparse.Namespace) -> str:
    started = time.monotonic()
    if run_tests(options.parts):
        sys.exit(1)
    minutes = (time.monotonic() - started) / 60
    return f"All tests passed in {minutes:.1f} minutes; logs and reports are in build/."


def command_demo(options: argparse.Namespace) -> str:
    archive, blender = package(), blender_module("4.5")
    python, out = environment("venv", "tools", "3.11"), options.out.resolve()
    command = [python, ROOT / "docs" / "demo" / "demo.py", "--zip", archive, "--blender-python", blender]
    command += ["--out", out]
    command += ["--hdri", options.hdri.resolve()] if options.hdri else []
    run_visibly("The demo", [*command, *options.further])
    return f"The demo's pictures and report.json are in {relative(out)}."


def command_compare(options: argparse.Namespace) -> str:
    archive, blender, out = package(), blender_module("4.5"), options.out.resolve()
    script = ROOT / ".ci" / "skytree_build" / "compare_in_blender.py"
    command = [blender, script, archive, options.file.resolve(), "--out", out, *options.further]
    run_visibly("The comparison", command)
    return f"The report is {relative(out / 'report.html')}."


def bench_peers(options: argparse.Namespace) -> str:
    archive, tools = package(), environment("venv", "tools", "3.11")
    blender_module("4.5")
    _, llvm = mitsuba_module()
    command = [tools, PEERS_BENCH, "--zip", archive, *options.further]
    run_visibly("The benchmark against Cycles and Mitsuba", [*command, *(["--llvm", llvm] if llvm else [])])
    trial = {"--quick", "--case", "--set"} & {word.split("=")[0] for word in options.further}
    return "The figures are in build/reports" + ("." if trial else " and docs/benchmarks.md.")


def command_bench(options: argparse.Namespace) -> str:
    if options.peers:
        return bench_peers(options)
    if options.only in (None, "cuda"):
        build_wheel()
        tools = environment("venv", "tools", "3.11")
        further = options.further if options.only else []  # without --only they are Google Benchmark's
        compiler = ["--nvcc", nvcc] if (nvcc := cuda_compiler()) else []
        run_visibly("The benchmark of the CUDA kernels", [tools, CUDA_BENCH, *compiler, *further])
    broken = bench_samplers(options.further) if options.only in (None, "samplers") else 0
    if options.only in (None, "renders"):
        archive = package()
        for version, python in BLENDERS.items():
            if find_python(python):
                blender_module(version)
        tools = environment("venv", "tools", "3.11")
        run_visibly("The render benchmark", [tools, RENDER_BENCH, "--zip", archive])
    if broken:
        raise BuildError(f"{broken} of the ratios promised above did not hold in this run.")
    pages = {
        None: "docs/benchmarks.md and docs/cuda_samplers.md",
        "renders": "docs/benchmarks.md",
        "cuda": "docs/cuda_samplers.md",
    }
    return (
        "The figures are in "
        + " and ".join(["build/reports", *filter(None, [pages.get(options.only)])])
        + "."
    )


def command_gpu_check(_: argparse.Namespace) -> str:
    archive = pack_gpu_check()
    return f"Made {relative(archive)} ({megabytes(archive)}); check.sh in it runs on a machine with a GPU."


def command_figures(options: argparse.Namespace) -> str:
    build_wheel()
    command = [environment("venv", "tools", "3.11"), ROOT / "docs" / "make_figures" / "make_figures.py"]
    command += ["--blender-python", blender_module("4.5"), *options.further]  # whose maps stand in
    run_visibly("Making the figures", command)
    return "docs/results.md and docs/tutorial.md show what docs/figures holds."


COMMANDS = {
    "demo": (command_demo, "render the demo scene in Blender 4.5 and write pictures and a report"),
    "test": (command_test, "run every test, also inside Blender 3.4, 4.5 and 5.2"),
    "build": (command_build, "build the Python package skytree_core"),
    "package": (command_package, "make the zip that Blender installs"),
    "bench": (command_bench, "measure the samplers, CUDA kernels, and renders against Cycles"),
    "compare": (command_compare, "compare two ways of sampling on a .blend file and write a report"),
    "gpu-check": (command_gpu_check, "pack the CUDA tests and benchmarks for another machine's GPU"),
    "figures": (command_figures, "make the paper's figures, docs/results.md and docs/tutorial.md"),
}


def parse_arguments(arguments: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="build_addon.py", description=__doc__.split("\n")[0])
    parser.add_argument("--no-apt", action="store_true", help="install no Debian packages, use what is there")
    commands = parser.add_subparsers(dest="command", required=True, metavar="command")
    added = {
        name: commands.add_parser(name, help=text, description=text) for name, (_, text) in COMMANDS.items()
    }
    added["demo"].add_argument("--hdri", type=Path, help="environment map (default: one that Blender brings)")
    added["demo"].add_argument(
        "--out", type=Path, default=ROOT / "demo", help="folder for the results (default: demo)"
    )
    added["compare"].add_argument("file", type=Path, help="the .blend file")
    added["compare"].add_argument(
        "--out", type=Path, default=Path("skytree_compare"), help="folder for the report"
    )
    added[
        "compare"
    ].epilog = (
        "Handed on: --a, --b, --samples or --seconds, --reference-samples, --seed, --size (docs/compare.md)"
    )
    added["figures"].epilog = "Handed on: --only NAME …, --quick, --again, --out DIR (docs/make_figures)"
    added["bench"].add_argument("--only", choices=("samplers", "renders", "cuda"), help="run this part only")
    added["bench"].add_argument(
        "--peers", action="store_true", help="against Cycles and Mitsuba instead; with --quick a few cases"
    )
    added["test"].add_argument("parts", nargs="*", help=f"run these parts only: {', '.join(TEST_PARTS)}")
    options, further = parser.parse_known_args(arguments)
    if further and options.command not in (
        "demo",
        "bench",
        "compare",
        "figures",
    ):  # these hand further options on
        parser.error(f"unknown: {' '.join(further)}")
    if unknown := [part for part in getattr(options, "parts", []) if part not in TEST_PARTS]:
        parser.error(f"unknown part {', '.join(unknown)}; there are {', '.join(TEST_PARTS)}")
    if getattr(options, "hdri", None) and not options.hdri.is_file():
        parser.error(f"--hdri {options.hdri}: there is no such file")
    if getattr(options, "file", None) and not options.file.is_file():
        parser.error(f"{options.file}: there is no such file")
    options.further = further
    return options


def main() -> None:
    options = parse_arguments(sys.argv[1:])
    environments.use_apt = not options.no_apt
    shared = ROOT.parent / "shared"
    if (shared / "hdri").is_dir():  # further environment maps, beside the repository where there are some
        os.environ.setdefault("SKYTREE_SHARED", str(shared))
    try:
        print(COMMANDS[options.command][0](options))
    except BuildError as failure:
        sys.exit(f"\n{failure}")
    except KeyboardInterrupt:
        sys.exit("\nStopped.")


if __name__ == "__main__":
    main()
