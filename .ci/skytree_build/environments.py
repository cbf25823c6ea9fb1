# SPDX-License-Identifier: GPL-3.0-or-later
"""What a command needs around it: Debian packages, Python interpreters, pinned virtual environments."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from .steps import BUILD, ROOT, BuildError, content_hash, run, sole_builder, up_to_date

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
APT: dict[str, list[str]] = PROJECT["tool"]["skytree"]["apt"]
BLENDERS = {"4.5": "3.11", "5.2": "3.13"}  # Blender as a Python module, and the Python that it is built for


use_apt = True  # --no-apt clears it


def require_packages(*groups: str) -> None:
    """Installs the Debian packages of pyproject.toml's [tool.skytree.apt] groups that are missing."""
    if not use_apt:
        return
    wanted = sorted({package for group in groups for package in APT[group]})
    if not shutil.which("dpkg-query"):
        print(f"• This is no Debian: taking for granted what Debian calls {', '.join(wanted)}", flush=True)
        return
    query = ["dpkg-query", "-W", "-f", "${Package} ${db:Status-Status}\n", *wanted]
    known = subprocess.run(query, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout
    missing = [package for package in wanted if f"{package} installed\n" not in known]
    if not missing:
        return
    lock = ["-o", "DPkg::Lock::Timeout=600"]
    install = ["apt-get", "install", "-y", "--no-install-recommends", *lock, *missing]
    if os.geteuid() == 0:
        run("Read Debian's package lists", ["apt-get", "update", *lock])
        run(f"Install {len(missing)} Debian packages", install, DEBIAN_FRONTEND="noninteractive")
    elif can_sudo():
        # With the terminal as it is, since sudo may ask for a password.
        for command in (["apt-get", "update", *lock], ["env", "DEBIAN_FRONTEND=noninteractive", *install]):
            if subprocess.run(["sudo", *command]).returncode:
                raise BuildError(f"sudo {shlex.join(command)} failed; what it printed above says why.")
    else:
        raise BuildError(
            f"These Debian packages are missing: {' '.join(missing)}\n"
            f"Only root may install them:  apt-get install --no-install-recommends {' '.join(missing)}\n"
            "or add --no-apt to go on with what this machine has."
        )


def can_sudo() -> bool:
    if not shutil.which("sudo"):
        return False
    return sys.stdin.isatty() or subprocess.run(["sudo", "-n", "true"], capture_output=True).returncode == 0


def pyenv_release(python: Path) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", python.parts[-3])]


def find_python(version: str) -> Path | None:
    """A Python `version` ("3.13") with headers and venv: this one, on PATH, Debian's, or one of pyenv's."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    of_pyenv = sorted(pyenv.glob(f"{version}.[0-9]*/bin/python{version}"), key=pyenv_release)
    probe = (
        "import ensurepip, os, sys, sysconfig, venv;"
        "assert os.path.exists(sysconfig.get_path('include') + '/Python.h');"
        "print('%d.%d' % sys.version_info[:2], sys._base_executable)"
    )
    for candidate in (
        sys.executable,
        shutil.which(f"python{version}"),
        f"/usr/bin/python{version}",
        *of_pyenv[::-1],
    ):
        if candidate and Path(candidate).exists():
            answer = subprocess.run([candidate, "-c", probe], capture_output=True, text=True).stdout.split()
            if answer and answer[0] == version:
                return Path(answer[1]).resolve()  # the same one by whichever name it was found
    return None


def require_python(version: str) -> Path:
    if python := find_python(version):
        return python
    raise BuildError(
        f"No Python {version} with headers and venv was found (on Debian 12: python3-dev, python3-venv)."
    )


def pinned(group: str) -> list[str]:
    """A dependency group of pyproject.toml, with the groups that it includes."""
    found = []
    for entry in PROJECT["dependency-groups"][group]:
        found += pinned(entry["include-group"]) if isinstance(entry, dict) else [entry]
    return found


def environment(name: str, group: str, python_version: str) -> Path:
    """The virtual environment build/`name` with a pinned group in it; returns its interpreter."""
    folder, wanted = BUILD / name, pinned(group)
    python, stamp, digest = folder / "bin" / "python", folder / ".skytree-stamp", content_hash([], wanted)
    with sole_builder():
        version = "import sys; print('%d.%d' % sys.version_info[:2])"
        works = python.exists() and subprocess.run([python, "-c", version], capture_output=True, text=True)
        if not works or works.stdout.strip() != python_version:
            shutil.rmtree(folder, ignore_errors=True)
            run(f"Create build/{name}", [require_python(python_version), "-m", "venv", folder])
        if not up_to_date(stamp, digest):
            run(
                f"Install into build/{name}",
                [python, "-m", "pip", "install", "--progress-bar", "off", *wanted],
            )
            stamp.write_text(digest)
    return python


def cuda_compiler() -> Path | None:
    """nvcc, 12.8 or newer: the machine's, else PyPI's in build/venv-cuda; None where neither can be had."""
    homes = [os.environ.get("CUDA_HOME"), os.environ.get("CUDA_PATH"), "/usr/local/cuda"]
    candidates = [shutil.which("nvcc"), *(f"{home}/bin/nvcc" for home in homes if home)]
    for candidate in candidates:
        if candidate and Path(candidate).exists():
            said = subprocess.run([candidate, "--version"], capture_output=True, text=True).stdout
            release = re.search(r"release (\d+)\.(\d+)", said)
            if release and (int(release[1]), int(release[2])) >= (12, 8):  # the first that knows sm_120
                return Path(candidate)
    try:
        packages = environment("venv-cuda", "cuda", "3.11").parent.parent / "lib/python3.11/site-packages"
    except BuildError as error:
        print(f"• CUDA: no nvcc on this machine, and none to be had from PyPI:\n{error}", flush=True)
        return None
    return next(packages.glob("nvidia/cu*/bin/nvcc"), None)


def blender_module(version: str) -> Path:
    """The interpreter of build/bpy-`version`, where `import bpy` is that Blender."""
    require_packages("build", "bpy")
    return environment(f"bpy-{version}", f"blender-{version.replace('.', '-')}", BLENDERS[version])


def mitsuba_module() -> tuple[Path, Path | None]:
    """The interpreter of build/venv-mitsuba, and the LLVM that it compiles with, where there is one."""
    try:
        require_packages("mitsuba")
    except BuildError as error:
        print(f"• LLVM for Mitsuba: {error}", flush=True)
    return environment("venv-mitsuba", "mitsuba", "3.11"), find_llvm()


def find_llvm() -> Path | None:
    """The newest libLLVM; 15 and 16, which abort where there is AVX512-FP16, only if there is no other."""
    if named := os.environ.get("DRJIT_LIBLLVM_PATH"):
        return Path(named)
    found = {}
    for folder in (
        "/usr/lib/x86_64-linux-gnu",
        "/usr/lib64",
        "/usr/lib",
        *Path("/usr/lib").glob("llvm-*/lib"),
    ):
        for file in sorted(Path(folder).glob("libLLVM*.so*")):
            if match := re.match(r"libLLVM(?:-(\d+)|\.so\.(\d+))", file.name):
                found.setdefault(int(match[1] or match[2]), file)
    return found[max(found, key=lambda version: (version not in (15, 16), version))] if found else None


def left_out(python_version: str) -> str:
    return f"no Python {python_version} with headers on PATH or under pyenv"
