# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks a shader node tree: links through groups, reroutes and muted nodes; values as expressions.

Sockets are looked up by identifier, which Blender keeps across versions while it renames labels
(Fac to Factor, Bright to Brightness).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..messages import Messages
from . import expression as ex

MAX_DEPTH = 200
RAMP_STEPS = 256


class Place(NamedTuple):
    """A socket and the group nodes one has to enter, outermost first, to be in its tree."""

    socket: object
    groups: tuple = ()

    @property
    def node(self):
        return self.socket.node

    def input(self, identifier: str) -> Place | None:
        """Input of the same node, or None if this Blender's node has none of that identifier."""
        found = find_socket(self.node.inputs, identifier)
        return None if found is None else Place(found, self.groups)


def find_socket(sockets, identifier: str):
    return next((socket for socket in sockets if socket.identifier == identifier), None)


def follow(place: Place) -> tuple[Place | None, Place]:
    """(output that feeds `place` or None, input whose own value counts if nothing does)."""
    own = place
    for _ in range(MAX_DEPTH):
        link = next((link for link in place.socket.links if link.is_valid and not link.is_muted), None)
        if link is None:
            # Behind a reroute or a muted node there is no value: the socket that asked keeps its own.
            return None, own
        node, output = link.from_node, link.from_socket
        if node.type == "REROUTE":
            place = Place(node.inputs[0], place.groups)
        elif node.mute:
            through = next((inner for inner in node.internal_links if inner.to_socket == output), None)
            if through is None:
                return None, own
            place = Place(through.from_socket, place.groups)
        elif node.type == "GROUP" and node.node_tree:
            exit_node = next(
                (n for n in node.node_tree.nodes if n.type == "GROUP_OUTPUT" and n.is_active_output), None
            )
            inner = exit_node and find_socket(exit_node.inputs, output.identifier)
            if not inner:
                return None, own
            place = own = Place(inner, (*place.groups, node))
        elif node.type == "GROUP_INPUT" and place.groups:
            outer = find_socket(place.groups[-1].inputs, output.identifier)
            if outer is None:
                return None, own
            place = own = Place(outer, place.groups[:-1])
        else:
            return Place(output, place.groups), own
    return None, own


def active_output(node_tree, node_type: str):
    """The output node that Cycles renders: `node_type` is OUTPUT_WORLD or OUTPUT_MATERIAL; None if there is
    none."""
    candidates = [
        n for n in node_tree.nodes if n.type == node_type and n.target in {"ALL", "CYCLES"} and not n.mute
    ]
    return next((n for n in candidates if n.is_active_output), candidates[0] if candidates else None)


class NodeReader:
    """Reads values of one datablock's node tree.

    `owner` names it in messages; `image_leaf(place, messages)` makes the expression of an image texture
    node's output; `camera_ray` is what Light Path's Is Camera Ray says (0 for the lighting of a world).
    """

    def __init__(
        self,
        owner: str,
        messages: Messages,
        image_leaf: Callable[[Place], ex.Expression | None],
        camera_ray: float = 0.0,
    ):
        self.owner = owner
        self.messages = messages
        self.camera_ray = camera_ray
        self._image_leaf = image_leaf

    def value(self, place: Place) -> ex.Expression:
        """Expression of an input, with as many channels as its socket type has."""
        output, own = follow(place)
        if output is not None:
            result = self.output(output)
            if result is not None:
                return _convert(result, output.socket, place.socket)
            self.messages.warn(
                f'{self.owner}: the node "{output.node.name}" ({output.node.bl_label}) cannot be read; '
                f'"{place.socket.name}" of "{place.node.name}" keeps the value that its own socket shows',
                topic="NODE",
            )
            own = place
        return _convert(ex.constant(own.socket.default_value), own.socket, place.socket)

    def number(self, place: Place | None, default: float = 0.0) -> float:
        """A scalar input that has to be one number: what varies over an image is averaged, with a message."""
        if place is None:
            return default
        expression = ex.scalar(self.value(place))
        if isinstance(expression, ex.Constant):
            return expression.values[0]
        self.messages.warn(
            f'{self.owner}: "{place.socket.name}" of "{place.node.name}" varies over an image; '
            "its mean is used instead"
        )
        return self.mean(expression)

    def mean(self, expression: ex.Expression) -> float:
        from ..images import mean_value

        return mean_value(expression, self.messages)

    def vector(self, place: Place) -> tuple[float, float, float] | None:
        """A vector input if it is constant, else None."""
        expression = self.value(place)
        return ex.rgb(expression) if isinstance(expression, ex.Constant) else None

    def output(self, output: Place) -> ex.Expression | None:
        """Expression of an output socket, or None if the node cannot be read."""
        node = output.node
        if node.type in {"TEX_IMAGE", "TEX_ENVIRONMENT"}:
            return self._image_leaf(output)
        handler = _HANDLERS.get(node.type)
        return handler(self, output, node) if handler else None

    def inputs(self, output: Place, *identifiers: str) -> list[ex.Expression]:
        return [self.value(output.input(identifier)) for identifier in identifiers]


def _convert(value: ex.Expression, source, target) -> ex.Expression:
    if target.type in {"RGBA", "VECTOR"}:
        if ex.channels(value) == 3:
            return value
        return ex.call("combine", value, value, value)
    return ex.scalar(value, is_vector=source.type == "VECTOR")


