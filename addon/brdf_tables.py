# SPDX-License-Identifier: GPL-3.0-or-later
"""Tabulated BRDFs of materials: what a material asks for, and the table made or read for it."""

from __future__ import annotations

import os
from dataclasses import dataclass

import bpy

from . import native


@dataclass(frozen=True)
class BrdfSpec:
    """A table by what it is made of; equal specs share one. `path` is absolute, `stamp` its time and size."""

    source: str  # GGX, WARD or MERL
    alpha_x: float = 0.0
    alpha_y: float = 0.0
    path: str = ""
    stamp: tuple[int, int] = (0, 0)

    def build(self):
        """A skytree_core.BrdfKdTree. Raises RuntimeError that names the file and what is wrong with it."""
        core = native.core()
        if self.source == "MERL":
            if not self.path:
                raise RuntimeError("no MERL file is chosen; choose one, or take GGX or Ward as the table")
            table = core.BrdfTable.merl(self.path)
        else:
            make = core.BrdfTable.ward if self.source == "WARD" else core.BrdfTable.ggx
            table = make(self.alpha_x, self.alpha_y)
        return core.BrdfKdTree(table)


def brdf_spec(material) -> BrdfSpec:
    settings = material.skytree
    if settings.table_source != "MERL":
        # Rounded as the sliders show them: equal to the eye, one table.
        alphas = (round(alpha, 3) for alpha in (settings.table_alpha_x, settings.table_alpha_y))
        return BrdfSpec(settings.table_source, *alphas)
    path = bpy.path.abspath(settings.table_file, library=material.library) if settings.table_file else ""
    try:
        status = os.stat(path)
        stamp = (status.st_mtime_ns, status.st_size)
    except OSError:
        stamp = (0, 0)  # build() says what is wrong
    return BrdfSpec("MERL", path=path, stamp=stamp)
