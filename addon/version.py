# SPDX-License-Identifier: GPL-3.0-or-later
"""Differences between the Blender versions that several files meet."""

from __future__ import annotations

import bpy


def uses_nodes(datablock) -> bool:
    """Whether a world or material is shaded by its node tree."""
    if datablock.node_tree is None:
        return False
    # From 5.0 on there is nothing but nodes, and merely asking warns that the property will go.
    return bpy.app.version >= (5, 0, 0) or datablock.use_nodes
