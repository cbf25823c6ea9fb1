# SPDX-License-Identifier: GPL-3.0-or-later
"""A Python that the package holds no extension module for is told so."""

import shutil
import subprocess
import sys
from pathlib import Path

import skytree_core


def test_python_without_module_is_named_with_those_that_have_one(tmp_path):
    package = tmp_path / "skytree_core"
    package.mkdir()
    for source in Path(skytree_core.__file__).parent.glob("*.py"):
        shutil.copy(source, package)
    (package / "_native.cpython-39-x86_64-linux-gnu.so").touch()
    finished = subprocess.run(
        [sys.executable, "-c", "import skytree_core"], cwd=tmp_path, capture_output=True, text=True
    )
    assert finished.returncode != 0
    message = finished.stderr.splitlines()[-1]
    here = f"Python {sys.version_info.major}.{sys.version_info.minor} on linux"
    assert message.startswith(f"ImportError: skytree_core has no extension module for {here}")
    assert "serves 3.9." in message and "pip install ." in message
