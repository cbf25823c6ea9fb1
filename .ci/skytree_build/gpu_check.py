# SPDX-License-Identifier: GPL-3.0-or-later
"""The CUDA tests and benchmarks as one archive, for a machine with a GPU where nothing can be built: it needs
NVIDIA's driver there, and a glibc and libstdc++ no older than this machine's."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from .environments import blender_module, environment, require_packages
from .packaging import DIST, build_native, build_wheel
from .steps import ROOT, run
from .testing import SANITIZED

SCRIPT = Path(__file__).with_name("gpu_check.sh")
PACKAGES = ("numpy", "pytest", "OpenImageIO", "matplotlib", "pillow", "rich", "skytree_core")
SOURCES = ("docs/bench", "docs/demo", "docs/make_figures", "native/python/tests/test_cuda.py")
# What every Linux has, in a version that fits its kernel and its driver.
SYSTEM_LIBRARIES = re.compile(r"(ld-linux.*|libc|libm|libdl|librt|libpthread|libstdc\+\+|libgcc_s)\.so")
UNUSED = (
    *("site-packages", "dist-packages", "config-3*", "__pycache__"),
    *("test", "_tkinter*", "idlelib", "tkinter", "lib2to3", "ensurepip", "turtledemo", "pydoc_data"),
)
# Files of the packages above and of what they require, by distribution; run by their interpreter.
LIST_FILES = """
import importlib.metadata as metadata, json, re, sys
found = {}
def walk(name):
    distribution = metadata.distribution(name)
    if distribution.name in found:
        return
    found[distribution.name] = [[str(f), str(f.locate())] for f in distribution.files]
    for need in distribution.requires or ():
        name, _, condition = need.partition(";")
        if "extra" not in condition:
            try:
                walk(re.match(r"[\\w.-]+", name)[0])
            except metadata.PackageNotFoundError:  # for another Python or system
                pass
for name in sys.argv[1:]:
    walk(name)
print(json.dumps([file for files in found.values() for file in files]))
"""


def pack_gpu_check() -> Path:
    """dist/skytree-gpu-check.tar.xz: unpack it on the other machine, and run skytree-gpu-check/check.sh."""
    require_packages("build", "test")
    program = build_native("native-test", "skytree_tests", "-DSKYTREE_TESTS=ON")
    build_wheel()
    python, archive = environment("venv", "tools", "3.11"), DIST / "skytree-gpu-check.tar.xz"
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / "skytree-gpu-check"
        pack_program(program, folder)
        pack_python(python, folder / "python")
        for source in SOURCES:
            copy(ROOT / source, folder / source)
        pack_maps(folder / "shared" / "hdri")
        script = folder / "check.sh"
        script.write_text(SCRIPT.read_text().replace("@FEW@", f"'{SANITIZED}'"))
        script.chmod(0o755)
        DIST.mkdir(exist_ok=True)
        run(f"Pack {archive.name}", ["tar", "-C", made, "-cJf", archive, folder.name])
    return archive


def pack_program(program: Path, folder: Path) -> None:
    copy(program, folder / "bin" / program.name)
    for name, file in shared_libraries(program).items():
        copy(file, folder / "lib" / name)


def shared_libraries(program: Path) -> dict[str, Path]:
    """What the loader would load with it, but for the system's own; name to file."""
    said = subprocess.run(["ldd", program], capture_output=True, text=True, check=True).stdout
    found = re.findall(r"^\s*(\S+) => (\S+)", said, re.MULTILINE)
    return {name: Path(file) for name, file in found if not SYSTEM_LIBRARIES.match(name)}


def pack_python(python: Path, folder: Path) -> None:
    """An interpreter that PYTHONHOME can move, and the packages that the tests and figures import."""
    asked = "import sys, sysconfig; print(sys._base_executable, sysconfig.get_path('stdlib'))"
    base, library = subprocess.run(
        [python, "-c", asked], capture_output=True, text=True, check=True
    ).stdout.split()
    copy(Path(base), folder / "bin" / "python3")
    copy(Path(library), folder / "lib" / Path(library).name)
    modules = [Path(base), *(folder / "lib" / Path(library).name / "lib-dynload").glob("*.so")]
    for name, file in {name: f for module in modules for name, f in shared_libraries(module).items()}.items():
        copy(file, folder.parent / "lib" / name)
    command = [python, "-c", LIST_FILES, *PACKAGES]
    files = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    for name, file in files:
        unused = "/tests/" in name or "cpython-313" in name or "__pycache__" in name
        if not name.startswith("..") and not unused:
            copy(Path(file), folder / "packages" / name)


def pack_maps(folder: Path) -> None:
    """Those that the figures are made from, here in one folder."""
    shared = os.environ.get("SKYTREE_SHARED")
    worlds = blender_module("4.5").parent.parent.glob(
        "lib/python3*/site-packages/bpy/*/datafiles/studiolights/world/*.exr"
    )
    probes = [f for f in (Path(shared) / "hdri").iterdir() if f.is_file()] if shared else []
    for file in [*probes, *worlds]:
        copy(file, folder / file.name)


def copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.is_dir():
        ignored = shutil.ignore_patterns(*UNUSED)
        shutil.copytree(source, target, ignore=ignored, ignore_dangling_symlinks=True)
    else:
        shutil.copy(source, target)
