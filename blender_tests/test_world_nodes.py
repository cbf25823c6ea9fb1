# SPDX-License-Identifier: GPL-3.0-or-later
"""Every node tree of a world that Skytree reads shows what Cycles shows; what it cannot read is named."""

import math

import bpy
import numpy as np
import pytest
import scenes
from test_world import assert_same_picture


class Builder:
    """Short names for building a world's node tree on a smooth map."""

    def __init__(self, scene):
        self.scene = scene
        self.tree, self.background = scenes.world_tree(scene)
        self.output = next(n for n in self.tree.nodes if n.type == "OUTPUT_WORLD")

    def node(self, kind: str, inputs=None, **properties):
        node = self.tree.nodes.new("ShaderNode" + kind)
        for name, value in properties.items():
            setattr(node, name, value)
        for key, value in (inputs or {}).items():
            node.inputs[key].default_value = value
        return node

    def link(self, source, target):
        """From a node's first output, or a socket, to a socket."""
        self.tree.links.new(source.outputs[0] if hasattr(source, "outputs") else source, target)

    def map(self, vector=None, pixels=None):
        image = scenes.float_image("smooth", scenes.smooth_map() if pixels is None else pixels)
        texture = self.node("TexEnvironment", image=image)
        if vector is not None:
            self.link(vector, texture.inputs["Vector"])
        return texture

    def mapping(self, kind="POINT", location=None, rotation=(0, 0, 0), scale=(1, 1, 1)):
        coordinates = self.node("TexCoord")
        mapping = self.node("Mapping", vector_type=kind)
        mapping.inputs["Rotation"].default_value = rotation
        mapping.inputs["Scale"].default_value = scale
        if location:
            mapping.inputs["Location"].default_value = location
        self.link(coordinates.outputs["Generated"], mapping.inputs["Vector"])
        return mapping

    def show(self, color, strength=None):
        self.link(color, self.background.inputs["Color"])
        if strength is not None:
            self.link(strength, self.background.inputs["Strength"])


def value(b, x):
    node = b.node("Value")
    node.outputs[0].default_value = x
    return node


def rgb(b, color):
    node = b.node("RGB")
    node.outputs[0].default_value = (*color, 1.0)
    return node


def socket(node, identifier, kind="inputs"):
    return next(s for s in getattr(node, kind) if s.identifier == identifier)


def plain(b):
    b.show(b.map())


def constant(b):
    b.background.inputs["Color"].default_value = (0.2, 0.4, 0.6, 1.0)
    b.background.inputs["Strength"].default_value = 2.0


def mapping_texture(b):
    b.show(b.map(b.mapping("TEXTURE", rotation=(0.5, 0.2, 1.0))))


def mapping_vector(b):
    b.show(b.map(b.mapping("VECTOR", rotation=(0.5, 0.2, 1.0))))


def mapping_normal(b):
    b.show(b.map(b.mapping("NORMAL", rotation=(0.5, 0.2, 1.0))))


def mapping_mirrored(b):
    b.show(b.map(b.mapping(rotation=(0, 0, 0.7), scale=(-1, 1, 1))))


def mapping_stretched(b):
    b.show(b.map(b.mapping(rotation=(0.3, 0, 0.7), scale=(1, 1, 2.5))))


def mapping_shrunk(b):
    b.show(b.map(b.mapping(scale=(0.2, 0.2, 0.2))))


def mapping_moved(b):
    b.show(b.map(b.mapping(location=(0.2, 0, 0.5), rotation=(0, 0, 1))))


def mapping_texture_moved(b):
    b.show(b.map(b.mapping("TEXTURE", location=(0.2, 0, 0.5), rotation=(0, 0, 1), scale=(1, 2, 1))))


def mapping_twice(b):
    first = b.mapping(rotation=(0, 0, 0.5))
    second = b.node("Mapping", {"Rotation": (0.4, 0, 0)})
    b.link(first, second.inputs["Vector"])
    b.show(b.map(second))


def mapping_linked_rotation(b):
    mapping = b.mapping()
    combine = b.node("CombineXYZ", {"Z": 0.9})
    b.link(combine, mapping.inputs["Rotation"])
    b.show(b.map(mapping))


