# SPDX-License-Identifier: GPL-3.0-or-later
"""What `bench --peers` keeps on disk: maps as every renderer reads them, exported scenes, references."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import OpenImageIO
import skytree_core
from cases import HEIGHT, METHODS, REFERENCES, WIDTH, Case
from worker import Worker


@dataclass
class Renderers:
    """The workers, and the one way to render a case with any of the methods."""

    blender: Worker
    mitsuba: Worker | None
    cache: Path
    scratch: Path  # of this run alone
    wheel: str  # digest of Skytree's zip
    overrides: dict = field(default_factory=dict)  # of scene.skytree, over the preset of best mode
    content: str = ""  # digest of the scene and the map that are open

    @property
    def versions(self) -> dict[str, str]:
        return {
            "SKYTREE": "skytree",
            "CYCLES": f"cycles-{self.blender.ready['version'].split()[0]}",
            "MITSUBA": f"mitsuba-{self.mitsuba.ready['version']}-{self.mitsuba.ready['variant']}",
        }

    def open(self, case: Case, map_file: Path) -> None:
        """Both renderers load the case."""
        exr, npy = map_as_read(map_file, self.cache)
        folder = self.cache / "scenes"
        folder.mkdir(parents=True, exist_ok=True)
        exported = folder / f"{case.scene}.npz"
        size = [WIDTH, HEIGHT]
        shared = {"order": "scene", "bounces": case.bounces, "size": size, "export": str(exported)}
        self.blender.order(**shared, scene=case.scene, map=str(exr), folder=str(folder))
        if self.mitsuba:
            self.mitsuba.order(**shared, map=str(npy))
        with np.load(exported) as stored:
            digest = hashlib.sha256(npy.name.encode() + str(stored["scene"]).encode())
            for name in sorted(set(stored.files) - {"scene"}):
                digest.update(name.encode() + stored[name].tobytes())
        self.content = digest.hexdigest()[:8]

    def render(
        self, case: Case, method: str, samples: int, seed: int, settings: dict | None = None
    ) -> tuple[np.ndarray, float]:
        """-> image (H,W,3), processor seconds of the renderer. settings: over the preset's."""
        chosen = METHODS[method]
        order = {"order": "render", "samples": samples, "seed": seed}
        if chosen.engine == "MITSUBA":
            file = self.scratch / "image.npy"
            told = self.mitsuba.order(**order, sampler=chosen.sampler, npy=str(file))
            return np.load(file), told["cpu_seconds"]
        file = self.scratch / "image.exr"
        how = {"engine": chosen.engine, "preset": chosen.preset, "bounces": case.bounces, "exr": str(file)}
        overrides = self.overrides if chosen.preset == "BEST" else {}
        how["settings"] = overrides | chosen.settings | (settings or {})
        told = self.blender.order(**order, **how)
        return skytree_core.read_image(str(file)), told["cpu_seconds"]


def map_as_read(map_file: Path, cache: Path) -> tuple[Path, Path]:
    """The map as an EXR without chromaticities, which would make some readers convert it, and as .npy."""
    digest = hashlib.sha256(map_file.read_bytes()).hexdigest()[:8]
    exr, npy = (cache / "maps" / f"{map_file.stem}-{digest}{ending}" for ending in (".exr", ".npy"))
    if not (exr.exists() and npy.exists()):
        exr.parent.mkdir(parents=True, exist_ok=True)
        pixels = np.ascontiguousarray(skytree_core.read_image(str(map_file)), np.float32)
        spec = OpenImageIO.ImageSpec(pixels.shape[1], pixels.shape[0], 3, OpenImageIO.FLOAT)
        buffer = OpenImageIO.ImageBuf(spec)
        buffer.set_pixels(OpenImageIO.ROI(), pixels)
        if not buffer.write(str(exr)):
            raise OSError(f"cannot write {exr}: {buffer.geterror()}")
        np.save(npy, pixels)
    return exr, npy


def reference_files(renderers: Renderers, case: Case, engine: str) -> list[Path]:
    """The two halves of the open case's reference; a name tells all that its pixels depend on."""
    folder = renderers.cache / "references" / renderers.versions[engine]
    folder.mkdir(parents=True, exist_ok=True)
    _, samples, parts = REFERENCES[engine]
    name = f"{case.key}-{renderers.content}-{WIDTH}x{HEIGHT}-{samples}x{parts}"
    return [folder / f"{name}-{half}.npy" for half in "ab"]


def make_reference(renderers: Renderers, case: Case, engine: str, fresh: bool = False) -> bool:
    """Renders the halves that are missing, or with `fresh` both; the renderers have the case open. -> any?"""
    method, samples, parts = REFERENCES[engine]
    made = False
    for half, file in enumerate(reference_files(renderers, case, engine)):
        if fresh or not file.exists():
            seeds = range(1001 + half * parts, 1001 + (half + 1) * parts)
            images = [renderers.render(case, method, samples, seed)[0] for seed in seeds]
            unfinished = file.with_suffix(".part.npy")  # an interruption leaves no half-written file
            np.save(unfinished, np.mean(images, axis=0, dtype=np.float64).astype(np.float32))
            unfinished.replace(file)
            file.with_suffix(".wheel").write_text(renderers.wheel)
            made = True
    return made


def rendered_by(file: Path) -> str:
    """The wheel that was there when a half was rendered."""
    note = file.with_suffix(".wheel")
    return note.read_text() if note.exists() else ""
