# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmarks of the samplers: run, and their ratios held against what Skytree promises."""

from __future__ import annotations

import json
import statistics
import subprocess
from dataclasses import dataclass
from pathlib import Path

from .environments import require_packages
from .packaging import build_native
from .steps import BUILD, ROOT, BuildError

REPORT = BUILD / "reports" / "bench.json"
# Interleaved, so that a disturbance of the machine meets all methods alike.
OPTIONS = (
    *("--benchmark_repetitions=5", "--benchmark_min_time=0.05", "--benchmark_display_aggregates_only=true"),
    *("--benchmark_enable_random_interleaving=true", "--benchmark_out_format=json"),
)


@dataclass(frozen=True)
class Promise:
    """A bound on the ratio of two figures of one run."""

    text: str
    above: str
    below: str
    bound: float
    at_least: bool

    def kept(self, ratio: float) -> bool:
        return ratio >= self.bound if self.at_least else ratio <= self.bound


PROMISES = (
    Promise(
        "sample: binary-search inversion over kd-tree",
        "sample/inversion_binary/4096",
        "sample/kdtree_fitted/4096",
        bound=10,
        at_least=True,
    ),
    Promise(
        "sample: guided inversion over kd-tree",
        "sample/inversion_guided/4096",
        "sample/kdtree_fitted/4096",
        bound=3,
        at_least=True,
    ),
    Promise(
        "sample: kd-tree, 8k map over 1k map",
        "sample/kdtree_fitted/8192",
        "sample/kdtree_fitted/1024",
        bound=1.3,
        at_least=False,
    ),
    Promise(
        "build: kd-tree over inversion tables",
        "build/kdtree_sse_fitted/4096",
        "build/inversion_binary/4096",
        bound=1,
        at_least=False,
    ),
)


def read_times(report: dict) -> dict[str, float]:
    """Median processor time of one iteration by benchmark, in the benchmark's own unit."""
    times: dict[str, list[float]] = {}
    for entry in report["benchmarks"]:
        if entry.get("run_type") == "iteration":
            times.setdefault(entry["run_name"], []).append(entry["cpu_time"])
    return {name: statistics.median(values) for name, values in times.items()}


def promise_table(times: dict[str, float]) -> tuple[str, int, int]:
    """A table of the promises, how many of them were broken, and how many were not measured."""
    lines, broken, missing = [], 0, 0
    for promise in PROMISES:
        wanted = f"promised {'≥' if promise.at_least else '≤'} {promise.bound:g}×"
        if promise.above in times and promise.below in times:
            ratio = times[promise.above] / times[promise.below]
            broken += not promise.kept(ratio)
            found, verdict = f"{ratio:.2f}×", "kept" if promise.kept(ratio) else "NOT KEPT"
        else:
            missing += 1
            found, verdict = "-", "not measured"
        lines.append(f"{promise.text:<46}{found:>9}   {wanted}: {verdict}")
    return "\n".join(lines), broken, missing


def bench_samplers(options: list[str]) -> int:
    """Runs Google Benchmark and prints the ratios; returns how many promises were not kept."""
    require_packages("build", "bench")
    program = build_native("native-test", "skytree_bench", "-DSKYTREE_BENCH=ON")
    REPORT.parent.mkdir(parents=True, exist_ok=True)
    run_visibly("The benchmarks of the samplers", [program, *OPTIONS, f"--benchmark_out={REPORT}", *options])
    table, broken, missing = promise_table(read_times(json.loads(REPORT.read_text())))
    print(f"\n{table}\n", flush=True)
    filtered = any(option.startswith("--benchmark_filter") for option in options)
    return broken if filtered else broken + missing


def run_visibly(title: str, command: list[str | Path]) -> None:
    """Runs a program that shows its own progress."""
    if subprocess.run([str(part) for part in command], cwd=ROOT).returncode:
        raise BuildError(f"{title} failed; what was printed above says why.")
