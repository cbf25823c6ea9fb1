# SPDX-License-Identifier: GPL-3.0-or-later
"""The wheel of skytree_core, the zip that Blender installs, and the CMake builds of tests and benchmarks."""

from __future__ import annotations

import functools
import os
import platform
import re
import shutil
import subprocess
import tempfile
import zipfile
from pathlib import Path

from .environments import (
    PROJECT,
    cuda_compiler,
    environment,
    find_python,
    left_out,
    require_packages,
    require_python,
)
from .steps import BUILD, DIST, ROOT, BuildError, content_hash, relative, run, sole_builder, up_to_date

VERSION: str = PROJECT["project"]["version"]
ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)


WHEEL_SOURCES = (
    *("pyproject.toml", "CMakeLists.txt", "README.md", "cuda"),
    *(f"native/{part}" for part in ("CMakeLists.txt", "bundle_embree.cmake", "kernel", "src", "python")),
)


@functools.cache
def build_wheel() -> Path:
    """dist/skytree_core-….whl with a module for each Python found, also installed in build/venv."""
    require_packages("build")
    tools = environment("venv", "tools", "3.11")
    pythons = {"3.11": require_python("3.11")}
    if newer := find_python("3.13"):
        pythons["3.13"] = newer
    else:
        print(f"• Left out: the module for Blender 5.1 and later ({left_out('3.13')})", flush=True)
    nvcc = cuda_compiler()
    print(
        f"• CUDA: {f'kernels by {relative(nvcc)}' if nvcc else 'left out, rendering is on the CPU alone'}",
        flush=True,
    )
    tags = [f"cp{version.replace('.', '')}-none-{platform_tag()}" for version in pythons]
    name = f"skytree_core-{VERSION}-{'.'.join(tag.split('-')[0] for tag in tags)}-none-{platform_tag()}.whl"
    wheel, stamp = DIST / name, BUILD / "wheel.stamp"
    with sole_builder():
        architectures = os.environ.get("SKYTREE_CUDA_ARCHITECTURES", "ALL")
        facts = (sorted(pythons.items()), nvcc, architectures)
        digest = content_hash([ROOT / source for source in WHEEL_SOURCES], *facts)
        if not up_to_date(stamp, digest, wheel):
            settings = {
                "build-dir": BUILD / "native-wheel",
                "wheel.tags": ";".join(tags),
                "cmake.define.SKYTREE_PYTHONS": ";".join(map(str, pythons.values())),
                "cmake.define.SKYTREE_PYBIND11_INCLUDE": pybind11_include(tools),
                "cmake.define.SKYTREE_CUDA": "ON" if nvcc else "OFF",
                "cmake.define.SKYTREE_NVCC": nvcc or "",
                "cmake.define.SKYTREE_CUDA_ARCHITECTURES": architectures,
            }
            compile_wheel(tools, wheel, settings)
            stamp.write_text(digest)
    install_wheel(tools, wheel)
    return wheel


def compiler_cache() -> dict[str, str]:
    """Variables that let CMake use ccache where it is installed, also for another clone of the project."""
    if not shutil.which("ccache"):
        return {}
    return {"CMAKE_CXX_COMPILER_LAUNCHER": "ccache", "CCACHE_BASEDIR": str(ROOT)}


def platform_tag() -> str:
    """PEP 600's tag: whatever glibc the build machine has is an honest lower bound."""
    libc, version = platform.libc_ver()
    if libc != "glibc":
        raise BuildError(f"Skytree's wheel is for glibc; this machine has {libc or 'an unknown C library'}.")
    return f"manylinux_{version.replace('.', '_')}_{platform.machine()}"


def compile_wheel(tools: Path, wheel: Path, settings: dict) -> None:
    """Runs scikit-build-core and puts what it made in the place of older wheels."""
    with tempfile.TemporaryDirectory(dir=BUILD) as made:
        command = [tools, "-m", "pip", "wheel", "-v", "--no-build-isolation", "--no-deps", "-w", made, ROOT]
        command += [f"--config-settings={key}={value}" for key, value in settings.items()]
        run("Build skytree_core", command, PATH=f"{tools.parent}:{os.environ['PATH']}", **compiler_cache())
        DIST.mkdir(exist_ok=True)
        for old in DIST.glob("skytree_core-*.whl"):
            old.unlink()
        os.replace(Path(made) / wheel.name, wheel)