def coordinates_object_none(b):
    b.show(b.map(b.node("TexCoord").outputs["Object"]))


def coordinates_of_object(b):
    empty = bpy.data.objects.new("Empty", None)
    empty.rotation_euler = (0.2, 0.3, 1.0)
    empty.location = (0.1, 0.3, 0.0)
    b.scene.collection.objects.link(empty)
    bpy.context.view_layer.update()
    b.show(b.map(b.node("TexCoord", object=empty).outputs["Object"]))


def coordinates_normal(b):
    b.show(b.map(b.node("TexCoord").outputs["Normal"]))


def geometry_position(b):
    b.show(b.map(b.node("NewGeometry").outputs["Position"]))


def geometry_incoming(b):
    b.show(b.map(b.node("NewGeometry").outputs["Incoming"]))


def vector_math(b):
    math_node = b.node("VectorMath", operation="MULTIPLY")
    b.link(b.node("TexCoord").outputs["Generated"], math_node.inputs[0])
    math_node.inputs[1].default_value = (1.0, -1.0, 1.0)
    b.show(b.map(math_node))


def vector_rotate(b):
    rotate = b.node("VectorRotate", {"Angle": 0.8}, rotation_type="Z_AXIS")
    b.link(b.node("TexCoord").outputs["Generated"], rotate.inputs["Vector"])
    b.show(b.map(rotate))


def vector_rotate_euler(b):
    rotate = b.node("VectorRotate", {"Rotation": (0.3, 0.5, 0.8)}, rotation_type="EULER_XYZ", invert=True)
    b.link(b.node("TexCoord").outputs["Generated"], rotate.inputs["Vector"])
    b.show(b.map(rotate))


def mirror_ball(b):
    texture = b.map()
    texture.projection = "MIRROR_BALL"
    texture.image = scenes.float_image("ball", scenes.smooth_map(128, 128))
    b.show(texture)


def multiplied(b):
    mix = b.node("MixRGB", {"Color2": (0.2, 0.5, 0.9, 1.0), "Fac": 0.7}, blend_type="MULTIPLY")
    b.link(b.map(), mix.inputs["Color1"])
    b.show(mix)


def gamma(b):
    node = b.node("Gamma", {"Gamma": 1.7})
    b.link(b.map(b.mapping(rotation=(0, 0, 0.6))), node.inputs["Color"])
    b.show(node)


def brightness(b):
    node = b.node("BrightContrast", {1: 0.2, "Contrast": 0.3})
    b.link(b.map(), node.inputs["Color"])
    b.show(node)


def hue(b):
    node = b.node("HueSaturation", {"Hue": 0.7, "Saturation": 0.6, "Value": 1.3})
    b.link(b.map(), node.inputs["Color"])
    b.show(node)


def inverted(b):
    node = b.node("Invert", {0: 0.3})
    b.link(b.map(), node.inputs["Color"])
    b.show(node)


def color_ramp(b):
    ramp = b.node("ValToRGB")
    ramp.color_ramp.elements[0].color = (0.1, 0.2, 0.8, 1.0)
    ramp.color_ramp.elements[1].color = (0.9, 0.4, 0.1, 1.0)
    b.link(b.map(), ramp.inputs[0])
    b.show(ramp)


def to_grey(b):
    node = b.node("RGBToBW")
    b.link(b.map(), node.inputs["Color"])
    b.show(node)


def separated(b):
    separate, combine = b.node("SeparateColor"), b.node("CombineColor")
    b.link(b.map(), separate.inputs[0])
    for source, target in ((0, 2), (1, 0), (2, 1)):
        b.link(separate.outputs[source], combine.inputs[target])
    b.show(combine)


def separated_hsv(b):
    separate, combine = b.node("SeparateColor", mode="HSV"), b.node("CombineColor", mode="HSV")
    b.link(b.map(), separate.inputs[0])
    for i in range(3):
        b.link(separate.outputs[i], combine.inputs[i])
    combine_value = b.node("Math", {1: 0.5}, operation="MULTIPLY")
    b.link(separate.outputs[2], combine_value.inputs[0])
    b.link(combine_value, combine.inputs[2])
    b.show(combine)


