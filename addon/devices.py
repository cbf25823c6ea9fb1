# SPDX-License-Identifier: GPL-3.0-or-later
"""Which device renders: the command line's wish, else the scene's, on the GPU that the preferences name."""

from __future__ import annotations

import sys

import bpy

from . import native

OPTION = "--skytree-device"  # after Blender's own "--": CPU, CUDA or CUDA:n


def cuda_problem() -> str | None:
    """Why CUDA cannot be used, or None if it can; without a full stop."""
    problem = native.core().cuda_problem()
    return problem.rstrip(".") if problem else None


def render_threads(render) -> int:
    """Threads that scene.render allows: what Blender calls fixed, or 0 for all cores."""
    return render.threads if render.threads_mode == "FIXED" else 0


def device_from_command_line(arguments: list[str] | None = None) -> str | None:
    """What stands behind --skytree-device (or --skytree-device=...), None where it is not given."""
    arguments = sys.argv if arguments is None else arguments
    own = arguments[arguments.index("--") + 1 :] if "--" in arguments else []
    for i, argument in enumerate(own):
        if argument == OPTION:
            return own[i + 1] if i + 1 < len(own) else ""
        if argument.startswith(OPTION + "="):
            return argument[len(OPTION) + 1 :]
    return None


def render_device(settings) -> str:
    """What RenderSession takes as device, for scene.skytree."""
    asked = device_from_command_line()
    if asked is None:
        asked = settings.device
    return preferred_gpu() if asked == "CUDA" else asked


def preferred_gpu() -> str:
    addon = bpy.context.preferences.addons.get(__package__)
    chosen = addon.preferences.gpu if addon and addon.preferences else ""
    return chosen or "CUDA"


_gpu_items = []  # Blender does not keep a reference to what a callback returns


def _list_gpus(_preferences, _context):
    try:
        gpus = [device for device in native.core().devices() if device.type == "CUDA"]
    except native.CoreUnavailableError:
        gpus = []
    _gpu_items[:] = [(gpu.id, gpu.name, f"Render on {gpu.name} ({gpu.id})", i) for i, gpu in enumerate(gpus)]
    return _gpu_items or [("CUDA", "None found", "This machine offers no NVIDIA GPU to Skytree", 0)]


class SkytreePreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    gpu: bpy.props.EnumProperty(
        name="GPU", items=_list_gpus, description="Renders the scenes whose device is CUDA"
    )

    def draw(self, _context):
        try:
            problem = cuda_problem()
        except native.CoreUnavailableError as error:
            problem = str(error)
        column = self.layout.column()
        column.prop(self, "gpu")
        if problem:
            column.label(text=problem, icon="INFO")


def register():
    bpy.utils.register_class(SkytreePreferences)


def unregister():
    bpy.utils.unregister_class(SkytreePreferences)
