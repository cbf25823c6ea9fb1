# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark scene, built inside Blender: a grey diffuse ground that fills the frame and three spheres
(Diffuse, Glossy GGX 0.2, Glossy GGX 0.5), lit by an environment map alone."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import scene as parts
import shapes
import teapot


def build(scene: bpy.types.Scene, hdri: Path) -> None:
    """Fills an empty scene."""
    ground = teapot.Mesh(
        np.array([(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0)], float),
        np.array([(0, 0, 1)] * 4, float),
        np.array([(0, 1, 2), (0, 2, 3)], np.int32),
    )
    diffuse, glossy = "ShaderNodeBsdfDiffuse", "ShaderNodeBsdfGlossy"
    grey = parts.material("Ground", diffuse, {"Color": (0.5, 0.5, 0.5, 1)})
    parts.add_mesh(scene, "Ground", ground, grey)
    balls = [
        ("Diffuse", diffuse, {"Color": (0.8, 0.8, 0.8, 1)}),
        ("Glossy 0.2", glossy, {"Color": (0.9, 0.9, 0.9, 1), "Roughness": 0.2}),
        ("Glossy 0.5", glossy, {"Color": (0.9, 0.9, 0.9, 1), "Roughness": 0.5}),
    ]
    for x, (name, node, inputs) in zip((-2.2, 0.0, 2.2), balls, strict=True):
        ball = parts.add_mesh(scene, name, shapes.sphere(64), parts.material(name, node, inputs))
        ball.location = (x, 0, 1)
    parts.add_camera(scene, position=(0, -7.5, 5.5), target=(0, 0.2, 0.55), lens=40)
    parts.add_world(scene, hdri, 0.0)
