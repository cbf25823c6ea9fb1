# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps a native scene equal to a depsgraph, all of it or only what changed. Serves F12 and the viewport
alike."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import wait

import numpy as np

from .. import native
from ..devices import render_threads
from ..environments import BuiltEnvironment, FutureEnvironment, SamplerSettings, environments
from ..images import ImageStore, identity_of
from ..messages import Messages
from ..world import Environment, read_world
from .materials import MaterialSync
from .objects import ObjectSync

_GEOMETRY_DATA = {"Mesh", "Curve", "Curves", "MetaBall", "SurfaceCurve", "TextCurve"}


class SceneSync:
    """A native scene and what it was made from.

    `sync(depsgraph)` uploads everything that is not there yet; `update(depsgraph)` looks at depsgraph.updates
    alone. No upload may come while a session renders the scene: `before_upload()` is called before each, to
    cancel it. `counts` says how often each kind of thing was uploaded; `messages` holds what could not be
    read. `flat` is for scenes that are read once and never updated: rays cost less (docs/rendering.md,
    Embree).
    Unless `wait_for_samplers`, a sampler is built on a thread of its own and the scene keeps the last
    environment until `follow_environment` finds it ready."""

    def __init__(
        self,
        before_upload: Callable[[], None] | None = None,
        wait_for_samplers: bool = True,
        flat: bool = False,
    ):
        self.scene = native.core().Scene(flat=flat)
        self._uploads = _Uploads(self.scene, before_upload) if before_upload else self.scene
        self._wait_for_samplers = wait_for_samplers
        self.messages = Messages()
        self.counts: Counter = Counter()
        self.images = ImageStore()
        self.environment: Environment | None = None
        self.built = None  # environments.BuiltEnvironment of the last sync
        self._applied: tuple | None = None
        self._environment_messages = Messages()
        self._wanted: tuple[Environment, SamplerSettings] | None = None
        self._awaited: tuple[Environment, FutureEnvironment] | None = None
        self._threads = 0  # that build samplers; 0: all cores
        self.materials = MaterialSync(self._uploads, self.images, self.messages, self.counts)
        self.objects = ObjectSync(self._uploads, self.materials, self.messages, self.counts)

    def sync(self, depsgraph, space=None):
        """`space`: of the 3D view that shows it, see ObjectSync.sync."""
        self.messages.clear()
        self.materials.invalidate()
        self.objects.sync(depsgraph, None, space)
        self.sync_environment(depsgraph)
        self._collect_native_warnings()

    def update(self, depsgraph, space=None) -> bool:
        """Applies depsgraph.updates; whether anything in the picture may have changed."""
        changes = _Changes(depsgraph, self.images)
        if changes.materials is None or changes.materials:
            self.materials.invalidate(changes.materials)
        if changes.objects or changes.materials is None or changes.materials:
            self.objects.sync(depsgraph, changes.geometry, space)
            self.materials.refresh(self.objects.seen_materials)
        if changes.environment:
            self.sync_environment(depsgraph)
        self._collect_native_warnings()
        return changes.any

    def show_and_hide(self, depsgraph, space):
        """Brings the objects in line with what a 3D view shows, when that alone has changed."""
        self.objects.sync(depsgraph, set(), space)
        self._collect_native_warnings()

    def sync_environment(self, depsgraph):
        """World and sampler settings; a sampler that exists for the same map and settings is used again."""
        found = Messages()
        environment = read_world(depsgraph.scene_eval.world, self.images, found)
        self._wanted = environment, SamplerSettings.of(depsgraph.scene_eval.skytree)
        self._threads = render_threads(depsgraph.scene_eval.render)
        if self._wanted[1].sampler == "FILTERED":
            found.warn(
                "The sampler is set to Filtered, which is biased: reflections and shadows are blurred, and "
                "more samples do not sharpen them"
            )
        self.messages.replace(self._environment_messages, found)
        self._environment_messages = found
        self.follow_environment()

    def follow_environment(self) -> bool:
        """Takes over the environment that was last asked for, once its sampler is built; whether one is still
        awaited. What was asked for in between is skipped. Raises what building the sampler raised."""
        while self._wanted or self._awaited:
            if self._awaited is None:
                environment, settings = self._wanted
                self._wanted = None
                self._awaited = (
                    environment,
                    environments.request(
                        environment,
                        settings,
                        threads=self._threads,
                        more_to_come=not self._wait_for_samplers,
                    ),
                )
            environment, built = self._awaited
            if not (self._wait_for_samplers or built.done()):
                return True
            self._awaited = None
            self._apply(environment, built.result())
        return False

    @property
    def awaits_sampler(self) -> bool:
        return self._awaited is not None or self._wanted is not None

    def wait_for_sampler(self, seconds: float):
        """Gives the sampler that is awaited at most that long."""
        if self._awaited is not None:
            wait([self._awaited[1]], seconds)

    def wait_since_asked(self, seconds: float):
        """The same, counted from when the sampler was first asked for, whoever did."""
        if self._awaited is not None:
            self.wait_for_sampler(max(self._awaited[1].asked + seconds - time.perf_counter(), 0.0))

    def _apply(self, environment: Environment, built: BuiltEnvironment):
        self.messages.extend(built.messages)
        self._environment_messages.extend(built.messages)
        applied = (
            id(built.sampler),
            environment.world_to_env.tobytes(),
            environment.color,
            environment.visible,
        )
        if applied != self._applied:
            self._uploads.set_environment(
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


class _Uploads:
    """A native scene that says so before it is changed."""

    def __init__(self, scene, before_upload: Callable[[], None]):
        self._scene, self._before_upload = scene, before_upload

    def __getattr__(self, name: str):
        method = getattr(self._scene, name)

        def upload(*arguments, **options):
            self._before_upload()
            return method(*arguments, **options)

        setattr(self, name, upload)
        return upload


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
            # An edited material updates the meshes that use it too, but not their geometry.
            self.objects = True
            if update.is_updated_geometry:
                self.geometry.add(identity_of(update.id))
        elif kind == "Material":
            if self.materials is not None:
                self.materials.add(identity_of(update.id))
        elif kind == "World":
            self.environment = True
        elif kind == "Scene":
            # Also when an object is hidden or shown.
            self.environment = self.objects = True
        elif kind in {"Image", "ShaderNodeTree"}:
            # Neither says who uses it. Both are compared after reading, so what did not change stays.
            if kind == "Image":
                images.invalidate(update.id)
            self.materials = None
            self.environment = True
        elif kind in {"Collection", "ParticleSettings", "GeometryNodeTree", "Texture"}:
            self.objects = True
