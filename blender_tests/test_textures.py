# SPDX-License-Identifier: GPL-3.0-or-later
"""Image textures on surfaces show what Cycles shows: UVs, their transforms, colour spaces, colour nodes."""

import math

import bpy
import numpy as np
import pytest
import scenes


def checker(name="checker", size=8, byte: bool = False):
    rows, columns = np.indices((size, size))
    pixels = np.stack([rows / size, columns / size, (rows + columns) % 2 * 0.5 + 0.2], axis=-1).astype(
        np.float32
    )
    if not byte:
        return scenes.float_image(name, pixels)
    image = bpy.data.images.new(name, size, size, alpha=False)
    rgba = np.ones((size, size, 4), np.float32)
    rgba[..., :3] = pixels
    image.pixels.foreach_set(rgba[::-1].ravel())
    image.pack()
    return image


class TexturedPlane:
    """An emitting square that fills the frame of an orthographic camera."""

    def __init__(self, scene, image):
        scene.world = bpy.data.worlds.new("Dark")
        background = next(n for n in scenes.nodes_of(scene.world).nodes if n.type == "BACKGROUND")
        background.inputs["Strength"].default_value = 0.0
        scene.render.resolution_x = scene.render.resolution_y = 40
        scene.camera.location, scene.camera.rotation_euler = (0, 0, 5), (0, 0, 0)
        scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 2.0
        self.scene = scene
        self.material = scenes.material("ShaderNodeEmission", "Poster", Strength=1.0)
        self.tree = self.material.node_tree
        self.emission = scenes.shader_node(self.material)
        self.texture = self.tree.nodes.new("ShaderNodeTexImage")
        self.texture.image = image
        self.tree.links.new(self.texture.outputs["Color"], self.emission.inputs["Color"])
        self.object = scenes.plane(scene, 2.0, material=self.material)

    def node(self, kind: str, **properties):
        node = self.tree.nodes.new("ShaderNode" + kind)
        for name, value in properties.items():
            setattr(node, name, value)
        return node

    def mapping(self, kind="POINT", location=(0, 0, 0), rotation=0.0, scale=(1, 1, 1)):
        mapping = self.node("Mapping", vector_type=kind)
        mapping.inputs["Location"].default_value = location
        mapping.inputs["Rotation"].default_value = (0, 0, rotation)
        mapping.inputs["Scale"].default_value = scale
        self.tree.links.new(self.node("TexCoord").outputs["UV"], mapping.inputs["Vector"])
        self.tree.links.new(mapping.outputs["Vector"], self.texture.inputs["Vector"])
        return mapping

    def assert_as_in_cycles(self, tolerance=0.01):
        scenes.at_pixel_centers(self.scene)
        ours = scenes.render_skytree(self.scene)[..., :3]
        theirs = scenes.render_cycles(self.scene)[..., :3]
        assert theirs.std() > 0.05
        # At the edge of a texel the closest one is a matter of rounding.
        assert np.percentile(np.abs(ours - theirs), 98) <= tolerance


@pytest.mark.parametrize("interpolation", ["Linear", "Closest"])
def test_plain_texture(cycles, interpolation):
    poster = TexturedPlane(cycles, checker())
    poster.texture.interpolation = interpolation
    poster.assert_as_in_cycles()


@pytest.mark.parametrize("space", ["sRGB", "Non-Color"])
def test_byte_texture_in_its_colour_space(cycles, space):
    image = checker("bytes", byte=True)
    image.colorspace_settings.name = space
    poster = TexturedPlane(cycles, image)
    # Between texels Cycles interpolates encoded values of byte images, Skytree linear ones.
    poster.texture.interpolation = "Closest"
    poster.assert_as_in_cycles()


@pytest.mark.parametrize("extension", ["REPEAT", "EXTEND", "CLIP", "MIRROR"])
@pytest.mark.parametrize("kind", ["POINT", "TEXTURE"])
def test_mapping_and_extension(cycles, kind, extension):
    poster = TexturedPlane(cycles, checker())
    if extension not in poster.texture.bl_rna.properties["extension"].enum_items:
        pytest.skip(f"this Blender has no {extension}")
    poster.texture.extension = extension
    poster.mapping(kind, (0.2, -0.3, 0), 0.4, (1.7, 2.3, 1) if kind == "POINT" else (0.4, 0.6, 1))
    poster.assert_as_in_cycles()


def test_named_uv_map_and_two_slots(cycles):
    """Two faces, two materials; each asks for another UV map of the same mesh."""
    poster = TexturedPlane(cycles, checker())
    mesh = poster.object.data
    flipped = mesh.uv_layers.new(name="Flipped")
    uvs = np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32)
    flipped.data.foreach_set("uv", 1.0 - uvs)
    uv = poster.node("UVMap", uv_map="Flipped")
    poster.tree.links.new(uv.outputs["UV"], poster.texture.inputs["Vector"])
    poster.assert_as_in_cycles()