def map_range(b):
    node = b.node("MapRange", {"From Min": 0.5, "From Max": 2.0, "To Min": 0.2, "To Max": 0.9})
    b.link(b.map(), node.inputs["Value"])
    b.show(node)


def clamped(b):
    node = b.node("Clamp", {"Min": 0.6, "Max": 1.4})
    b.link(b.map(), node.inputs["Value"])
    b.show(node)


def strength_from_math(b):
    power = b.node("Math", {1: 3.0}, operation="POWER")
    b.link(value(b, 1.3), power.inputs[0])
    b.show(b.map(), power)


def strength_from_map(b):
    b.show(rgb(b, (0.4, 0.5, 0.6)), b.map())


def mix_shader(b):
    other = b.node("Background", {"Color": (0.9, 0.1, 0.1, 1.0), "Strength": 0.5})
    mix = b.node("MixShader", {0: 0.3})
    b.show(b.map(b.mapping(rotation=(0, 0, 1))))
    b.link(b.background, mix.inputs[1])
    b.link(other, mix.inputs[2])
    b.link(mix, b.output.inputs["Surface"])


def mix_shader_by_map(b):
    other = b.node("Background", {"Color": (0.9, 0.1, 0.1, 1.0)})
    mix = b.node("MixShader")
    b.show(b.map())
    half = b.node("Math", {1: 0.4}, operation="MULTIPLY")
    b.link(b.map(), half.inputs[0])
    b.link(half, mix.inputs[0])
    b.link(b.background, mix.inputs[1])
    b.link(other, mix.inputs[2])
    b.link(mix, b.output.inputs["Surface"])


def add_shader_two_rotations(b):
    other = b.node("Background")
    b.link(b.map(b.mapping(rotation=(0.5, 0, 2))), other.inputs["Color"])
    add = b.node("AddShader")
    b.show(b.map(b.mapping(rotation=(0, 0, 1))))
    b.link(b.background, add.inputs[0])
    b.link(other, add.inputs[1])
    b.link(add, b.output.inputs["Surface"])


def emission(b):
    node = b.node("Emission", {"Strength": 0.7})
    b.link(b.map(), node.inputs["Color"])
    b.link(node, b.output.inputs["Surface"])


def color_without_shader(b):
    b.link(b.map(), b.output.inputs["Surface"])


def rerouted(b):
    reroute = b.tree.nodes.new("NodeReroute")
    b.link(b.map(), reroute.inputs[0])
    b.show(reroute)


def muted(b):
    node = b.node("Gamma", {"Gamma": 3.0}, mute=True)
    b.link(b.map(), node.inputs["Color"])
    b.show(node)


def muted_mapping(b):
    mapping = b.mapping(rotation=(0, 0, 2))
    mapping.mute = True
    b.show(b.map(mapping))


def second_output_active(b):
    b.background.inputs["Color"].default_value = (1, 0, 0, 1)
    other = b.node("Background")
    b.link(b.map(), other.inputs["Color"])
    output = b.node("OutputWorld")
    b.link(other, output.inputs["Surface"])
    for node in b.tree.nodes:
        if node.type == "OUTPUT_WORLD":
            node.is_active_output = node == output
    output.is_active_output = True


def group_tree(name, inputs, outputs):
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    for direction, sockets in (("INPUT", inputs), ("OUTPUT", outputs)):
        for label, kind in sockets:
            if hasattr(tree, "interface"):
                tree.interface.new_socket(label, in_out=direction, socket_type=kind)
            else:
                (tree.inputs if direction == "INPUT" else tree.outputs).new(kind, label)
    return tree, tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")


