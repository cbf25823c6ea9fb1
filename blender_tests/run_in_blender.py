# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs pytest inside a Blender program, which has no pytest of its own:

    SKYTREE_PYTEST=<folder with pytest> blender -b --factory-startup --python-exit-code 3 \
        --python run_in_blender.py -- -q <pytest's arguments>

The folder may be the site-packages of any Python 3.11. The user's own Blender settings are left alone:
without BLENDER_USER_SCRIPTS Blender is started again with an empty folder in its place.
"""

import os
import sys
import tempfile


def restart_isolated():
    import bpy

    folder = tempfile.mkdtemp(prefix="skytree-blender-")
    os.environ["BLENDER_USER_SCRIPTS"] = os.path.join(folder, "scripts")
    os.environ["BLENDER_USER_CONFIG"] = os.path.join(folder, "config")
    os.environ["XDG_CACHE_HOME"] = os.path.join(folder, "cache")
    os.makedirs(os.path.join(folder, "scripts", "addons"))
    os.execv(bpy.app.binary_path, [bpy.app.binary_path, *sys.argv[1:]])


def main() -> int:
    packages = os.environ.get("SKYTREE_PYTEST")
    if packages:
        # At the end: Blender's own numpy must win over one that was installed along with pytest.
        sys.path.append(packages)
    try:
        import pytest
    except ImportError:
        sys.exit("run_in_blender.py: set SKYTREE_PYTEST to a folder that holds pytest")
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    return int(pytest.main(arguments or [os.path.dirname(__file__)]))


if __name__ == "__main__":
    if "BLENDER_USER_SCRIPTS" not in os.environ:
        restart_isolated()
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
