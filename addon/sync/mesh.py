# SPDX-License-Identifier: GPL-3.0-or-later
"""Triangles, normals and UVs of an evaluated object as numpy arrays, by the fastest call that each Blender
has."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..messages import Messages

GEOMETRY_TYPES = {"MESH", "CURVE", "SURFACE", "FONT", "META"}
# From 4.1 on normals, positions and UVs are attributes, which are read an order of magnitude faster.
HAS_ATTRIBUTES = bpy.app.version >= (4, 1, 0)


@dataclass
class MeshArrays:
    """Arguments of skytree_core's Scene.add_mesh; `corners` index the polygons' corners."""

    positions: np.ndarray  # (V, 3) float32
    triangles: np.ndarray  # (T, 3) int32
    corners: np.ndarray | None  # (T, 3) int32
    corner_normals: np.ndarray | None  # (C, 3) float32; None: flat
    corner_uvs: np.ndarray | None  # (C, 2) float32
    material_slots: np.ndarray | None  # (T,) int32; None: all in slot 0

    def as_arguments(self) -> dict:
        return self.__dict__.copy()


def read_object(ob, uv_maps: tuple[str, ...], messages: Messages) -> MeshArrays | None:
    """`ob` is evaluated; `uv_maps` names the UV map that each material slot wants ("" is the render map).

    None if the object has no triangle."""
    # In edit mode the mesh itself is empty: what is being edited lies beside it until to_mesh writes it out.
    if ob.type == "MESH" and not ob.data.is_editmode:
        return read_mesh(ob.data, uv_maps, ob.name, messages)
    mesh = ob.to_mesh()
    if mesh is None:
        return None
    try:
        return read_mesh(mesh, uv_maps, ob.name, messages)
    finally:
        ob.to_mesh_clear()


def read_mesh(mesh, uv_maps: tuple[str, ...], owner: str, messages: Messages) -> MeshArrays | None:
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    if count == 0:
        return None
    corners = _get(mesh.loop_triangles, "loops", (count, 3), np.int32)
    if HAS_ATTRIBUTES:
        positions = _get(mesh.attributes["position"].data, "vector", (len(mesh.vertices), 3), np.float32)
        triangles = _get(mesh.attributes[".corner_vert"].data, "value", (len(mesh.loops),), np.int32)[corners]
    else:
        positions = _get(mesh.vertices, "co", (len(mesh.vertices), 3), np.float32)
        triangles = _get(mesh.loop_triangles, "vertices", (count, 3), np.int32)
    slots = None
    if len(uv_maps) > 1:
        slots = _get(mesh.loop_triangles, "material_index", (count,), np.int32)
        slots = slots if slots.any() else None
    normals = _corner_normals(mesh)
    uvs = _corner_uvs(mesh, corners, slots, uv_maps, owner, messages)
    if normals is None and uvs is None:
        corners = None
    return MeshArrays(positions, triangles, corners, normals, uvs, slots)


def _get(collection, attribute: str, shape: tuple, dtype) -> np.ndarray:
    array = np.empty(shape, dtype)
    collection.foreach_get(attribute, array.reshape(-1))
    return array


def _corner_normals(mesh) -> np.ndarray | None:
    corner_count = len(mesh.loops)
    if HAS_ATTRIBUTES:
        if mesh.normals_domain == "FACE":
            return None
        return _get(mesh.corner_normals, "vector", (corner_count, 3), np.float32)
    smooth = np.empty(len(mesh.polygons), bool)
    mesh.polygons.foreach_get("use_smooth", smooth)
    if not smooth.any() and not mesh.has_custom_normals:
        return None
    mesh.calc_normals_split()
    normals = _get(mesh.loops, "normal", (corner_count, 3), np.float32)
    mesh.free_normals_split()
    return normals


def _corner_uvs(mesh, corners, slots, uv_maps, owner: str, messages: Messages) -> np.ndarray | None:
    layers = mesh.uv_layers
    if not layers:
        return None
    active = next((layer for layer in layers if layer.active_render), layers[0])
    wanted = []
    for name in uv_maps or ("",):
        layer = layers.get(name) if name else active
        if layer is None:
            messages.warn(f'Object "{owner}": it has no UV map "{name}"; "{active.name}" is used instead')
            layer = active
        wanted.append(layer)
    uvs = _layer_uvs(wanted[0], len(mesh.loops))
    if slots is None:
        return uvs
    for slot, layer in enumerate(wanted[1:], 1):
        if layer.name != wanted[0].name:
            # A corner belongs to one face and with it to one slot.
            used = corners[slots == slot]
            uvs[used] = _layer_uvs(layer, len(mesh.loops))[used]
    return uvs


def _layer_uvs(layer, count: int) -> np.ndarray:
    if HAS_ATTRIBUTES:
        return _get(layer.uv, "vector", (count, 2), np.float32)
    return _get(layer.data, "uv", (count, 2), np.float32)
