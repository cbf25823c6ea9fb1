# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds, objects, cameras and renders for the tests, the same in every Blender."""

from __future__ import annotations

import importlib
import os
import resource
import tempfile
from contextlib import contextmanager
from pathlib import Path

import bmesh
import bpy
import numpy as np

TEMPORARY = Path(tempfile.mkdtemp(prefix="skytree-tests-"))
BUNDLED = Path(bpy.utils.system_resource("DATAFILES", path="studiolights/world"))
ROOT = Path(__file__).resolve().parent.parent


def part(skytree, name: str):
    """A module of the add-on."""
    return importlib.import_module(f"{skytree.__name__}.{name}")


def shared_map(name: str) -> Path:
    folder = Path(os.environ.get("SKYTREE_SHARED") or ROOT.parent / "shared") / "hdri"
    path = folder / name
    if not path.exists():
        import pytest  # which only the tests have that run in pytest

        pytest.skip(f"{path} is not there")
    return path


def new_scene(width: int = 64, height: int = 48):
    # Factory settings would also disable the add-on.
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "SKYTREE"
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.film_transparent = False
    scene.skytree.samples = 16
    add_camera(scene)
    return scene


def add_camera(scene, location=(0.0, -6.0, 2.0), rotation=(1.31, 0.0, 0.0), **settings):
    data = bpy.data.cameras.new("Camera")
    for name, value in settings.items():
        setattr(data, name, value)
    camera = bpy.data.objects.new("Camera", data)
    camera.location, camera.rotation_euler = location, rotation
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def at_pixel_centers(scene):
    """One sample through each pixel's centre, in both engines: pictures without noise where nothing is
    sampled."""
    scene.skytree.samples = 1
    # Not BOX, whose width is one pixel in both engines.
    scene.skytree.pixel_filter, scene.skytree.filter_width = "BLACKMAN_HARRIS", 0.01
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    scene.cycles.samples = 1


def use_cycles(scene, samples: int, max_bounces: int = 0, seed: int = 0):
    """Cycles without anything that would change the expected value of a pixel."""
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples, cycles.seed = samples, seed
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = max_bounces
    cycles.transparent_max_bounces = 32
    cycles.min_light_bounces = cycles.min_transparent_bounces = 0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.blur_glossy = 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    if hasattr(cycles, "light_sampling_threshold"):
        cycles.light_sampling_threshold = 0.0
    if scene.world:
        # Automatically, Cycles tabulates a map of 4096 x 2048 for seconds before each render.
        scene.world.cycles.sampling_method = "MANUAL"
        scene.world.cycles.sample_map_resolution = 1024 if samples > 1 else 16


def render(scene) -> np.ndarray:
    """The scene rendered by its engine: float32 (height, width, 4), row 0 at the bottom."""
    scene.render.filepath = str(TEMPORARY / "render.exr")
    bpy.ops.render.render(write_still=True)
    return read(scene.render.filepath)


def read(path) -> np.ndarray:
    image = bpy.data.images.load(str(path), check_existing=False)
    try:
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        return pixels.reshape(height, width, -1)
    finally:
        bpy.data.images.remove(image)


def render_skytree(scene, samples: int | None = None, **settings) -> np.ndarray:
    scene.render.engine = "SKYTREE"
    if samples is not None:
        scene.skytree.samples = samples
    for name, value in settings.items():
        setattr(scene.skytree, name, value)
    return render(scene)


def render_cycles(scene, samples: int = 1, max_bounces: int = 0, seed: int = 0) -> np.ndarray:
    use_cycles(scene, samples, max_bounces, seed)
    try:
        return render(scene)
    finally:
        scene.render.engine = "SKYTREE"


def messages(skytree) -> str:
    return "\n".join(part(skytree, "status").last.messages.texts())


# Worlds


def world_tree(scene):
    """(node tree, Background node) of a new world."""
    world = bpy.data.worlds.new("World")
    scene.world = world
    tree = nodes_of(world)
    return tree, next(node for node in tree.nodes if node.type == "BACKGROUND")


def nodes_of(datablock):
    if datablock.node_tree is None:
        datablock.use_nodes = True
    return datablock.node_tree


def set_map(scene, image, rotation=(0.0, 0.0, 0.0), strength: float = 1.0):
    """A world lit by an image (or its path), turned by a Mapping node; its Environment Texture and Mapping
    nodes."""
    tree, background = world_tree(scene)
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image if isinstance(image, bpy.types.Image) else load(image)
    mapping = tree.nodes.new("ShaderNodeMapping")
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Rotation"].default_value = rotation
    background.inputs["Strength"].default_value = strength
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    return texture, mapping


def load(path):
    return bpy.data.images.load(str(path), check_existing=True)


def bundled(name: str = "city"):
    return load(BUNDLED / f"{name}.exr")


