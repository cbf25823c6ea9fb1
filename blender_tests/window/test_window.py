# SPDX-License-Identifier: GPL-3.0-or-later
"""Real window tests: Blender on a virtual screen (Xvfb), driven by driver.py, one process per scenario file.

Runs outside Blender. Screenshots stay in build/screenshots, or in $SKYTREE_SCREENSHOTS. With $SKYTREE_RUNS=5
each file is run five times, and of every figure the median and the largest are printed.
"""

import ast
import json
import os
import shutil
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
SCREENSHOTS = Path(os.environ.get("SKYTREE_SCREENSHOTS") or ROOT / "build" / "screenshots")
# Software OpenGL composes every pixel of the window: small is quick.
WIDTH, HEIGHT = 800, 520
LIMIT_SECONDS = 900
RUNS = int(os.environ.get("SKYTREE_RUNS") or 1)


def scenarios() -> list[tuple[str, str]]:
    found = []
    for file in sorted(HERE.glob("scenarios_*.py")):
        for node in ast.parse(file.read_text()).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("scenario_"):
                found.append((file.stem, node.name))
    return found


@pytest.fixture(scope="session")
def display():
    for program in ("Xvfb", "blender"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")
    read_end, write_end = os.pipe()
    command = ["Xvfb", "-displayfd", str(write_end), "-screen", "0", "1280x900x24", "+extension", "GLX"]
    server = subprocess.Popen(command, pass_fds=[write_end], stderr=subprocess.DEVNULL)
    os.close(write_end)
    with os.fdopen(read_end) as stream:
        number = stream.readline().strip()
    if not number:
        server.wait()
        pytest.skip("Xvfb does not start")
    yield f":{number}"
    server.terminate()
    server.wait()


_finished: dict[str, dict] = {}


def results_of(file: str, display: str) -> dict:
    """Results of all scenarios of a file, by name: those of the last run, or of the first that did not pass,
    with every figure as a list of what the runs gave."""
    if file in _finished:
        return _finished[file]
    figures: dict[str, dict[str, list[float]]] = {}
    for _ in range(RUNS):
        results = run_blender(file, display)
        found = {name: result for name, result in results.items() if isinstance(result, dict)}
        for name, result in found.items():
            for figure, value in result["figures"].items():
                figures.setdefault(name, {}).setdefault(figure, []).append(value)
            result["figures"] = figures.get(name, {})
        if not found or any(result["outcome"] != "passed" for result in found.values()):
            break
    _finished[file] = results
    return results


def run_blender(file: str, display: str) -> dict:
    """Results of all scenarios of a file, by name, of one run."""
    folder = SCREENSHOTS / file.removeprefix("scenarios_")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    out, log = folder / "results.json", folder / "blender.log"
    with tempfile.TemporaryDirectory(prefix="skytree-window-") as user:
        environment = os.environ | {
            "DISPLAY": display,
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "BLENDER_USER_SCRIPTS": os.path.join(user, "scripts"),
            "BLENDER_USER_CONFIG": os.path.join(user, "config"),
            "XDG_CACHE_HOME": os.path.join(user, "cache"),
        }
        os.makedirs(os.path.join(user, "scripts", "addons"))
        command = ["blender", "--factory-startup", "--enable-event-simulate", "-p", "0", "0", str(WIDTH),
                   str(HEIGHT), "--python-exit-code", "3", "--python", str(HERE / "driver.py"), "--",
                   str(HERE / f"{file}.py"), str(out)]  # fmt: skip
        started = time.monotonic()
        with open(log, "w") as stream:
            try:
                code = subprocess.run(
                    command, env=environment, stdout=stream, stderr=subprocess.STDOUT, timeout=LIMIT_SECONDS
                ).returncode
            except subprocess.TimeoutExpired:
                code = f"none: stopped after {LIMIT_SECONDS} s"
    results = json.loads(out.read_text()) if out.exists() else {}
    print(f"{file}: {time.monotonic() - started:.1f} s")
    results["exit code"], results["log"] = code, log
    return results


@pytest.mark.parametrize(("file", "scenario"), scenarios())
def test_scenario(file, scenario, display):
    results = results_of(file, display)
    if scenario not in results:
        tail = "\n".join(results["log"].read_text(errors="replace").splitlines()[-40:])
        pytest.fail(f"Blender ended (exit code {results['exit code']}) before this scenario:\n{tail}")
    result = results[scenario]
    for name, values in result["figures"].items():
        most = f", at most {max(values):.4g}, of {len(values)}" if len(values) > 1 else ""
        print(f"{name}: {statistics.median(values):.4g}{most}")
    if result["outcome"] == "skipped":
        pytest.skip(result["detail"])
    assert result["outcome"] == "passed", result["detail"]
