# SPDX-License-Identifier: GPL-3.0-or-later
"""What executes CUDA kernels in the tests: a GPU, or a driver that runs them on the processor, or nothing."""

from __future__ import annotations

import ctypes
import os
import shutil
from pathlib import Path

from .environments import cuda_compiler
from .steps import BUILD, BuildError, relative, run

EMULATOR = BUILD / "cuda-emulator"


def cuda_test_environment() -> dict[str, str]:
    """Variables for the test runners, and a line that says what the CUDA tests will run on."""
    variables, said = _choose()
    print(f"• CUDA tests: {said}", flush=True)
    return variables


def _choose() -> tuple[dict[str, str], str]:
    if chosen := os.environ.get("SKYTREE_CUDA_DRIVER"):
        return {}, f"on {chosen}"
    if has_gpu():
        return {}, "on this machine's GPU"
    shared = os.environ.get("SKYTREE_SHARED")
    source = Path(shared) / "cuda-emulator" if shared else None
    if source is None or not (source / "Makefile").exists():
        return {}, "skipped, for there is no GPU, and no cuda-emulator in $SKYTREE_SHARED"
    nvcc, make = cuda_compiler(), shutil.which("make")
    if not nvcc or not make:
        return {}, f"skipped, for there is no GPU, and no {'nvcc' if make else 'make'} for the emulator"
    try:
        EMULATOR.mkdir(parents=True, exist_ok=True)
        toolkit = nvcc.resolve().parent.parent
        run("Build the CUDA emulator", [make, "-C", source, f"B={EMULATOR}", f"CUDA={toolkit}"])
    except BuildError as error:
        return {}, f"skipped, for the emulator cannot be built:\n{error}"
    settings = {
        "SKYTREE_CUDA_DRIVER": str(EMULATOR / "libcuda.so.1"),
        "CUEMU_CACHE": str(EMULATOR / "cache"),
        "CUEMU_OPT": "-O1",  # translating the kernels takes longer than running them
        "CUEMU_TIMEOUT_MS": "120000",
        "CUEMU_DEVICES": "2",  # to have a choice of GPUs
    }
    return settings, f"on the processor, through {relative(EMULATOR)}"


def has_gpu() -> bool:
    """A GPU of NVIDIA's that its driver lets us use."""
    try:
        driver = ctypes.CDLL("libcuda.so.1")
        count = ctypes.c_int()
        return driver.cuInit(0) == 0 and driver.cuDeviceGetCount(ctypes.byref(count)) == 0 and count.value > 0
    except (OSError, AttributeError):
        return False
