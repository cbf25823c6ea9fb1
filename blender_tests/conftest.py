# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on in this Blender, installed as a user does it, and an empty scene for each test."""

import os
import sys
import tempfile
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE))

# Before bpy is imported: the user's own settings and extensions stay untouched.
if "bpy" not in sys.modules:
    _folder = tempfile.mkdtemp(prefix="skytree-blender-")
    os.environ["BLENDER_USER_RESOURCES"] = _folder
    os.environ["XDG_CACHE_HOME"] = os.path.join(_folder, "cache")

import bpy  # noqa: E402
from installing import ZIP, install  # noqa: E402

# Those need a window: see window/README.md.
collect_ignore = ["window"]


@pytest.fixture(scope="session")
def skytree():
    """The add-on's package; its parts are found by `part(skytree, "world")`."""
    module = install()
    yield module
    if hasattr(bpy.types, "SkytreeRenderEngine"):
        module.unregister()


@pytest.fixture
def scene(skytree):
    """An empty scene with a camera at (0, -6, 2) that looks at the origin's height, engine Skytree."""
    import scenes

    return scenes.new_scene()


@pytest.fixture
def cycles(scene):
    if "cycles" not in bpy.context.preferences.addons:
        pytest.skip("this Blender has no Cycles")
    return scene


def pytest_report_header(config):
    return f"Blender {bpy.app.version_string}, add-on from {ZIP or ROOT / 'addon'}"


def pytest_sessionfinish(session, exitstatus):
    session.config.skytree_exit_status = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    # Blender 4.5 as a module can hang in exit(); what is to be said about that is in test_process.py.
    sys.stdout.flush()
    sys.stderr.flush()
    if hasattr(config, "skytree_exit_status"):
        os._exit(config.skytree_exit_status)
