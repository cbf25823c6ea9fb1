# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps a native scene equal to a depsgraph, all of it or only what changed. Serves F12 and the viewport
alike."""

from __future__ import annotations

from collections import Counter

import numpy as np

from . import native
from .environments import SamplerSettings, environments
from .images import ImageStore, identity_of
from .messages import Messages
from .sync_materials import MaterialSync
from .sync_objects import ObjectSync
from .world import Environment, read_world

_GEOMETRY_DATA = {"Mesh", "Curve", "Curves", "MetaBall", "SurfaceCurve", "TextCurve"}


class SceneSync:
    """A native scene and what it was made from.

    `sync(depsgraph)` uploads everything that is not there yet; `update(depsgraph)` looks at depsgraph.updates
    alone. No call may come while a session renders the scene: cancel it first. `counts` says how often each
    kind of thing was uploaded; `messages` holds what could not be read."""

    def __init__(self):
        self.scene = native.core().Scene()
        self.messages = Messages()
        self.counts: Counter = Counter()
        self.images = ImageStore()
        self.environment: Environment | None = None
        self.built = None  # environments.BuiltEnvironment of the last sync
        self._applied: tuple | None = None
        self.materials = MaterialSync(self.scene, self.images, self.messages, self.counts)
        self.objects = ObjectSync(self.scene, self.materials, self.messages, self.counts)

    def sync(self, depsgraph):
        self.messages.clear()
        self.materials.invalidate()
        self.objects.sync(depsgraph, None)
        self.sync_environment(depsgraph)
        self._collect_native_warnings()

    def update(self, depsgraph) -> bool:
        """Applies depsgraph.updates; whether anything in the picture may have changed."""
        changes = _Changes(depsgraph, self.images)
        if changes.materials is None or changes.materials:
            self.materials.invalidate(changes.materials)
        if changes.objects or changes.materials is None or changes.materials:
            self.objects.sync(depsgraph, changes.geometry)
            self.materials.refresh(self.objects.seen_materials)
        if changes.environment:
            self.sync_environment(depsgraph)
        self._collect_native_warnings()
        return changes.any

    def sync_environment(self, depsgraph):
        """World and sampler settings; a sampler that exists for the same map and settings is used again."""
        environment = read_world(depsgraph.scene_eval.world, self.images, self.messages)
        settings = SamplerSettings.of(depsgraph.scene_eval.skytree)
        built = environments.get(environment, settings, self.messages)
        applied = (
            id(built.sampler),
            environment.world_to_env.tobytes(),
            environment.color,
            environment.visible,
        )
        if applied != self._applied:
            self.scene.set_environment(
                built.image,
                built.sampler,
                world_to_env=np.asarray(environment.world_to_env, np.float32),
                color=environment.color,
                visible=environment.visible,
            )
            self._applied = applied
            self.counts["environments"] += 1
        self.environment, self.built = environment, built

    def set_camera(self, camera_to_world, projection):
        self.scene.set_camera(np.array(camera_to_world, np.float32), np.array(projection, np.float32))

    def _collect_native_warnings(self):
        for text in self.scene.warnings:
            self.messages.warn(text)


class _Changes:
    """What depsgraph.updates touch. `materials` is a set of identities, or None for all of them."""

    def __init__(self, depsgraph, images: ImageStore):
        self.objects = depsgraph.id_type_updated("COLLECTION")
        self.environment = False
        self.materials: set[int] | None = set()
        self.geometry: set[int] = set()
        self.any = False
        for update in depsgraph.updates:
            self.any = True
            self._add(update, images)

    def _add(self, update, images: ImageStore):
        kind = type(update.id).__name__
        if kind == "Object":
            self.objects = True
            if update.is_updated_geometry:
                self.geometry.add(identity_of(update.id))
        elif kind in _GEOMETRY_DATA:
            self.objects = True
            self.geometry.add(identity_of(update.id))
        elif kind == "Material":
            if self.materials is not None:
                self.materials.add(identity_of(update.id))
        elif kind in {"World", "Scene"}:
            self.environment = True
        elif kind in {"Image", "ShaderNodeTree"}:
            # Neither says who uses it. Both are compared after reading, so what did not change stays.
            if kind == "Image":
                images.invalidate(update.id)
            self.materials = None
            self.environment = True
        elif kind in {"Collection", "ParticleSettings", "GeometryNodeTree", "Texture"}:
            self.objects = True
