# SPDX-License-Identifier: GPL-3.0-or-later
"""Materials and their textures in the native scene, by the material's identity."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from ..brdf_tables import BrdfSpec
from ..images import ImageStore, identity_of
from ..messages import Messages
from ..nodes.materials import DEFAULT_COLOR, MaterialClosures, default_material, read_material
from ..nodes.textures import TextureSpec


@dataclass
class _Entry:
    native: int
    read: MaterialClosures
    used: set[TextureSpec | BrdfSpec] = field(default_factory=set)


class MaterialSync:
    """Uploads a material when it is first asked for, and again after `invalidate` if it really changed."""

    def __init__(self, scene, store: ImageStore, messages: Messages, counts: Counter):
        self._scene, self._store, self._messages, self._counts = scene, store, messages, counts
        self._entries: dict[int, _Entry] = {}
        self._textures: dict[TextureSpec, int] = {}
        self._brdfs: dict[BrdfSpec, int] = {}
        self._stale: set[int] = set()

    def invalidate(self, identities: set[int] | None = None):
        """None: all materials are read again."""
        self._stale |= set(self._entries) if identities is None else identities & set(self._entries)

    def refresh(self, materials: dict[int, object]):
        """Reads stale materials again; `materials` are the evaluated ones of this depsgraph by identity."""
        for identity in sorted(self._stale):
            if identity in materials:
                self.entry(materials[identity])
        self._stale.clear()

    def entry(self, material) -> _Entry:
        identity = 0 if material is None else identity_of(material)
        entry = self._entries.get(identity)
        if entry is not None and identity not in self._stale:
            return entry
        self._stale.discard(identity)
        read = (
            default_material() if material is None else read_material(material, self._store, self._messages)
        )
        name = "default" if material is None else material.name
        if entry is None:
            used: set[TextureSpec | BrdfSpec] = set()
            native = self._scene.add_material(self._upload(read.closures, used, name), name)
            entry = self._entries[identity] = _Entry(native, read, used)
            self._counts["materials"] += 1
        elif entry.read != read:
            used = set()
            self._scene.set_material(entry.native, self._upload(read.closures, used, name))
            entry.read, entry.used = read, used
            self._counts["materials"] += 1
            self._drop_unused()
        return entry

    def native_id(self, material) -> int:
        return self.entry(material).native

    def uv_map(self, material) -> str:
        return self.entry(material).read.uv_map

    def _upload(self, closures: list[dict], used: set[TextureSpec | BrdfSpec], owner: str) -> list[dict]:
        result = []
        for closure in closures:
            uploaded = {}
            if "brdf" in closure:
                brdf = self._brdf(closure["brdf"], used, owner)
                if brdf is None:
                    result.append({"type": "DIFFUSE", "weight": closure["weight"], "color": DEFAULT_COLOR})
                    continue
                closure = {**closure, "brdf": brdf}
            for name, value in closure.items():
                if isinstance(value, TextureSpec):
                    value = self._texture(value, used)
                    if value is None:
                        continue
                uploaded[name] = value
            result.append(uploaded)
        return result

    def _brdf(self, spec: BrdfSpec, used: set[TextureSpec | BrdfSpec], owner: str) -> int | None:
        used.add(spec)
        if spec not in self._brdfs:
            try:
                brdf = spec.build()
            except RuntimeError as error:
                self._messages.warn(f'Material "{owner}": {error}. It is shown as a grey diffuse surface')
                return None
            self._brdfs[spec] = self._scene.add_brdf(brdf)
        return self._brdfs[spec]

    def _texture(self, spec: TextureSpec, used: set[TextureSpec | BrdfSpec]) -> int | None:
        used.add(spec)
        if spec not in self._textures:
            try:
                image = spec.image()
            except ValueError as error:
                self._messages.warn(str(error))
                return None
            self._textures[spec] = self._scene.add_texture(
                image,
                interpolation=spec.interpolation,
                extension=spec.extension,
                uv_transform=spec.uv_transform,
            )
            self._counts["textures"] += 1
        return self._textures[spec]

    def _drop_unused(self):
        used = set().union(*(entry.used for entry in self._entries.values()))
        for spec in [spec for spec in self._textures if spec not in used]:
            self._scene.remove_texture(self._textures.pop(spec))
        for spec in [spec for spec in self._brdfs if spec not in used]:
            self._scene.remove_brdf(self._brdfs.pop(spec))
