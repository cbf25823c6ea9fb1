# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes that skytree_core renders directly, without Blender: the teapot on its table, rows of spheres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import samplers as demo_samplers
import shapes
import skytree_core
import teapot

CHROME_STEEL = {"type": "GLOSSY", "color": (0.62, 0.63, 0.64), "roughness": 0.18}
TABLE = {"type": "DIFFUSE", "color": (0.36, 0.34, 0.32)}
# A figure compares how the environment is sampled and nothing else: one light sample and one BSDF sample
# at each vertex, combined by the balance heuristic. What else a session can do against noise is switched off.
PLAIN_ESTIMATOR: dict = {}  # which are the session's defaults
# The rival (its search guided by a table, or binary as the paper's may have been), the paper's setting (SCCG
# 2012) and Skytree's default; see docs/method.md.
METHODS = {
    "inversion": "Inversion",
    "inversion_binary": "Inversion, binary search",
    "kdtree_paper": "Kd-tree as in the paper",
    "kdtree": "Kd-tree, Skytree's default",
}
BLOCKS = 1024
LIGHT_FROM = math.radians(-10)


def build(method: str, image: np.ndarray, blocks: int = BLOCKS):
    """A sampler of METHODS, or "alias" for references: it is none of those compared."""
    if method == "inversion":
        return skytree_core.InversionSampler(image)
    if method == "inversion_binary":
        return skytree_core.InversionSampler(image, method="binary")
    if method == "alias":
        return skytree_core.AliasSampler(image)
    setting = {"kdtree": demo_samplers.KDTREE, "kdtree_paper": demo_samplers.PAPER}[method]
    return skytree_core.KdTreeSampler(image, blocks, **setting)


@dataclass(frozen=True)
class Render:
    image: np.ndarray  # (H,W,3) linear, top row first
    alpha: np.ndarray  # (H,W)
    seconds: float  # of processor time, all threads together; on a GPU of the wall's clock
    threads: int


class Stage:
    """A scene with one environment map, turned so that its brightest side (or that of `turned_as`) lights
    from the azimuth `light_from`, in radians; the cameras look along +Y."""

    def __init__(
        self, image: np.ndarray, width: int, height: int, *, light_from: float = LIGHT_FROM, turned_as=None
    ):
        self.width, self.height = width, height
        self.scene = skytree_core.Scene()
        self._gpu_sessions: dict[str, skytree_core.RenderSession] = {}
        turned_as = image if turned_as is None else turned_as
        angle = light_from - demo_samplers.brightest_azimuth(turned_as)
        turn = np.eye(3)
        turn[:2, :2] = [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
        self.scene.set_environment(np.ascontiguousarray(image), None, world_to_env=turn)

    def add(
        self, mesh: teapot.Mesh, closure: dict, location=(0, 0, 0), scale: float = 1.0, turn: float = 0.0
    ):
        """A copy of a smooth mesh with its exact normals, turned by radians about +Z."""
        normals = mesh.normals.astype(np.float32)
        identity = self.scene.add_mesh(
            mesh.vertices.astype(np.float32), mesh.triangles, mesh.triangles, normals
        )
        matrix = np.eye(4)
        rotation = [[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]]
        matrix[:3, :3] = scale * np.array(rotation)
        matrix[:3, 3] = location
        material = self.scene.add_material([{"weight": 1.0, **closure}])
        self.scene.add_instance(identity, matrix, materials=[material])

    def look(self, position, target, lens: float) -> None:
        """A camera with a lens in millimetres on a film 36 mm wide, +Z up."""
        back = np.subtract(position, target).astype(float)
        back /= np.linalg.norm(back)
        right = np.cross((0, 0, 1), back)
        right /= np.linalg.norm(right)
        camera = np.eye(4)
        camera[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
        camera[:3, 3] = position
        near, far, focal = 0.01, 1000.0, 2 * lens / 36
        projection = np.zeros((4, 4))
        projection[0, 0], projection[1, 1] = focal, focal * self.width / self.height
        projection[2, 2:] = (far + near) / (near - far), 2 * far * near / (near - far)
        projection[3, 2] = -1
        self.scene.set_camera(camera, projection)

    def _session(self, device: str) -> skytree_core.RenderSession:
        """A new one on the CPU. A GPU's is kept, as a viewport keeps it: a new one starts with making the
        context and sending the scene, which takes longer than a frame."""
        if device == "CPU":
            return skytree_core.RenderSession()
        if device not in self._gpu_sessions:
            self._gpu_sessions[device] = skytree_core.RenderSession(device=device)
        return self._gpu_sessions[device]

    def render(
        self, sampler, samples: int, seed: int = 0, *, max_bounces: int = 3, device: str = "CPU", **options
    ) -> Render:
        """Raises RuntimeError where the session failed or another device than asked for had to render."""
        session = self._session(device)
        session.start(
            self.scene,
            self.width,
            self.height,
            samples,
            seed=seed,
            max_bounces=max_bounces,
            sampler=sampler,
            **(PLAIN_ESTIMATOR | options),
        )
        while not session.wait(0.5):
            pass  # so that Ctrl-C is heard
        if session.error or session.warning:
            raise RuntimeError(session.error or session.warning)
        stats = session.stats
        clock = stats["cpu_seconds"] if device == "CPU" else stats["seconds"] - stats["commit_seconds"]
        pixels = session.pixels()[::-1]
        return Render(pixels[..., :3].copy(), pixels[..., 3].copy(), clock, stats["threads"])


def teapot_stage(image: np.ndarray, width: int, height: int, turned_as=None) -> Stage:
    """The chrome-steel teapot of the paper's Figure 3 on a round table."""
    stage = Stage(image, width, height, turned_as=turned_as)
    stage.add(teapot.teapot(segments=16), CHROME_STEEL, scale=0.62, turn=math.radians(-28))
    stage.add(shapes.table(), TABLE)
    stage.look(position=(0.3, -8.0, 2.6), target=(0.05, 0.0, 0.86), lens=58)
    return stage


def sphere_stage(image: np.ndarray, size: int, closure: dict) -> Stage:
    """One sphere before the environment, as in the paper's Figure 6."""
    stage = Stage(image, size, size, light_from=math.radians(-50))
    stage.add(shapes.sphere(64), closure)
    stage.look(position=(0, -6.0, 0.6), target=(0, 0, 0), lens=88)
    return stage


def devices() -> dict[str, str]:
    """What renders here: the CPU, and the first NVIDIA GPU where there is one; id to name."""
    found = {device.type: device for device in reversed(skytree_core.devices())}
    return {device.id: device.name for device in reversed(found.values())}


def fastest(stage: Stage, samplers: dict, samples: int, rounds: int, **options) -> dict[str, Render]:
    """For each sampler the render that took least time of several rounds, in which they take turns."""
    best: dict[str, Render] = {}
    for _ in range(rounds):
        for name, sampler in samplers.items():
            if options.get("device", "CPU") != "CPU":
                stage.render(sampler, samples, **options)  # sends the sampler's tables
            render = stage.render(sampler, samples, **options)
            if name not in best or render.seconds < best[name].seconds:
                best[name] = render
    return best


def reference_halves(
    stage: Stage, samples: int, seed: int = 1000, **options
) -> tuple[np.ndarray, np.ndarray]:
    """Two independent renders by a sampler that is not compared; see metrics.error_figures."""
    sampler = options.pop("sampler")
    return tuple(stage.render(sampler, samples, seed + half, **options).image for half in (1, 2))
