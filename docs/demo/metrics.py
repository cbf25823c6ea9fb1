# SPDX-License-Identifier: GPL-3.0-or-later
"""The figures that the documentation quotes are those that the add-on shows: skytree_core.metrics.

Read from the sources, as scripts in other environments than the core's use it too; it needs numpy alone.
"""

import importlib.util
from pathlib import Path

_FILE = Path(__file__).resolve().parents[2] / "native" / "python" / "skytree_core" / "metrics.py"
_spec = importlib.util.spec_from_file_location("skytree_core_metrics", _FILE)
_metrics = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_metrics)

efficiency, error_figures = _metrics.efficiency, _metrics.error_figures
