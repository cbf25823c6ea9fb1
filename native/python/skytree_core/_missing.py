# SPDX-License-Identifier: GPL-3.0-or-later
"""The message for a Python that the package holds no extension module for."""

import re
import sys
from pathlib import Path


def explain() -> str:
    """Says which Python this is, which ones the installed package serves, and what to do."""
    modules = Path(__file__).parent.glob("_native.cpython-*.so")
    served = sorted({re.sub(r"^(\d)(\d+)$", r"\1.\2", module.name.split("-")[1]) for module in modules})
    here = f"Python {sys.version_info.major}.{sys.version_info.minor} on {sys.platform}"
    return (
        f"skytree_core has no extension module for {here}; the installed package serves "
        f"{', '.join(served) or 'none'}. Install a wheel for this Python, or build one with it: "
        "pip install . in Skytree's source folder"
    )
