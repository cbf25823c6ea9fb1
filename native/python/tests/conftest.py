# SPDX-License-Identifier: GPL-3.0-or-later
"""Where real maps may lie: the folders in SKYTREE_HDRI, ../shared/hdri beside the repository, Blender as a
module in build/."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]


def _maps_in(folder: Path) -> list[Path]:
    return sorted(p for p in folder.glob("*") if p.suffix in (".exr", ".hdr"))


def hdri_folder() -> Path:
    """The folder beside the repository, which may be absent."""
    return ROOT.parent / "shared" / "hdri"


def real_maps() -> list[Path]:
    folders = [Path(f) for f in os.environ.get("SKYTREE_HDRI", "").split(os.pathsep) if f]
    folders.append(hdri_folder())
    bundled = sorted(ROOT.glob("build/bpy-*/lib/python*/site-packages/bpy/*/datafiles/studiolights/world"))
    return [path for folder in folders + bundled[:1] for path in _maps_in(folder)]


def bad_maps() -> list[Path]:
    return _maps_in(hdri_folder() / "bad")