def grouped(b):
    """The image inside an inner group, its gamma from the outer group's own input, a factor linked."""
    inner, inner_in, inner_out = group_tree(
        "Inner", [("Gamma", "NodeSocketFloat")], [("Color", "NodeSocketColor")]
    )
    texture = inner.nodes.new("ShaderNodeTexEnvironment")
    texture.image = scenes.float_image("smooth", scenes.smooth_map())
    gamma_node = inner.nodes.new("ShaderNodeGamma")
    inner.links.new(texture.outputs[0], gamma_node.inputs["Color"])
    inner.links.new(inner_in.outputs[0], gamma_node.inputs["Gamma"])
    inner.links.new(gamma_node.outputs[0], inner_out.inputs[0])
    outer, outer_in, outer_out = group_tree(
        "Outer",
        [("Gamma", "NodeSocketFloat"), ("Strength", "NodeSocketFloat")],
        [("Shader", "NodeSocketShader")],
    )
    call = outer.nodes.new("ShaderNodeGroup")
    call.node_tree = inner
    background = outer.nodes.new("ShaderNodeBackground")
    outer.links.new(outer_in.outputs[0], call.inputs[0])
    outer.links.new(outer_in.outputs[1], background.inputs["Strength"])
    outer.links.new(call.outputs[0], background.inputs["Color"])
    outer.links.new(background.outputs[0], outer_out.inputs[0])
    top = b.node("Group", node_tree=outer)
    top.inputs[0].default_value = 1.6
    b.link(value(b, 1.2), top.inputs[1])
    b.link(top, b.output.inputs["Surface"])


def mix_node(b):
    node = b.node("Mix", data_type="RGBA", blend_type="SCREEN", clamp_result=True)
    socket(node, "Factor_Float").default_value = 0.6
    socket(node, "B_Color").default_value = (0.3, 0.2, 0.1, 1.0)
    b.link(b.map(), socket(node, "A_Color"))
    b.show(socket(node, "Result_Color", "outputs"))


def mix_node_float(b):
    node = b.node("Mix", data_type="FLOAT")
    socket(node, "Factor_Float").default_value = 0.25
    socket(node, "A_Float").default_value = 0.3
    b.link(b.map(), socket(node, "B_Float"))
    b.show(b.map(), socket(node, "Result_Float", "outputs"))


CASES = [
    plain, constant, mapping_texture, mapping_vector, mapping_normal, mapping_mirrored, mapping_stretched,
    mapping_shrunk, mapping_moved, mapping_texture_moved, mapping_twice, mapping_linked_rotation,
    coordinates_object_none, coordinates_of_object, coordinates_normal, geometry_position, geometry_incoming,
    vector_math, vector_rotate, vector_rotate_euler, mirror_ball, multiplied, gamma, brightness, hue,
    inverted, color_ramp, to_grey, separated, separated_hsv, map_range, clamped, strength_from_math,
    strength_from_map, mix_shader, mix_shader_by_map, add_shader_two_rotations, emission,
    color_without_shader, rerouted, muted, muted_mapping, second_output_active, grouped, mix_node,
    mix_node_float,
]  # fmt: skip


@pytest.mark.parametrize("build", CASES, ids=lambda f: f.__name__)
def test_shows_what_cycles_shows(cycles, skytree, build):
    build(Builder(cycles))
    cycles.camera.data.angle = math.radians(110)
    assert_same_picture(cycles, tolerance=0.02)
    assert "cannot be read" not in scenes.messages(skytree)


BLENDS = [
    "MIX",
    "DARKEN",
    "MULTIPLY",
    "BURN",
    "LIGHTEN",
    "SCREEN",
    "DODGE",
    "ADD",
    "OVERLAY",
    "SOFT_LIGHT",
    "LINEAR_LIGHT",
    "DIFFERENCE",
    "EXCLUSION",
    "SUBTRACT",
    "DIVIDE",
    "HUE",
    "SATURATION",
    "COLOR",
    "VALUE",
]


@pytest.mark.parametrize("blend", BLENDS)
def test_blend_mode(cycles, blend):
    if blend == "EXCLUSION" and bpy.app.version < (4, 0, 0):
        pytest.skip("this Blender has no Exclusion")
    b = Builder(cycles)
    mix = b.node("MixRGB", {"Color2": (0.2, 0.6, 0.9, 1.0), "Fac": 0.7}, blend_type=blend)
    half = b.node("MixRGB", {"Color2": (0.4, 0.4, 0.4, 1.0), "Fac": 1.0}, blend_type="MULTIPLY")
    b.link(b.map(), half.inputs["Color1"])
    b.link(half, mix.inputs["Color1"])
    b.show(mix)
    assert_same_picture(cycles, tolerance=0.02)


