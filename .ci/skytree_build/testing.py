# SPDX-License-Identifier: GPL-3.0-or-later
"""The test suites, each a part that reports how many tests passed, failed and were skipped."""

from __future__ import annotations

import os
import re
import shutil
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from .cuda import cuda_test_environment, has_gpu
from .environments import BLENDERS, blender_module, environment, find_python, left_out, require_packages
from .packaging import build_native, build_wheel, install_wheel, package
from .steps import BUILD, ROOT, BuildError, Finished, relative, run

BLENDER_TESTS = ROOT / "blender_tests"

# Debian's Blender looks for packages beside the first python3 on PATH; pyenv's has no numpy.
DEBIAN_FIRST = {"PATH": f"/usr/bin:{os.environ.get('PATH', '')}"}
MOST_REASON_LINES = 120
# What NVIDIA's checkers see: single kernels, and images with all options, of two views at a time.
SANITIZED = "CudaTest.SamplersAnd*:CudaTest.OptionsReachTheDevice:CudaTest.TwoViews*"
IN_BLENDER = (BLENDER_TESTS, f"--ignore={BLENDER_TESTS / 'window'}")


@dataclass
class Outcome:
    """What one part of the tests came to; a part that broke before it counted anything is one failure."""

    passed: int = 0
    failed: int = 0
    skipped: int = 0
    note: str = ""
    closing: list[str] = field(default_factory=list)


def read_junit(report: Path, finished: Finished) -> Outcome:
    """Counts the tests of a JUnit file (pytest, GoogleTest); a bad exit code outweighs what the file says."""
    outcome = Outcome(closing=closing_lines(finished.log))
    reasons = []
    if report.exists():
        for case in ElementTree.parse(report).iter("testcase"):
            broken = case.find("failure") if case.find("failure") is not None else case.find("error")
            if broken is not None:
                outcome.failed += 1
                reasons += [f"  {case.get('classname')} {case.get('name')}", *reason_lines(broken)]
            elif case.find("skipped") is not None or case.get("status") == "notrun":
                outcome.skipped += 1
            else:
                outcome.passed += 1
    if finished.returncode and not outcome.failed:
        outcome.failed, outcome.note = 1, f"ended with exit code {finished.returncode}"
    elif not outcome.passed and not outcome.failed:
        outcome.failed, outcome.note = 1, "ran no test"
    if outcome.failed:
        # A report that names no failure was cut short: the end of the log has to say why.
        outcome.closing[:0] = reasons[:MOST_REASON_LINES] or finished.tail().splitlines()
        outcome.closing.append(f"  the whole log: {relative(finished.log)}")
    return outcome


def reason_lines(broken: ElementTree.Element, most: int = 12) -> list[str]:
    """The end of a failed test's traceback, which has the assertion, indented."""
    text = (broken.text or "").strip() or broken.get("message") or "no reason given"
    return [f"      {line}" for line in text.splitlines()[-most:]]


def closing_lines(log: Path) -> list[str]:
    pattern = re.compile(
        r"^\[\s+(PASSED|SKIPPED|FAILED)\s+\] \d+ tests?|^\[=+\] \d+ tests? .*ran|^=+ .* in [\d.:]+"
    )
    return [line for line in log.read_text(errors="replace").splitlines() if pattern.match(line)][-4:]


def fresh_report(name: str) -> Path:
    report = BUILD / "reports" / f"{name}.xml"
    report.parent.mkdir(parents=True, exist_ok=True)
    report.unlink(missing_ok=True)
    return report


def google_test(folder: str, *settings: str, filter: str = "*", **variables) -> Outcome:
    require_packages("build", "test")
    program = build_native(folder, "skytree_tests", "-DSKYTREE_TESTS=ON", *settings)
    report = fresh_report(folder)
    return read_junit(
        report,
        run(
            f"Run {folder}",
            [program, f"--gtest_output=xml:{report}", f"--gtest_filter={filter}"],
            check=False,
            **variables,
        ),
    )


def test_core() -> Outcome:
    return google_test("native-test")


