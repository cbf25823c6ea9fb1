# SPDX-License-Identifier: GPL-3.0-or-later
"""Which environment maps the figures are made from: the probes of $SKYTREE_SHARED/hdri where there are some,
and those that come with Blender."""

from __future__ import annotations

import functools
import hashlib
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import skytree_core

BLENDERS = "Greg Zaal and Poly Haven, CC0; comes with Blender"
CREDITS = {
    "debevec": "Paul Debevec, debevec.org",
    "ilm": "Industrial Light & Magic, OpenEXR's sample images",
    "ph": "Poly Haven, CC0",
}
# The paper's maps, and which of Blender's stands in for each where it is not there.
STAND_INS = {"uffizi": "courtyard", "doge2": "city"}


class MapError(Exception):
    """There is no map to work with; the message says what to do."""


@dataclass(frozen=True)
class Map:
    name: str
    file: Path
    credit: str

    def image(self) -> np.ndarray:
        """(H,W,3) float32, bad texels black."""
        return _read(self.file)

    def digest(self) -> str:
        return hashlib.sha256(self.file.read_bytes()).hexdigest()


@functools.lru_cache(maxsize=3)
def _read(file: Path) -> np.ndarray:
    image = np.clip(np.nan_to_num(skytree_core.read_image(file), nan=0, posinf=0, neginf=0), 0, None)
    image.setflags(write=False)
    return image


class Maps:
    """All maps, probes first, by name; `named` finds the paper's or what stands in for it."""

    def __init__(self, blender_python: Path | None):
        found = [*_probes(), *_of_blender(blender_python)]
        self.all = list({entry.name: entry for entry in reversed(found)}.values())[::-1]
        if not self.all:
            raise MapError(
                "no environment maps: neither in $SKYTREE_SHARED/hdri nor in build/bpy-4.5; "
                "run ./build_addon.py figures, which installs Blender's"
            )
        self._by_name = {entry.name: entry for entry in self.all}

    @property
    def has_the_papers(self) -> bool:
        return set(STAND_INS) <= set(self._by_name)

    def named(self, name: str) -> Map:
        for candidate in (name, STAND_INS.get(name)):
            if candidate in self._by_name:
                return self._by_name[candidate]
        return self.all[0]

    def some(self, *names: str) -> list[Map]:
        """The named ones, each once; stand-ins where one is not there."""
        return list(dict.fromkeys(self.named(name) for name in names))


def _probes() -> list[Map]:
    shared = os.environ.get("SKYTREE_SHARED")
    folder = Path(shared) / "hdri" if shared else None
    files = sorted(folder.iterdir()) if folder and folder.is_dir() else []
    return [
        Map(_short(file.stem), file, CREDITS.get(file.stem.split("_")[0], "see its file name"))
        for file in files
        if file.suffix in (".hdr", ".exr")
    ]


def _short(stem: str) -> str:
    """debevec_uffizi_1200x600 -> uffizi."""
    middle = re.sub(r"^(debevec|ilm|ph)_", "", stem)
    return re.sub(r"(_(\d+(k|x\d+)?|mip|fromcube|fromangular))+$", "", middle)


def _of_blender(python: Path | None) -> list[Map]:
    if python is None:
        return []
    pattern = "lib/python3*/site-packages/bpy/*/datafiles/studiolights/world/*.exr"
    return [Map(file.stem, file, BLENDERS) for file in sorted(python.parent.parent.glob(pattern))]