MATHS = [
    "ADD",
    "SUBTRACT",
    "MULTIPLY",
    "DIVIDE",
    "MULTIPLY_ADD",
    "POWER",
    "LOGARITHM",
    "SQRT",
    "INVERSE_SQRT",
    "ABSOLUTE",
    "EXPONENT",
    "MINIMUM",
    "MAXIMUM",
    "LESS_THAN",
    "GREATER_THAN",
    "SIGN",
    "COMPARE",
    "ROUND",
    "FLOOR",
    "CEIL",
    "TRUNC",
    "FRACT",
    "MODULO",
    "WRAP",
    "SNAP",
    "PINGPONG",
    "SINE",
    "COSINE",
    "TANGENT",
    "ARCSINE",
    "ARCCOSINE",
    "ARCTANGENT",
    "ARCTAN2",
    "SINH",
    "COSH",
    "TANH",
    "RADIANS",
    "DEGREES",
]


@pytest.mark.parametrize("operation", MATHS)
def test_math_of_constants(cycles, skytree, operation):
    b = Builder(cycles)
    node = b.node("Math", {0: 0.73, 1: 0.41, 2: 0.27}, operation=operation)
    b.show(rgb(b, (0.5, 0.6, 0.7)), node)
    scenes.at_pixel_centers(cycles)
    ours, theirs = scenes.render_skytree(cycles), scenes.render_cycles(cycles)
    np.testing.assert_allclose(ours[..., :3], np.maximum(theirs[..., :3], 0.0), rtol=1e-3, atol=1e-4)


def test_unknown_node_is_named_and_not_black(scene, skytree):
    b = Builder(scene)
    b.background.inputs["Color"].default_value = (0.3, 0.3, 0.3, 1.0)
    noise = b.node("TexNoise")
    b.show(noise.outputs["Color"])
    picture = scenes.render_skytree(scene, samples=1)
    text = scenes.messages(skytree)
    assert "Noise Texture" in text and 'World "' in text
    np.testing.assert_allclose(picture[..., :3], 0.3, rtol=1e-3)


def test_unknown_coordinates_are_named(scene, skytree):
    b = Builder(scene)
    b.show(b.map(b.node("TexCoord").outputs["Window"]))
    picture = scenes.render_skytree(scene, samples=1)
    assert "Window" in scenes.messages(skytree)
    assert picture[..., :3].min() > 0.1


def test_light_path_is_read_as_lighting(scene, skytree):
    b = Builder(scene)
    camera_side = b.node("Background", {"Color": (0, 0, 1, 1)})
    b.background.inputs["Color"].default_value = (1, 0, 0, 1)
    mix = b.node("MixShader")
    b.link(b.node("LightPath").outputs["Is Camera Ray"], mix.inputs[0])
    b.link(b.background, mix.inputs[1])
    b.link(camera_side, mix.inputs[2])
    b.link(mix, b.output.inputs["Surface"])
    picture = scenes.render_skytree(scene, samples=1)
    np.testing.assert_allclose(picture[0, 0, :3], (1, 0, 0), atol=1e-4)
    assert "Is Camera Ray" in scenes.messages(skytree)


def test_no_output_and_no_link_are_black_and_said(scene, skytree):
    b = Builder(scene)
    b.tree.links.clear()
    assert not scenes.render_skytree(scene, samples=1)[..., :3].any()
    assert "nothing is linked" in scenes.messages(skytree)
    b.tree.nodes.remove(b.output)
    assert not scenes.render_skytree(scene, samples=1)[..., :3].any()
    assert "no World Output" in scenes.messages(skytree)


def test_animated_strength_and_driver(scene):
    b = Builder(scene)
    b.show(rgb(b, (0.5, 0.5, 0.5)))
    strength = b.background.inputs["Strength"]
    strength.default_value = 1.0
    strength.keyframe_insert("default_value", frame=1)
    strength.default_value = 4.0
    strength.keyframe_insert("default_value", frame=3)
    values = []
    for frame in (1, 3):
        scene.frame_set(frame)
        values.append(scenes.render_skytree(scene, samples=1)[0, 0, 0])
    np.testing.assert_allclose(values, (0.5, 2.0), rtol=1e-4)
