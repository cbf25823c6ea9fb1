# SPDX-License-Identifier: GPL-3.0-or-later
"""The kernels' registers stay in registers: what docs/cuda.md says about spills, by the compiler."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from skytree_build.environments import cuda_compiler

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def kernels():
    name, file = "cuda_kernels", ROOT / "docs" / "bench" / "cuda_kernels.py"
    specification = importlib.util.spec_from_file_location(name, file)
    module = sys.modules[name] = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def compiled(kernels, tmp_path_factory):
    nvcc = cuda_compiler()
    if not nvcc:
        pytest.skip("no nvcc on this machine, and none to be had from PyPI")
    return {
        k.name: k
        for k in kernels.compile_kernels(str(nvcc), kernels.SOURCES[0], 86, tmp_path_factory.mktemp("cubin"))
    }


@pytest.mark.parametrize("kernel", ["sample_directions", "evaluate_pdf", "draw_directions"])
def test_sampling_kernels_use_no_local_memory(compiled, kernel):
    assert (compiled[kernel].spills, compiled[kernel].stack) == (0, 0)


def test_only_the_renderer_spills(compiled):
    # It has 80 registers where it could use 128: the warps are worth what they spill (docs/cuda.md).
    spilt = {name: k.spills for name, k in compiled.items() if k.spills}
    assert spilt.pop("render_pass", 0) <= 1400
    assert spilt.pop("pilot_tiles", 0) <= 1000
    assert spilt == {}


def test_six_blocks_of_the_renderer_fit_on_a_multiprocessor(compiled):
    assert compiled["render_pass"].warps(86) >= 24


def test_arithmetic_is_the_hosts(kernels, tmp_path):
    """The emulator computes approximate instructions better than a GPU does, so no test that runs on it would
    notice one; nor what ptxas makes of a multiplication and an addition that may be contracted."""
    nvcc = cuda_compiler()
    if not nvcc:
        pytest.skip("no nvcc on this machine, and none to be had from PyPI")
    ptx = tmp_path / "kernels.ptx"
    command = [nvcc, *kernels.FLAGS, "-arch=compute_75", "-ptx", "-o", ptx, kernels.SOURCES[0]]
    subprocess.run(command, check=True)
    operations = set(re.findall(r"^\s*(?:@!?%p\d+ )?([a-z]\w*(?:\.\w+)*)", ptx.read_text(), re.MULTILINE))
    assert {"mul.rn.f32", "add.rn.f32", "div.rn.f32", "sqrt.rn.f32"} <= operations
    inexact = re.compile(r"\.(approx|full|ftz)\b|^(fma|mad)\b.*\.f(32|64)$|^(add|sub|mul)\.f(32|64)$")
    assert [operation for operation in sorted(operations) if inexact.search(operation)] == []
