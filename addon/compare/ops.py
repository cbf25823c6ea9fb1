# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of the comparison that work without a window."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import bpy
from bpy.props import FloatProperty, IntProperty, StringProperty

from .cli import METHOD_HELP
from .job import ReportJob, side_choice
from .render import Progress


class SKYTREE_OT_compare_report(bpy.types.Operator):
    """Render A, B and a reference through the scene's camera and write pictures, tables and a page with a
    slider"""

    bl_idname = "skytree.compare_report"
    bl_label = "Write Comparison Report"

    folder: StringProperty(
        name="Folder",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
        description="Where to; empty: the scene's setting",
    )
    a: StringProperty(
        name="A", options={"SKIP_SAVE"}, description=f"{METHOD_HELP}; empty: the scene's setting"
    )
    b: StringProperty(
        name="B", options={"SKIP_SAVE"}, description=f"{METHOD_HELP}; empty: the scene's setting"
    )
    samples: IntProperty(
        name="Samples", min=0, options={"SKIP_SAVE"}, description="Equal samples; 0: the scene's setting"
    )
    seconds: FloatProperty(
        name="Time", min=0.0, options={"SKIP_SAVE"}, description="Equal CPU time; 0: the scene's setting"
    )
    reference_samples: IntProperty(
        name="Reference Samples", min=0, options={"SKIP_SAVE"}, description="0: the scene's setting"
    )

    @classmethod
    def poll(cls, context):
        if bpy.app.is_job_running("RENDER"):
            cls.poll_message_set("Blender is rendering")
            return False
        if context.scene is None or context.scene.camera is None:
            cls.poll_message_set("The scene has no camera")
            return False
        return True

    def execute(self, context):
        scene = context.scene
        manager = context.window_manager
        folder = bpy.path.abspath(self.folder or scene.skytree_compare.folder)
        if folder.startswith("//"):
            self.report(
                {"ERROR"}, "Save the file first, or choose a folder for the report that is not relative to it"
            )
            return {"CANCELLED"}
        overrides = SimpleNamespace(
            a=None, b=None, samples=self.samples or None, seconds=self.seconds or None,
            reference_samples=self.reference_samples or None)  # fmt: skip
        manager.progress_begin(0.0, 1.0)
        try:
            overrides.a = side_choice(self.a) if self.a else None
            overrides.b = side_choice(self.b) if self.b else None
            job = ReportJob(scene, overrides)

            def tell(progress: Progress):
                manager.progress_update(progress.fraction)

            paths = job.run(Path(folder), tell)
        except (ValueError, RuntimeError, OSError) as error:
            self.report({"ERROR"}, f"The comparison failed: {error}")
            return {"CANCELLED"}
        finally:
            manager.progress_end()
        for line in job.summary():
            self.report({"INFO"}, line)
        self.report({"INFO"}, f"The report is {paths['html']}")
        return {"FINISHED"}


CLASSES = (SKYTREE_OT_compare_report,)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