def test_cuda() -> Outcome:
    """All that runs CUDA kernels: what a machine with a GPU should see pass (docs/cuda.md)."""
    outcomes = [google_test("native-test", filter="Cuda*:*/Cuda*")]
    wheel, python = build_wheel(), environment("venv", "tools", "3.11")
    install_wheel(python, wheel)
    tests = ROOT / "native" / "python" / "tests" / "test_cuda.py"
    outcomes.append(pytest("cuda-python", [python, "-m", "pytest"], tests))
    if find_python(BLENDERS["4.5"]):
        archive, blender = package(), blender_module("4.5")
        tests = BLENDER_TESTS / "test_devices.py"
        outcomes.append(pytest("cuda-blender", [blender, "-m", "pytest"], tests, SKYTREE_ZIP=archive))
    outcomes.append(compute_sanitizer())
    return added(outcomes)


def compute_sanitizer() -> Outcome:
    """NVIDIA's checkers over the tests of single kernels and of one image; only on a GPU."""
    program = shutil.which("compute-sanitizer")
    if not program or not has_gpu():
        reason = "there is no GPU" if program else "it is not on PATH"
        return Outcome(skipped=1, closing=[f"[ SKIPPED ] NVIDIA's compute-sanitizer: {reason}"])
    outcome, tests = Outcome(), BUILD / "native-test" / "native" / "skytree_tests"
    for tool in ("memcheck", "racecheck", "initcheck", "synccheck"):
        command = [program, "--tool", tool, "--error-exitcode", "9", tests, f"--gtest_filter={SANITIZED}"]
        finished = run(f"Run compute-sanitizer {tool}", command, check=False)
        outcome.passed += not finished.returncode
        outcome.failed += bool(finished.returncode)
        outcome.closing += finished.tail().splitlines() if finished.returncode else [f"{tool}: clean"]
    return outcome


def added(outcomes: list[Outcome]) -> Outcome:
    return Outcome(
        sum(o.passed for o in outcomes),
        sum(o.failed for o in outcomes),
        sum(o.skipped for o in outcomes),
        "; ".join(o.note for o in outcomes if o.note),
        [line for o in outcomes for line in o.closing],
    )


def test_sanitizers() -> Outcome:
    # No build type, hence no NDEBUG: assertions are on.
    settings = [
        "-DSKYTREE_SANITIZE=address,undefined",
        "-DCMAKE_BUILD_TYPE=None",
        "-DCMAKE_CXX_FLAGS=-O1 -g1",
        "-DSKYTREE_CUDA=OFF",  # its kernels run outside what a sanitizer sees
    ]
    variables = {
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "ASAN_OPTIONS": "detect_leaks=0",  # its tracer crashes here; tests count objects
        "SKYTREE_CUDA_DRIVER": "none",  # the emulator's own translations do not run under the sanitizer
    }
    return google_test("native-sanitize", *settings, **variables)


def pytest(name: str, command: list, *arguments, **variables) -> Outcome:
    report = fresh_report(name)
    options = ["-p", "no:cacheprovider", "--color=no", f"--junitxml={report}"]
    return read_junit(report, run(f"Run {name}", [*command, *options, *arguments], check=False, **variables))


def test_python(version: str) -> Outcome:
    wheel = build_wheel()
    if not find_python(version):
        return Outcome(note=f"left out: {left_out(version)}")
    python = environment("venv" if version == "3.11" else f"venv-{version}", PYTHON_GROUPS[version], version)
    install_wheel(python, wheel)
    return pytest(f"python-{version}", [python, "-m", "pytest"], ROOT / "native" / "python" / "tests")


PYTHON_GROUPS = {"3.11": "tools", "3.13": "core-test"}


def test_demo() -> Outcome:
    build_wheel()
    folders = [ROOT / "docs" / part for part in ("demo", "bench", "make_figures")]
    return pytest("demo", [environment("venv", "tools", "3.11"), "-m", "pytest"], *folders)


def test_blender_module(version: str) -> Outcome:
    if not find_python(BLENDERS[version]):
        return Outcome(note=f"left out: {left_out(BLENDERS[version])}")
    archive, python = package(), blender_module(version)
    return pytest(f"blender-{version}", [python, "-m", "pytest"], *IN_BLENDER, SKYTREE_ZIP=archive)


