# SPDX-License-Identifier: GPL-3.0-or-later
"""What the CUDA kernels need, from the compiler: registers, local memory, spills, instructions.

    python docs/bench/cuda_kernels.py [--arch 75 86 120]

Needs nvcc; no GPU. Instructions are counted where cuobjdump and nvdisasm are on PATH (the CUDA toolkit, or
PyPI's nvidia-cuda-cuobjdump and nvidia-cuda-nvdisasm). Prints the table of docs/cuda.md.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FLAGS = ["-std=c++17", "-fmad=false", f"-I{ROOT}", f"-I{ROOT / 'native'}"]
SOURCES = [ROOT / "cuda" / "kernels.cu", Path(__file__).with_name("cuda_stages.cu")]
REGISTERS_PER_MULTIPROCESSOR = 65536
WARPS_PER_BLOCK = 4  # kThreads of cuda/kernel_parameters.h
REGISTER_STEP = 8  # per thread, what the hardware hands out
WARPS_PER_MULTIPROCESSOR = {75: 32, 86: 48, 89: 48, 120: 48}  # else 64


@dataclass
class Kernel:
    name: str
    registers: int
    stack: int
    spills: int
    instructions: int = 0

    def warps(self, arch: int) -> int:
        """In whole blocks of threads, as the hardware hands out registers."""
        rounded = -(-self.registers // REGISTER_STEP) * REGISTER_STEP
        blocks = REGISTERS_PER_MULTIPROCESSOR // (rounded * 32 * WARPS_PER_BLOCK)
        return min(WARPS_PER_MULTIPROCESSOR.get(arch, 64), blocks * WARPS_PER_BLOCK)


def compile_kernels(nvcc: str, source: Path, arch: int, folder: Path) -> list[Kernel]:
    cubin = folder / f"{source.stem}.{arch}.cubin"
    command = [nvcc, *FLAGS, f"-arch=sm_{arch}", "-Xptxas", "-v", "-cubin", "-o", cubin, source]
    said = subprocess.run(command, capture_output=True, text=True)
    if said.returncode:
        sys.exit(f"nvcc failed on {source}:\n{said.stderr}")
    pattern = re.compile(
        r"entry function '(\w+)'.*?(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads"
        r".*?Used (\d+) registers",
        re.DOTALL,
    )
    kernels = [
        Kernel(name, int(registers), int(stack), int(stores) + int(loads))
        for name, stack, stores, loads, registers in pattern.findall(said.stderr)
    ]
    dump = shutil.which("cuobjdump") or str(Path(nvcc).with_name("cuobjdump"))
    if Path(dump).exists():
        listing = subprocess.run([dump, "-sass", cubin], capture_output=True, text=True).stdout
        for part in listing.split("Function : ")[1:]:
            for kernel in kernels:
                if part.split(None, 1)[0] == kernel.name:
                    kernel.instructions = len(re.findall(r"/\*[0-9a-f]{4,}\*/\s+(?!NOP)\S", part))
    return kernels


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arch", type=int, nargs="+", default=[75, 80, 86, 89, 90, 100, 120])
    arguments = parser.parse_args()
    nvcc = shutil.which("nvcc") or "/usr/local/cuda/bin/nvcc"
    if not Path(nvcc).exists():
        sys.exit("nvcc was not found: install the CUDA toolkit, or put it on PATH.")
    started = time.perf_counter()
    kernels: dict[int, list[Kernel]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for arch in arguments.arch:
            for source in SOURCES:
                kernels.setdefault(arch, []).extend(compile_kernels(nvcc, source, arch, Path(folder)))
            print(f"sm_{arch}: {time.perf_counter() - started:.0f} s", file=sys.stderr, flush=True)
    print(tables(kernels))


def tables(kernels: dict[int, list[Kernel]]) -> str:
    """A table of kernels by architectures for each question."""
    questions = {
        "Registers a thread / warps a multiprocessor": lambda k, arch: f"{k.registers} / {k.warps(arch)}",
        "Bytes of local memory a thread / spilt ones": lambda k, arch: f"{k.stack} / {k.spills}",
        "Instructions": lambda k, arch: f"{k.instructions or '?'}",
    }
    names = dict.fromkeys(k.name for found in kernels.values() for k in found)
    parts = []
    for question, answer in questions.items():
        lines = [f"{question}:\n", "| | " + " | ".join(f"sm_{arch}" for arch in kernels) + " |"]
        lines.append("| :-- |" + " --: |" * len(kernels))
        for name in names:
            cells = [answer(k, arch) for arch, found in kernels.items() for k in found if k.name == name]
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


if __name__ == "__main__":
    main()
