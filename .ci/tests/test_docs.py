# SPDX-License-Identifier: GPL-3.0-or-later
"""What the README and the docs say holds: links lead somewhere, commands exist, the Python example runs."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEMPLATES = ROOT / "docs" / "make_figures" / "text"  # with links of the pages that are made from them
DOCS = (page for page in (ROOT / "docs").rglob("*.md") if page.parent != TEMPLATES)
PAGES = sorted([ROOT / "README.md", ROOT / ".ci" / "README.md", *DOCS])
README = (ROOT / "README.md").read_text()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text())
    broken = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not broken


def test_readme_names_real_commands():
    named = set(re.findall(r"build_addon\.py ([\w-]+)", README)) | set(
        re.findall(r"^\| `([\w-]+)", README, re.M)
    )
    assert {"demo", "test", "package"} <= named
    for command in named:
        finished = subprocess.run(
            [sys.executable, ROOT / "build_addon.py", command, "--help"], capture_output=True
        )
        assert finished.returncode == 0, command


def test_readmes_python_example_runs(tmp_path):
    (example,) = re.findall(r"```python\n(.*?)```", README, re.S)
    finished = subprocess.run([sys.executable, "-c", example], cwd=tmp_path, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
    assert "bytes of tables" in finished.stdout