def test_colour_nodes_behind_the_texture(cycles):
    poster = TexturedPlane(cycles, checker())
    gamma = poster.node("Gamma")
    gamma.inputs["Gamma"].default_value = 2.2
    mix = poster.node("MixRGB", blend_type="MULTIPLY")
    mix.inputs["Fac"].default_value = 1.0
    mix.inputs["Color2"].default_value = (0.9, 0.5, 0.2, 1.0)
    poster.tree.links.new(poster.texture.outputs["Color"], gamma.inputs["Color"])
    poster.tree.links.new(gamma.outputs["Color"], mix.inputs["Color1"])
    poster.tree.links.new(mix.outputs["Color"], poster.emission.inputs["Color"])
    poster.texture.interpolation = "Closest"
    poster.assert_as_in_cycles()


def test_texture_on_base_color_lights_up(cycles):
    """Diffuse and Principled base colours under a white world: the albedo is seen."""
    scene = cycles
    poster = TexturedPlane(scene, checker())
    background = next(n for n in scene.world.node_tree.nodes if n.type == "BACKGROUND")
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = 1.0
    diffuse = poster.node("BsdfDiffuse")
    output = next(n for n in poster.tree.nodes if n.type == "OUTPUT_MATERIAL")
    poster.tree.links.new(poster.texture.outputs["Color"], diffuse.inputs["Color"])
    poster.tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    scenes.at_pixel_centers(scene)
    ours = scenes.render_skytree(scene, 64)[..., :3]
    theirs = scenes.render_cycles(scene, 64)[..., :3]
    assert np.percentile(np.abs(ours - theirs), 98) <= 0.03


def test_missing_file_is_magenta_and_named(scene, skytree):
    poster = TexturedPlane(scene, None)
    image = bpy.data.images.new("gone", 4, 4)
    image.source = "FILE"
    image.filepath = "/nonexistent/wood.png"
    poster.texture.image = image
    picture = scenes.render_skytree(scene, 1)
    np.testing.assert_allclose(picture[20, 20, :3], (1, 0, 1), atol=1e-3)
    text = scenes.messages(skytree)
    assert "/nonexistent/wood.png" in text and "Poster" in text


def test_box_projection_is_named(scene, skytree):
    poster = TexturedPlane(scene, checker())
    poster.texture.projection = "BOX"
    scenes.render_skytree(scene, 1)
    assert "Box" in scenes.messages(skytree)


def test_rotated_object_keeps_its_uvs(cycles):
    poster = TexturedPlane(cycles, checker())
    poster.object.rotation_euler = (0, 0, math.radians(30))
    poster.assert_as_in_cycles()


def irradiance_above(normal, pixels):
    """Of a lat-long map, over the directions that see a horizontal surface's front, weighted by `normal`."""
    height, width = pixels.shape[:2]
    theta = ((np.arange(height) + 0.5) * math.pi / height)[:, None]
    phi = (0.5 - (np.arange(width) + 0.5) / width) * 2.0 * math.pi
    x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0.0 * phi
    cosine = np.maximum(normal[0] * x + normal[1] * y + normal[2] * z, 0.0) * (z > 0.0)
    solid_angle = np.sin(theta) * (math.pi / height) * (2.0 * math.pi / width)
    return np.einsum("ij,ijk->k", cosine * solid_angle, pixels)


@pytest.mark.parametrize("strength", [1.0, 0.5])
def test_normal_map(scene, strength):
    """A diffuse square, half of it with leaning normals, reflects the irradiance along them. Cycles is no
    reference here: it darkens leaning normals by a shadowing term."""
    poster = TexturedPlane(scene, None)
    scenes.set_map(scene, scenes.float_image("smooth", scenes.smooth_map(512, 256)))
    leaning = np.array((0.7, 0.4, 0.9))
    pixels = np.full((8, 8, 3), (0.5, 0.5, 1.0), np.float32)
    pixels[:, 4:] = leaning
    image = scenes.float_image("normals", pixels)
    image.colorspace_settings.name = "Non-Color"
    poster.texture.image, poster.texture.interpolation = image, "Closest"
    diffuse, normal_map = poster.node("BsdfDiffuse"), poster.node("NormalMap")
    diffuse.inputs["Color"].default_value = (0.5, 0.5, 0.5, 1.0)
    normal_map.inputs["Strength"].default_value = strength
    output = next(n for n in poster.tree.nodes if n.type == "OUTPUT_MATERIAL")
    poster.tree.links.new(poster.texture.outputs["Color"], normal_map.inputs["Color"])
    poster.tree.links.new(normal_map.outputs["Normal"], diffuse.inputs["Normal"])
    poster.tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    scene.skytree.control_variate = scene.skytree.adaptive_sampling = False  # the least noise, here
    picture = scenes.render_skytree(scene, 256, max_bounces=0)[..., :3]

    up = np.array((0.0, 0.0, 1.0))
    mapped = (2.0 * leaning - 1.0) / np.linalg.norm(2.0 * leaning - 1.0)
    blended = up + (mapped - up) * strength
    for half, normal in ((np.s_[2:38, 2:18], up), (np.s_[2:38, 22:38], blended / np.linalg.norm(blended))):
        expected = 0.5 / math.pi * irradiance_above(normal, scenes.smooth_map(512, 256))
        np.testing.assert_allclose(picture[half].mean(axis=(0, 1)), expected, rtol=2e-3)
