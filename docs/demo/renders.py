# SPDX-License-Identifier: GPL-3.0-or-later
"""Starts Blender once for all images of the demo, follows its progress and keeps the reference for the next
run."""

from __future__ import annotations

import hashlib
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from blender_process import run_in_blender
from rich.progress import Progress

HERE = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Quality:
    """Size of the images and samples per pixel."""

    width: int = 640
    height: int = 360
    samples: int = 16
    reference_samples: int = 256  # of each of the two halves
    max_bounces: int = 3


QUICK = Quality(width=320, height=180, reference_samples=64)


@dataclass(frozen=True)
class Order:
    """What to render: methods are settings of scene.skytree by name, rotation is in radians about +Z."""

    blender_python: Path
    addon: Path
    hdri: Path
    rotation: float
    quality: Quality
    seed: int
    methods: dict[str, dict]

    def reference_key(self) -> str:
        """A hash of everything that the reference depends on: size, seed, scene, map and add-on."""
        digest = hashlib.sha256(repr((self.quality, self.rotation, self.seed)).encode())
        for file in (*(HERE / name for name in ("scene.py", "shapes.py", "teapot.py")), self.hdri):
            digest.update(file.read_bytes())
        with zipfile.ZipFile(self.addon) as archive:
            for entry in sorted(archive.infolist(), key=lambda e: e.filename):
                digest.update(f"{entry.filename} {entry.CRC}".encode())
        return digest.hexdigest()[:16]


@dataclass
class Rendered:
    """Files of the images, of the reference's halves, and what Blender told."""

    images: dict[str, Path]
    reference: list[Path]
    times: dict[str, dict]
    versions: dict[str, str]


def render_all(order: Order, out: Path, cache: Path, progress: Progress) -> Rendered:
    """Renders every method to out/NAME.exr, and the reference's halves to cache unless they are there.

    Raises BlenderError when Blender fails.
    """
    reference = [cache / f"reference-{order.reference_key()}-{half}.exr" for half in "ab"]
    images = {name: out / f"{name}.exr" for name in order.methods}
    jobs = [
        {"name": name, "samples": order.quality.samples, "seed": order.seed, "settings": settings}
        | {"exr": str(images[name].resolve())}
        for name, settings in order.methods.items()
    ]
    missing = {f"reference {file.stem[-1]}": file for file in reference if not file.exists()}
    for name, file in missing.items():
        # A sampler that is not under test, and seeds of its own: the reference shares no noise with an image.
        seed = order.seed + 1001 + reference.index(file)
        jobs += [
            {"name": name, "samples": order.quality.reference_samples, "seed": seed}
            | {"settings": {"sampler": "ALIAS"}, "exr": str(_partial(file).resolve())}
        ]
    for job in jobs:
        Path(job["exr"]).unlink(missing_ok=True)
    rendered = Rendered(images, reference, {}, {})
    for name in _rendered_names(order, jobs, cache, rendered, progress):
        if name in missing:
            _partial(missing[name]).rename(missing[name])
    return rendered


def _partial(file: Path) -> Path:
    """Where Blender writes first, so that an interrupted run leaves no broken reference."""
    return file.with_suffix(".part.exr")


def _rendered_names(
    order: Order, jobs: list[dict], cache: Path, rendered: Rendered, progress: Progress
) -> Iterator[str]:
    """Renders the jobs, moves a bar for each, fills in times and versions; yields what is done."""
    quality = order.quality
    description = {
        "zip": str(order.addon.resolve()),
        "hdri": str(order.hdri),
        "rotation": order.rotation,
        "width": quality.width,
        "height": quality.height,
        "max_bounces": quality.max_bounces,
        "renders": jobs,
    }
    names = ["install", *(job["name"] for job in jobs)]
    totals = dict(zip(names, [1, *(job["samples"] for job in jobs)], strict=True))
    titles = {name: f"Render {name}" for name in names} | {"install": "Install the add-on in Blender"}
    bars = {name: progress.add_task(titles[name], total=totals[name], start=False) for name in names}
    progress.start_task(bars["install"])
    blender = [str(order.blender_python)]
    for told in run_in_blender(blender, HERE / "blender_part.py", description, cache / "blender.log"):
        event, name = told.pop("event"), told.pop("name", "install")
        if event == "progress":
            progress.update(bars[name], completed=totals[name] * told["done"] / max(told["total"], 1))
            continue
        progress.update(bars[name], completed=totals[name])
        progress.stop_task(bars[name])
        names.remove(name)
        if names:
            progress.start_task(bars[names[0]])
        if event == "installed":
            rendered.versions.update(told)
        else:
            rendered.times[name] = told
            yield name
