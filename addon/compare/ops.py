# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators of the comparison that work without a window."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import bpy
from bpy.props import FloatProperty, IntProperty, StringProperty

from . import background
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
        report = background.current()
        if report is not None and not report.done:
            cls.poll_message_set("A report is being made")
            return False
        if context.scene is None or context.scene.camera is None:
            cls.poll_message_set("The scene has no camera")
            return False
        return True

    def invoke(self, context, event):
        """The button's way: the user goes on working meanwhile."""
        try:
            background.start(*self._job(context))
        except (ValueError, RuntimeError, OSError) as error:
            self.report({"ERROR"}, f"The comparison failed: {error}")
            return {"CANCELLED"}
        return {"FINISHED"}

    def execute(self, context):
        """A script's way: the report is written when this returns."""
        manager = context.window_manager
        manager.progress_begin(0.0, 1.0)
        try:
            job, folder = self._job(context)

            def tell(progress: Progress):
                manager.progress_update(progress.fraction)

            paths = job.run(folder, tell)
        except (ValueError, RuntimeError, OSError) as error:
            self.report({"ERROR"}, f"The comparison failed: {error}")
            return {"CANCELLED"}
        finally:
            manager.progress_end()
        for line in job.summary():
            self.report({"INFO"}, line)
        self.report({"INFO"}, f"The report is {paths['html']}")
        return {"FINISHED"}

    def _job(self, context) -> tuple[ReportJob, Path]:
        scene = context.scene
        folder = bpy.path.abspath(self.folder or scene.skytree_compare.folder)
        if folder.startswith("//"):
            raise ValueError("save the file first, or choose a folder that is not relative to it")
        overrides = SimpleNamespace(
            a=side_choice(self.a) if self.a else None,
            b=side_choice(self.b) if self.b else None,
            samples=self.samples or None,
            seconds=self.seconds or None,
            reference_samples=self.reference_samples or None,
        )
        return ReportJob(scene, overrides), Path(folder)


class SKYTREE_OT_cancel_report(bpy.types.Operator):
    """Stop making the report"""

    bl_idname = "skytree.cancel_report"
    bl_label = "Cancel Report"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        report = background.current()
        return report is not None and not report.done

    def execute(self, context):
        background.current().cancel()
        return {"FINISHED"}


class SKYTREE_OT_open_report(bpy.types.Operator):
    """Show the report's page in the web browser"""

    bl_idname = "skytree.open_report"
    bl_label = "Open Report"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        report = background.current()
        return report is not None and report.page is not None

    def execute(self, context):
        bpy.ops.wm.url_open(url=background.current().page.as_uri())
        return {"FINISHED"}


CLASSES = (SKYTREE_OT_compare_report, SKYTREE_OT_cancel_report, SKYTREE_OT_open_report)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    background.register()


def unregister():
    background.unregister()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