def _own_value(reader, output, node):
    return ex.constant(output.socket.default_value)


def _math(reader, output, node):
    # The three inputs share the label "Value"; one that an operation does not use is hidden but present.
    args = [ex.scalar(reader.value(Place(socket, output.groups))) for socket in node.inputs[:3]]
    if node.operation not in _known_math():
        return None
    return ex.call("math", *args, settings=(node.operation, node.use_clamp))


def _known_math():
    from .node_ops import MATH

    return MATH


def _mix_rgb(reader, output, node):
    factor, a, b = reader.inputs(output, "Fac", "Color1", "Color2")
    return ex.call("mix", factor, a, b, settings=(node.blend_type, True, node.use_clamp))


def _mix(reader, output, node):
    if node.data_type == "RGBA":
        factor, a, b = reader.inputs(output, "Factor_Float", "A_Color", "B_Color")
        return ex.call("mix", factor, a, b, settings=(node.blend_type, node.clamp_factor, node.clamp_result))
    if node.data_type == "FLOAT":
        factor, a, b = reader.inputs(output, "Factor_Float", "A_Float", "B_Float")
    elif node.data_type == "VECTOR":
        factor_name = "Factor_Vector" if node.factor_mode == "NON_UNIFORM" else "Factor_Float"
        factor, a, b = reader.inputs(output, factor_name, "A_Vector", "B_Vector")
    else:
        return None
    return ex.call("mix", factor, a, b, settings=("MIX", node.clamp_factor, False))


def _gamma(reader, output, node):
    return ex.call("gamma", *reader.inputs(output, "Color", "Gamma"))


def _bright_contrast(reader, output, node):
    return ex.call("bright_contrast", *reader.inputs(output, "Color", "Bright", "Contrast"))


def _hue_saturation(reader, output, node):
    return ex.call("hue_saturation", *reader.inputs(output, "Hue", "Saturation", "Value", "Fac", "Color"))


def _invert(reader, output, node):
    return ex.call("invert", *reader.inputs(output, "Fac", "Color"))


def _map_range(reader, output, node):
    if node.data_type != "FLOAT" or node.interpolation_type != "LINEAR":
        return None
    args = reader.inputs(output, "Value", "From Min", "From Max", "To Min", "To Max")
    return ex.call("map_range", *args, settings=(node.clamp,))


def _clamp(reader, output, node):
    value, low, high = reader.inputs(output, "Value", "Min", "Max")
    if node.clamp_type == "RANGE" and isinstance(low, ex.Constant) and isinstance(high, ex.Constant):
        low, high = sorted((low, high), key=lambda c: c.values)
    return ex.call("clamp", value, low, high)


def _color_ramp(reader, output, node):
    (factor,) = reader.inputs(output, "Fac")
    if output.socket.identifier == "Alpha":
        return None
    table = tuple(tuple(node.color_ramp.evaluate(i / (RAMP_STEPS - 1))[:3]) for i in range(RAMP_STEPS))
    return ex.call("color_ramp", factor, settings=(table,))


def _rgb_to_bw(reader, output, node):
    return ex.scalar(reader.inputs(output, "Color")[0])


def _separate(identifier):
    def handler(reader, output, node):
        (color,) = reader.inputs(output, identifier)
        mode = getattr(node, "mode", "RGB")
        if mode == "HSL":
            return None
        if mode == "HSV" or node.type == "SEPHSV":
            color = ex.call("rgb_to_hsv", color)
        return ex.call("channel", color, settings=(list(node.outputs).index(output.socket),))

    return handler


def _combine(reader, output, node):
    mode = getattr(node, "mode", "RGB")
    if mode == "HSL":
        return None
    args = [ex.scalar(reader.value(Place(socket, output.groups))) for socket in node.inputs[:3]]
    color = ex.call("combine", *args)
    return ex.call("hsv_to_rgb", color) if mode == "HSV" or node.type == "COMBHSV" else color


def _light_path(reader, output, node):
    if output.socket.identifier == "Is Camera Ray":
        reader.messages.warn(
            f"{reader.owner}: Light Path is read once for all rays, "
            f"with Is Camera Ray = {reader.camera_ray:g}"
        )
        return ex.constant(reader.camera_ray)
    if output.socket.identifier.startswith("Is "):
        reader.messages.warn(
            f"{reader.owner}: Light Path is read once for all rays, with {output.socket.identifier} = 0"
        )
        return ex.constant(0.0)
    return None


_HANDLERS = {
    "RGB": _own_value,
    "VALUE": _own_value,
    "MATH": _math,
    "MIX_RGB": _mix_rgb,
    "MIX": _mix,
    "GAMMA": _gamma,
    "BRIGHTCONTRAST": _bright_contrast,
    "HUE_SAT": _hue_saturation,
    "INVERT": _invert,
    "MAP_RANGE": _map_range,
    "CLAMP": _clamp,
    "VALTORGB": _color_ramp,
    "RGBTOBW": _rgb_to_bw,
    "SEPARATE_COLOR": _separate("Color"),
    "SEPRGB": _separate("Image"),
    "SEPHSV": _separate("Color"),
    "SEPXYZ": _separate("Vector"),
    "COMBINE_COLOR": _combine,
    "COMBRGB": _combine,
    "COMBHSV": _combine,
    "COMBXYZ": _combine,
    "LIGHT_PATH": _light_path,
}