def pybind11_include(python: Path) -> str:
    command = [python, "-c", "import pybind11; print(pybind11.get_include())"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def install_wheel(python: Path, wheel: Path) -> None:
    stamp, digest = python.parent.parent / ".skytree-core-stamp", content_hash([wheel])
    with sole_builder():
        if not up_to_date(stamp, digest):
            command = [python, "-m", "pip", "install", "--no-deps", "--force-reinstall", wheel]
            run(f"Install skytree_core into {relative(python.parent.parent)}", command)
            stamp.write_text(digest)


def stamped_manifest(text: str, wheels: list[str]) -> str:
    """The add-on's manifest with the project's version and the wheels that lie beside it."""
    text, count = re.subn(r'(?m)^version\s*=\s*".*"$', f'version = "{VERSION}"', text)
    if count != 1:
        raise BuildError('addon/blender_manifest.toml needs one line of the form: version = "0.0.0"')
    text = re.sub(r"(?ms)^wheels\s*=\s*\[.*?\]\n", "", text)
    listed = ", ".join(f'"./wheels/{wheel}"' for wheel in wheels)
    return text.replace(f'version = "{VERSION}"\n', f'version = "{VERSION}"\nwheels = [{listed}]\n', 1)


def stamped_init(text: str) -> str:
    """The add-on's __init__.py with the project's version in bl_info, which Blender 3.x only parses."""
    numbers = ", ".join(VERSION.split("."))
    text, count = re.subn(r'("version":\s*)\([^)]*\)', rf"\g<1>({numbers})", text)
    if count != 1:
        raise BuildError('addon/__init__.py needs one "version": (…) in its bl_info')
    return text


def addon_files() -> dict[str, bytes]:
    """What the extension holds besides its wheel, by path inside the add-on."""
    addon = ROOT / "addon"
    if not (addon / "blender_manifest.toml").exists() or not (addon / "__init__.py").exists():
        raise BuildError(
            "addon/ has no blender_manifest.toml and __init__.py: there is no add-on to package."
        )
    files = {"LICENSE": (ROOT / "LICENSE").read_bytes()}
    for file in addon.rglob("*"):
        if file.is_file() and "__pycache__" not in file.parts:
            files[str(file.relative_to(addon))] = file.read_bytes()
    return files


@functools.cache
def package() -> Path:
    """dist/skytree-<version>-linux-x64.zip: the add-on and its wheel; the same inputs give the same bytes."""
    wheel = build_wheel()
    files = addon_files()
    files["blender_manifest.toml"] = stamped_manifest(
        files["blender_manifest.toml"].decode(), [wheel.name]
    ).encode()
    files["__init__.py"] = stamped_init(files["__init__.py"].decode()).encode()
    files[f"wheels/{wheel.name}"] = wheel.read_bytes()
    archive = DIST / f"skytree-{VERSION}-linux-x64.zip"
    with sole_builder(), tempfile.TemporaryDirectory(dir=BUILD) as folder:
        made = Path(folder) / archive.name
        with zipfile.ZipFile(made, "w") as sink:
            for path, content in sorted(files.items()):
                entry = zipfile.ZipInfo(f"skytree/{path}", ZIP_EPOCH)
                entry.external_attr = 0o100644 << 16
                # A wheel is compressed already.
                entry.compress_type = zipfile.ZIP_STORED if path.endswith(".whl") else zipfile.ZIP_DEFLATED
                sink.writestr(entry, content)
        os.replace(made, archive)
    return archive


def megabytes(path: Path) -> str:
    return f"{path.stat().st_size / 1e6:.1f} MB"


def build_native(folder: str, target: str, *settings: str) -> Path:
    """A CMake build of tests or benchmarks in build/`folder`; returns the program."""
    build = BUILD / folder
    with sole_builder():
        configure = ["cmake", "-S", ROOT, "-B", build, "-G", "Ninja", *settings]
        run(f"Configure build/{folder}", configure, **compiler_cache())
        compile_target = ["cmake", "--build", build, "--target", target]
        run(f"Compile {target} in build/{folder}", compile_target, **compiler_cache())
    return build / "native" / target