def float_image(name: str, pixels: np.ndarray):
    """A float image (height, width, 3) of a file, row 0 at the top as in files."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"  # or saving would encode the values
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels
    image.pixels.foreach_set(rgba[::-1].ravel())
    path = TEMPORARY / f"{name}.exr"
    image.filepath_raw, image.file_format = str(path), "OPEN_EXR"
    image.save()
    bpy.data.images.remove(image)
    image = bpy.data.images.load(str(path))
    image.name = name
    return image


def assert_same_picture(a: np.ndarray, b: np.ndarray):
    """The same bits, but before Blender 4.1: it adds up smooth normals anew for each render, in the order in
    which its threads come, and their last bits vary."""
    tolerance = 1e-4 if bpy.app.version < (4, 1) else 0.0
    np.testing.assert_allclose(a, b, rtol=tolerance, atol=0.1 * tolerance)


def smooth_map(width: int = 64, height: int = 32) -> np.ndarray:
    """A map that is different in every direction, positive, without steps."""
    v, u = (np.indices((height, width)) + 0.5) / np.array([height, width]).reshape(2, 1, 1)
    waves = [
        np.sin(2 * np.pi * (k * u + 0.3 * k)) * np.sin(np.pi * v) + np.cos(np.pi * k * v) for k in (1, 2, 3)
    ]
    return np.stack([1.2 + 0.5 * wave for wave in waves], axis=-1).astype(np.float32)


# Objects


def sphere(scene, location=(0.0, 0.0, 1.0), radius: float = 1.0, material=None, subdivisions: int = 4):
    mesh = bpy.data.meshes.new("Sphere")
    bm = bmesh.new()
    bmesh.ops.create_icosphere(bm, subdivisions=subdivisions, radius=radius)
    bm.to_mesh(mesh)
    bm.free()
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    return _link(scene, mesh, location, material)


def plane(scene, size: float = 20.0, location=(0.0, 0.0, 0.0), material=None, rotation=(0.0, 0.0, 0.0)):
    """A square in XY with one UV map over the unit square."""
    mesh = bpy.data.meshes.new("Plane")
    h = size / 2.0
    mesh.from_pydata([(-h, -h, 0), (h, -h, 0), (h, h, 0), (-h, h, 0)], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", [0, 0, 1, 0, 1, 1, 0, 1])
    ob = _link(scene, mesh, location, material)
    ob.rotation_euler = rotation
    return ob


def _link(scene, mesh, location, material):
    ob = bpy.data.objects.new(mesh.name, mesh)
    ob.location = location
    if material is not None:
        mesh.materials.append(material)
    scene.collection.objects.link(ob)
    return ob


def material(shader: str, name: str = "Material", **inputs):
    """A material of one shader node; `inputs` by socket name, blanks as underscores."""
    created = bpy.data.materials.new(name)
    tree = nodes_of(created)
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    node = tree.nodes.new(shader)
    for key, value in inputs.items():
        set_input(node, key.replace("_", " "), value)
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return created


def set_input(node, name: str, value):
    if isinstance(value, tuple) and len(value) == 3 and node.inputs[name].type == "RGBA":
        value = (*value, 1.0)
    node.inputs[name].default_value = value


def shader_node(created):
    return next(n for n in created.node_tree.nodes if n.type not in {"OUTPUT_MATERIAL"})


def demo_objects(scene):
    """A ground, a diffuse and a glossy sphere."""
    plane(scene, 30.0, material=material("ShaderNodeBsdfDiffuse", "Ground", Color=(0.5, 0.5, 0.5)))
    sphere(scene, (-1.2, 0, 1), material=material("ShaderNodeBsdfDiffuse", "Clay", Color=(0.8, 0.4, 0.2)))
    glossy = material("ShaderNodeBsdfGlossy", "Metal", Color=(0.9, 0.9, 0.9), Roughness=0.4)
    shader_node(glossy).distribution = "GGX"
    sphere(scene, (1.2, 0, 1), material=glossy)


class Updates:
    """Hands each evaluated depsgraph to a renderer while its updates can still be read, as in a 3D view."""

    def __init__(self, renderer):
        self.renderer = renderer

    def __enter__(self):
        bpy.app.handlers.depsgraph_update_post.append(self._on_update)
        bpy.context.view_layer.update()
        return self

    def __exit__(self, *error):
        bpy.context.view_layer.update()
        bpy.app.handlers.depsgraph_update_post.remove(self._on_update)

    def _on_update(self, scene, depsgraph):
        self.renderer.update(depsgraph)

    def now(self):
        bpy.context.view_layer.update()


@contextmanager
def short_of_memory(megabytes: int):
    """Lets this process have no more than so much memory beside what it has."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    limit = pages * resource.getpagesize() + (megabytes << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def large_scene(scene):
    """A million triangles under a map of 4096 x 2048 texels, or $SKYTREE_MAP_WIDTH across; the object and the
    world's Mapping node."""
    ob = million_triangles(scene)
    width = int(os.environ.get("SKYTREE_MAP_WIDTH") or 4096)
    image = bpy.data.images.new("large", width, width // 2, float_buffer=True, alpha=False)
    pixels = np.random.default_rng(1).random((width // 2, width, 4), np.float32) ** 8
    image.pixels.foreach_set(pixels.ravel())
    _, mapping = set_map(scene, image)
    return ob, mapping


def million_triangles(scene):
    n = 708
    xy = np.linspace(-2.0, 2.0, n, dtype=np.float32)
    co = np.stack((*np.meshgrid(xy, xy), np.zeros((n, n), np.float32)), axis=-1).reshape(-1, 3)
    co[:, 2] = 0.2 * np.sin(9 * co[:, 0]) * np.sin(9 * co[:, 1])
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1)
    quads = np.stack((i, i + 1, i + n + 1, i + n), axis=-1).astype(np.int32)
    grid = bpy.data.meshes.new("Grid")
    grid.vertices.add(len(co))
    grid.vertices.foreach_set("co", co.ravel())
    grid.loops.add(quads.size)
    grid.loops.foreach_set("vertex_index", quads.ravel())
    grid.polygons.add(len(quads))
    grid.polygons.foreach_set("loop_start", np.arange(0, quads.size, 4, dtype=np.int32))
    if bpy.app.version < (4, 1, 0):
        grid.polygons.foreach_set("loop_total", np.full(len(quads), 4, np.int32))
    grid.update(calc_edges=True)
    return _link(scene, grid, (0.0, 0.0, 0.0), material("ShaderNodeBsdfDiffuse", "Grey"))