def test_debian_blender() -> Outcome:
    """Debian's Blender is a program with Debian's Python in it, so pytest comes from a folder of its own."""
    require_packages("build", "test")
    archive = package()
    packages = (
        environment("pytest-3.4", "blender-3-4", "3.11").parent.parent
        / "lib"
        / "python3.11"
        / "site-packages"
    )
    runner = BLENDER_TESTS / "run_in_blender.py"
    command = ["blender", "-b", "--factory-startup", "--python-exit-code", "3", "--python", runner, "--"]
    return pytest(
        "blender-3.4", command, *IN_BLENDER, SKYTREE_ZIP=archive, SKYTREE_PYTEST=packages, **DEBIAN_FIRST
    )


def test_window() -> Outcome:
    """Debian's Blender in a window on a virtual screen, driven from outside."""
    require_packages("build", "test", "window")
    archive, python, tests = package(), environment("venv", "tools", "3.11"), BLENDER_TESTS / "window"
    # Cut off from the tests above, whose conftest.py imports bpy.
    command = [python, "-m", "pytest", f"--confcutdir={tests}"]
    return pytest("window", command, tests, SKYTREE_ZIP=archive, **DEBIAN_FIRST)


def test_lint() -> Outcome:
    require_packages("build", "test")
    tools = environment("venv", "tools", "3.11").parent
    folders = [ROOT / "native", ROOT / "cuda"]
    sources = sorted(
        f for folder in folders for f in folder.rglob("*") if f.suffix in {".cpp", ".h", ".cu", ".cuh"}
    )
    checks = {
        "clang-format": ["clang-format", "--dry-run", "-Werror", *sources],
        "ruff check": [tools / "ruff", "check", "--quiet", "."],
        "ruff format": [tools / "ruff", "format", "--check", "--quiet", "."],
    }
    outcome = Outcome()
    for name, command in checks.items():
        finished = run(f"Run {name}", command, check=False)
        outcome.failed += finished.returncode != 0
        outcome.passed += finished.returncode == 0
        outcome.closing += finished.tail().splitlines() if finished.returncode else [f"{name}: clean"]
    return outcome


def test_builder() -> Outcome:
    archive, python = package(), environment("venv", "tools", "3.11")
    return pytest("builder", [python, "-m", "pytest"], ROOT / ".ci" / "tests", SKYTREE_ZIP=archive)


# `cuda` is made of tests of the other parts, so it runs only where it is asked for.
TEST_PARTS: dict[str, Callable[[], Outcome]] = {
    "lint": test_lint,
    "core": test_core,
    "python-3.11": lambda: test_python("3.11"),
    "python-3.13": lambda: test_python("3.13"),
    "demo": test_demo,
    "blender-4.5": lambda: test_blender_module("4.5"),
    "blender-3.4": test_debian_blender,
    "blender-5.2": lambda: test_blender_module("5.2"),
    "window": test_window,
    "builder": test_builder,
    "sanitizers": test_sanitizers,
    "cuda": test_cuda,
}


def run_tests(parts: list[str]) -> int:
    """Runs every part even if one fails; returns the number of failures."""
    outcomes: dict[str, Outcome] = {}
    parts = parts or [part for part in TEST_PARTS if part != "cuda"]
    if any(part.startswith(("core", "python", "blender", "window", "cuda", "builder")) for part in parts):
        os.environ.update(cuda_test_environment())
    for part in parts:
        try:
            outcomes[part] = TEST_PARTS[part]()
        except BuildError as failure:
            outcomes[part] = Outcome(failed=1, note="could not be run", closing=str(failure).splitlines())
        print("\n".join(outcomes[part].closing), flush=True)
    print(f"\n{'part':<14}{'passed':>8}{'failed':>8}{'skipped':>9}")
    for part, outcome in outcomes.items():
        print(
            f"{part:<14}{outcome.passed:>8}{outcome.failed:>8}{outcome.skipped:>9}  {outcome.note}".rstrip()
        )
    passed, failed, skipped = (
        sum(getattr(o, k) for o in outcomes.values()) for k in ("passed", "failed", "skipped")
    )
    print(f"\n{passed} passed, {failed} failed, {skipped} skipped", flush=True)
    return failed
