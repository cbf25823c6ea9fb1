# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with a scene's world, in words, and the operator that puts it right."""

from __future__ import annotations

from dataclasses import dataclass

import bpy

from ..environments import environments
from ..images import ImageStore
from ..map_figures import MapFigures
from ..messages import Messages
from ..world import read_world
from . import world_fixes

WRAP_CHARACTERS = 46


@dataclass(frozen=True)
class Problem:
    text: str
    operator: str  # its identifier
    label: str  # of the button
    icon: str = "NONE"


_store = ImageStore()


def find(scene) -> list[Problem]:
    """Reads nodes, not pixels, quick enough for a panel; what pixels are like is known once used."""
    messages = Messages()
    environment = read_world(scene.world, _store, messages)
    problems = [
        Problem(text, "skytree.bake_world", "Bake World to HDRI", "RENDER_STILL")
        for text in messages.about("NODE")
    ]
    problems += [
        Problem(text, "skytree.open_hdri", "Open HDRI", "FILE_FOLDER") for text in messages.about("IMAGE")
    ]
    if environment.expression is None and not problems:
        problems.append(
            Problem("The world has no HDRI: light comes evenly from all sides, or not at all",
                    "skytree.add_hdri", "Add HDRI", "WORLD")
        )  # fmt: skip
    figures = environments.figures(environment)
    if figures is not None:
        problems += _about_map(figures, scene.skytree.sampler)
    return problems


def _about_map(figures: MapFigures, sampler: str) -> list[Problem]:
    problems = []
    if figures.bad_texels:
        text = f"{figures.bad_texels} texels of the HDRI are negative, infinite or not a number: taken as 0"
        problems.append(Problem(text, "skytree.repair_hdri", "Repair HDRI", "BRUSH_DATA"))
    if figures.clipped_texels:
        text = (
            f"The brightest light is cut off: {figures.clipped_texels} texels share the value "
            f"{figures.largest:.6g}, so its shadows are too faint. Use a version of the HDRI that is not cut"
        )
        problems.append(Problem(text, "skytree.open_hdri", "Open HDRI", "FILE_FOLDER"))
    if figures.is_smooth and sampler != "UNIFORM":
        saved = 100.0 * (1.0 - 1.0 / figures.gain)
        text = f"The HDRI is so even that importance sampling saves {saved:.0f} % of the samples at most"
        problems.append(Problem(text, "skytree.use_uniform", "Sample Uniformly", "MESH_UVSPHERE"))
    return problems


def wrapped(words: str, characters: int = WRAP_CHARACTERS) -> list[str]:
    """Labels of panels do not wrap by themselves."""
    lines = [""]
    for word in words.split():
        if lines[-1] and len(lines[-1]) + 1 + len(word) > characters:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines


class SKYTREE_WORLD_PT_problems(bpy.types.Panel):
    bl_label = "Warnings"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "world"
    bl_order = -1
    COMPAT_ENGINES = {"SKYTREE"}

    @classmethod
    def poll(cls, context):
        return (
            context.engine in cls.COMPAT_ENGINES and context.scene is not None and bool(find(context.scene))
        )

    def draw(self, context):
        for problem in find(context.scene):
            box = self.layout.box()
            column = box.column(align=True)
            for i, line in enumerate(wrapped(problem.text)):
                column.label(text=line, icon="BLANK1" if i else "ERROR")
            if problem.operator == "skytree.add_hdri":
                row = box.row(align=True)
                row.operator_menu_enum(problem.operator, "name", text=problem.label, icon=problem.icon)
                row.operator("skytree.open_hdri", text="", icon="FILE_FOLDER")
            else:
                box.operator(problem.operator, text=problem.label, icon=problem.icon)


CLASSES = (*world_fixes.CLASSES, SKYTREE_WORLD_PT_problems)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
