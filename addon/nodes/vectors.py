# SPDX-License-Identifier: GPL-3.0-or-later
"""Texture coordinates of a node tree as affine maps: a texture is looked up at matrix c + offset."""

from __future__ import annotations

import numpy as np
from mathutils import Euler, Matrix, Vector

from .reader import NodeReader, Place, follow

Affine = tuple[np.ndarray, np.ndarray]

IDENTITY: Affine = (np.eye(3), np.zeros(3))


def affine_direction(place: Place, reader: NodeReader) -> Affine:
    """Coordinates of an Environment Texture as a function of the world's direction (unlinked: the
    direction)."""
    return affine(place, reader, _direction_source, IDENTITY)


def _direction_source(output: Place, reader: NodeReader) -> Affine | None:
    node, name = output.node, output.socket.identifier
    if node.type == "TEX_COORD":
        if name == "Object" and node.object is not None:
            inverse = node.object.matrix_world.inverted_safe()
            return np.array(inverse.to_3x3()), np.array(inverse.translation)
        if name in {"Generated", "Object", "UV"}:
            return IDENTITY
        if name in {"Normal"}:
            return -np.eye(3), np.zeros(3)
    if node.type == "NEW_GEOMETRY" and name == "Position":
        return IDENTITY
    if node.type == "NEW_GEOMETRY" and name in {"Normal", "True Normal", "Incoming"}:
        return -np.eye(3), np.zeros(3)
    return None


def affine(place: Place, reader: NodeReader, source, unlinked: Affine) -> Affine:
    """Affine map from the coordinates that `source(output, reader)` knows to a vector input."""
    output, own = follow(place)
    if output is None:
        return unlinked
    node = output.node
    result = None
    if node.type == "MAPPING":
        result = _mapping(output, reader, source)
    elif node.type == "VECT_MATH":
        result = _vector_math(output, reader, source)
    elif node.type == "VECTOR_ROTATE":
        result = _vector_rotate(output, reader, source)
    else:
        result = source(output, reader)
    if result is None:
        reader.messages.warn(
            f'{reader.owner}: the coordinates from "{node.name}" ({node.bl_label}, {output.socket.name}) '
            f'cannot be read; "{place.node.name}" is looked up without them',
            topic="NODE",
        )
        return unlinked
    return result


def _upstream(place: Place, reader: NodeReader, source) -> Affine:
    """Affine of a vector input of a vector node; unlinked, it is the constant that the socket shows."""
    value = reader.vector(place) if follow(place)[0] is None else None
    return affine(place, reader, source, (np.zeros((3, 3)), np.array(value if value else (0.0, 0.0, 0.0))))


def _constant(place: Place, reader: NodeReader) -> np.ndarray | None:
    value = reader.vector(place)
    return None if value is None else np.array(value)


def _mapping(output: Place, reader: NodeReader, source) -> Affine | None:
    node = output.node
    values = [
        _constant(output.input(name), reader) if output.input(name).socket.enabled else default
        for name, default in (("Location", np.zeros(3)), ("Rotation", np.zeros(3)), ("Scale", np.ones(3)))
    ]
    if any(value is None for value in values):
        return None
    location, rotation, scale = values
    matrix, offset = _upstream(output.input("Vector"), reader, source)
    turn = np.array(Euler(rotation, "XYZ").to_matrix())
    with np.errstate(divide="ignore"):
        inverse_scale = np.where(scale != 0.0, 1.0 / scale, 0.0)
    if node.vector_type == "POINT":
        linear, shift = turn @ np.diag(scale), location
    elif node.vector_type == "TEXTURE":
        linear = np.diag(inverse_scale) @ turn.T
        shift = -linear @ location
    elif node.vector_type == "VECTOR":
        linear, shift = turn @ np.diag(scale), np.zeros(3)
    else:
        # NORMAL also normalises, which the look-up of a direction does anyway.
        linear, shift = turn @ np.diag(inverse_scale), np.zeros(3)
    return linear @ matrix, linear @ offset + shift


def _vector_math(output: Place, reader: NodeReader, source) -> Affine | None:
    node = output.node
    first = Place(node.inputs[0], output.groups)
    second = Place(node.inputs[1], output.groups)
    if node.operation == "NORMALIZE":
        return _upstream(first, reader, source)
    if node.operation == "SCALE":
        matrix, offset = _upstream(first, reader, source)
        factor = reader.number(output.input("Scale"), 1.0)
        return matrix * factor, offset * factor
    if node.operation not in {"ADD", "SUBTRACT", "MULTIPLY", "DIVIDE"}:
        return None
    if follow(first)[0] is None and node.operation in {"ADD", "MULTIPLY"}:
        first, second = second, first
    value = _constant(second, reader) if not _is_coordinate(second) else None
    if value is None:
        return None
    matrix, offset = _upstream(first, reader, source)
    if node.operation == "ADD":
        return matrix, offset + value
    if node.operation == "SUBTRACT":
        return matrix, offset - value
    if node.operation == "DIVIDE":
        value = np.where(value != 0.0, 1.0 / np.where(value != 0.0, value, 1.0), 0.0)
    return np.diag(value) @ matrix, value * offset


def _is_coordinate(place: Place) -> bool:
    output, _ = follow(place)
    return output is not None and output.node.type in {"TEX_COORD", "NEW_GEOMETRY", "UVMAP", "MAPPING"}


def _vector_rotate(output: Place, reader: NodeReader, source) -> Affine | None:
    node = output.node
    center = _constant(output.input("Center"), reader)
    if center is None:
        return None
    if node.rotation_type == "EULER_XYZ":
        rotation = _constant(output.input("Rotation"), reader)
        if rotation is None:
            return None
        turn = Euler(rotation, "XYZ").to_matrix()
    else:
        axis = {"X_AXIS": (1, 0, 0), "Y_AXIS": (0, 1, 0), "Z_AXIS": (0, 0, 1)}.get(node.rotation_type)
        if axis is None:
            axis = _constant(output.input("Axis"), reader)
        if axis is None or not any(axis):
            return None
        turn = Matrix.Rotation(reader.number(output.input("Angle")), 3, Vector(axis))
    turn = np.array(turn)
    if node.invert:
        turn = turn.T
    matrix, offset = _upstream(output.input("Vector"), reader, source)
    return turn @ matrix, turn @ (offset - center) + center


def split_rotation(matrix: np.ndarray, offset: np.ndarray) -> Affine:
    """(rotation, rest) with matrix = rest @ rotation up to a positive factor, which a look-up of directions
    ignores.

    Polar decomposition by the SVD; the rotation is proper, so that a mirroring stays in the rest. With an
    offset nothing can be taken out. The rest is rounded, so that turning a map gives the same rest each
    time."""
    if np.any(offset):
        return np.eye(3), matrix
    u, sizes, vt = np.linalg.svd(matrix)
    if sizes[0] <= 0.0 or sizes[2] < 1e-6 * sizes[0]:
        return np.eye(3), matrix
    rotation = u @ vt
    if np.linalg.det(rotation) < 0.0:
        rotation = -rotation
    rest = np.round(matrix @ rotation.T / sizes[0], 6) + 0.0
    return rotation, rest
