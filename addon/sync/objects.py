# SPDX-License-Identifier: GPL-3.0-or-later
"""Objects of a depsgraph as meshes and instances of the native scene.

A mesh is uploaded once for all instances that share it and again only when its geometry changed; an instance
that only moved gets a new transform. What a pass over the depsgraph did not meet is removed afterwards.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from ..images import identity_of
from ..messages import Messages
from .materials import MaterialSync
from .mesh import GEOMETRY_TYPES, read_object

_DEFORMING_PARENTS = {"ARMATURE", "LATTICE"}


@dataclass
class _Instance:
    native: int
    mesh: int
    matrix: bytes
    materials: tuple[int, ...]


@dataclass
class _Shape:
    """What all instances of one object have in common, within one pass."""

    mesh: int | None
    materials: tuple[int, ...]


class ObjectSync:
    def __init__(self, scene, materials: MaterialSync, messages: Messages, counts: Counter):
        self._scene, self._materials, self._messages, self._counts = scene, materials, messages, counts
        # Native mesh by geometry and wanted UV maps; None where there are no triangles.
        self._meshes: dict[tuple, int | None] = {}
        self._fresh: set[tuple] = set()
        self._instances: dict[tuple, _Instance] = {}
        self.seen_materials: dict[int, object] = {}

    def sync(self, depsgraph, changed_geometry: set[int] | None, space=None):
        """`changed_geometry`: identities of objects and their data to be read again; None: all. With the
        `space` of a 3D view its local view, local collections and hidden types count too; it is not kept.
        Meshes of what the view hides stay, so that coming back sends none again."""
        if changed_geometry is None:
            self._clear()
            changed_geometry = set()
        shapes: dict[tuple, _Shape | None] = {}
        self._fresh: set[tuple] = set()
        used_instances: set[tuple] = set()
        hidden: set[tuple] = set()
        override = depsgraph.view_layer_eval.material_override
        for item in depsgraph.object_instances:
            ob = item.object
            if ob.type not in GEOMETRY_TYPES:
                self._explain_skipped(ob)
                continue
            if not item.show_self:
                continue
            data_key = _data_key(item, ob)
            shape_key = (identity_of(ob), data_key)
            stale = not changed_geometry.isdisjoint((identity_of(ob), identity_of(ob.original.data)))
            if space is not None and not ob.visible_in_viewport_get(space):
                if not stale:
                    hidden.add(data_key)
                continue
            if shape_key not in shapes:
                shapes[shape_key] = self._shape(ob, data_key, stale, override, depsgraph)
            shape = shapes[shape_key]
            if shape.mesh is None:
                continue
            key = shape_key
            if item.is_instance:  # otherwise persistent_id is left over from another
                key = (*shape_key, identity_of(item.parent), tuple(item.persistent_id))
            used_instances.add(key)
            self._place(key, shape, item.matrix_world, ob)
        kept = {key for key in self._meshes if key[0] in hidden}
        self._remove_unused(self._fresh | kept, used_instances)

    def _explain_skipped(self, ob):
        if ob.type == "LIGHT":
            self._messages.warn(
                f'Light "{ob.name}": lamps are left out; light comes from the world and from '
                "emitting surfaces"
            )
        elif ob.type in {"VOLUME", "POINTCLOUD", "CURVES", "GPENCIL", "GREASEPENCIL"}:
            self._messages.warn(
                f'Object "{ob.name}": objects of type {ob.type.title()} are left out; convert it to a mesh'
            )

    def _shape(self, ob, data_key: tuple, stale: bool, override, depsgraph) -> _Shape:
        slots = [override] if override else _materials_of(ob)
        slots = [material.evaluated_get(depsgraph) if material else None for material in slots] or [None]
        for material in slots:
            if material:
                self.seen_materials[identity_of(material)] = material
        # Slots may want different UV maps, and the same mesh may carry other materials on another object.
        uv_maps = tuple(self._materials.uv_map(material) for material in slots)
        key = (data_key, uv_maps)
        if key not in self._meshes or (stale and key not in self._fresh):
            self._meshes[key] = self._upload(ob, self._meshes.get(key), uv_maps)
        self._fresh.add(key)
        return _Shape(self._meshes[key], tuple(self._materials.native_id(material) for material in slots))

    def _upload(self, ob, old: int | None, uv_maps: tuple[str, ...]) -> int | None:
        arrays = read_object(ob, uv_maps, self._messages)
        if arrays is None:
            self._messages.info(f'Object "{ob.name}" has no faces and is left out')
            if old is not None:
                self._remove_mesh(old)
            return None
        self._counts["meshes"] += 1
        if old is not None:
            self._scene.set_mesh(old, **arrays.as_arguments(), name=ob.name)
            return old
        return self._scene.add_mesh(**arrays.as_arguments(), name=ob.name)

    def _place(self, key: tuple, shape: _Shape, matrix_world, ob):
        matrix = np.array(matrix_world, np.float32)
        if not np.isfinite(matrix).all():
            self._messages.warn(f'Object "{ob.name}": its transform is not finite; it is left out')
            self._remove_instance(key)
            return
        instance = self._instances.get(key)
        if instance is None or instance.mesh != shape.mesh:
            self._remove_instance(key)
            native = self._scene.add_instance(shape.mesh, matrix, list(shape.materials))
            self._instances[key] = _Instance(native, shape.mesh, matrix.tobytes(), shape.materials)
            self._counts["instances"] += 1
            return
        if instance.matrix != matrix.tobytes():
            self._scene.set_transform(instance.native, matrix)
            instance.matrix = matrix.tobytes()
            self._counts["transforms"] += 1
        if instance.materials != shape.materials:
            self._scene.set_instance_materials(instance.native, list(shape.materials))
            instance.materials = shape.materials
            self._counts["instance_materials"] += 1

    def _remove_instance(self, key: tuple):
        instance = self._instances.pop(key, None)
        if instance is not None:
            self._scene.remove_instance(instance.native)

    def _remove_mesh(self, native: int):
        for key in [key for key, instance in self._instances.items() if instance.mesh == native]:
            self._remove_instance(key)
        self._scene.remove_mesh(native)

    def _remove_unused(self, meshes: set[tuple], instances: set[tuple]):
        for key in [key for key in self._instances if key not in instances]:
            self._remove_instance(key)
        for key in [key for key in self._meshes if key not in meshes]:
            native = self._meshes.pop(key)
            if native is not None:
                self._remove_mesh(native)

    def _clear(self):
        self._remove_unused(set(), set())


def _data_key(item, ob) -> tuple:
    """What tells the geometry of an evaluated object from others: objects that do not deform it share a mesh.

    Blender generates meshes for instances, which have no identity but their address. It could be used again
    for another object's data, so the owner's identity goes with it."""
    shares_data = ob.type == "MESH" and not (
        ob.modifiers or ob.data.shape_keys or ob.parent_type in _DEFORMING_PARENTS
    )
    # Not ob.data.original: an evaluated mesh names another copy there, a new one after each edit.
    owner = ob.original.data if shares_data else ob
    is_generated = item.is_instance and ob.modifiers
    return identity_of(owner), ob.data.as_pointer() if is_generated else 0


def _materials_of(ob) -> list:
    data_materials = ob.data.materials if hasattr(ob.data, "materials") else []
    slots = ob.material_slots
    result = []
    for i in range(max(len(slots), len(data_materials))):
        if i < len(slots) and (slots[i].link == "OBJECT" or i >= len(data_materials)):
            result.append(slots[i].material)
        else:
            result.append(data_materials[i])
    return result
