# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs in build/venv-mitsuba: renders with Mitsuba what export.py wrote, by orders as in blender_worker.py.

`{"order": "scene", "export", "map", "bounces", "size"}` loads a scene; `{"order": "render", "sampler",
"samples", "seed", "npy"}` renders it. The first answer tells the variant: llvm_ad_rgb where there is LLVM,
else scalar_rgb, which is several times slower.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from pathlib import Path

import mitsuba as mi
import numpy as np

SAMPLERS = ("independent", "multijitter")


def choose_variant() -> str:
    for variant in ("llvm_ad_rgb", "scalar_rgb"):
        if variant in mi.variants():
            try:
                mi.set_variant(variant)
                return variant
            except ImportError as error:
                print(f"{variant}: {error}", flush=True)
    raise RuntimeError(f"this Mitsuba has neither llvm_ad_rgb nor scalar_rgb, but {mi.variants()}")


def environment(pixels: np.ndarray) -> np.ndarray:
    """(H,W,3) -> (2H + 1, W, 3) which Mitsuba interpolates to what Blender shows of pixels.

    Mitsuba's envmap has texel row k at the polar angle k pi / (rows - 1), Blender's at (k + 1/2) pi / H.
    With twice the rows, Blender's fall on every other one, and the rest is half-way between them, which
    linear interpolation does not change.
    """
    rows = np.empty((2 * pixels.shape[0] + 1, *pixels.shape[1:]), np.float32)
    rows[1::2] = pixels
    rows[2:-1:2] = (pixels[:-1] + pixels[1:]) / 2
    rows[0], rows[-1] = pixels[0], pixels[-1]
    return rows


def color(value: list[float] | str, arrays: dict) -> dict:
    if isinstance(value, str):
        pixels = mi.Bitmap(np.ascontiguousarray(arrays[value]))
        return {"type": "bitmap", "bitmap": pixels, "raw": True, "filter_type": "bilinear"}
    return {"type": "rgb", "value": value}


def shader(described: dict, arrays: dict) -> dict:
    kind = described["type"]
    if kind == "diffuse":
        return {"type": "diffuse", "reflectance": color(described["color"], arrays)}
    if kind == "glossy":
        alpha_u, alpha_v = described["alpha"]
        return {
            **{"type": "roughconductor", "material": "none", "distribution": "ggx"},
            **{
                "alpha_u": alpha_u,
                "alpha_v": alpha_v,
                "specular_reflectance": color(described["color"], arrays),
            },
        }
    first, second = (shader(inner, arrays) for inner in described["shaders"])
    return {"type": "blendbsdf", "weight": described["share"], "first": first, "second": second}


def mesh(arrays: dict, number: int, described: dict) -> mi.Mesh:
    positions = arrays[f"{number}_positions"]
    uv = arrays.get(f"{number}_uv")
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "twosided", "inner": shader(described["material"], arrays)})
    made = mi.Mesh(
        described["name"],
        len(positions),
        len(positions) // 3,
        has_vertex_normals=True,
        has_vertex_texcoords=uv is not None,
        props=properties,
    )
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = positions.reshape(-1)
    parameters["vertex_normals"] = arrays[f"{number}_normals"].reshape(-1)
    parameters["faces"] = np.arange(len(positions), dtype=np.uint32)
    if uv is not None:
        parameters["vertex_texcoords"] = (uv * [1, -1] + [0, 1]).astype(np.float32).reshape(-1)
    parameters.update()
    return made


def sensor(camera: dict, size: list[int], sampler: str) -> dict:
    matrix = np.array(camera["matrix"]) @ np.diag([-1.0, 1.0, -1.0, 1.0])  # +Z forward, +X to the left
    return {
        "type": "perspective",
        "fov": camera["x_degrees"],
        "fov_axis": "x",
        "near_clip": 0.01,
        "far_clip": 1000.0,
        "to_world": mi.ScalarTransform4f(matrix),
        "sampler": {"type": sampler},
        "film": {
            **{"type": "hdrfilm", "width": size[0], "height": size[1], "pixel_format": "rgb"},
            **{"component_format": "float32", "rfilter": {"type": "box"}},
        },
    }


def load(order: dict) -> mi.Scene:
    with np.load(order["export"]) as stored:
        arrays = dict(stored)
    described = json.loads(str(arrays["scene"]))
    # Blender's -X is the middle of the map and +Z its top; Mitsuba's local frame has +Y up.
    axes = np.array([(0, 0, 1, 0), (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 1)], float)
    content = {
        "type": "scene",
        # Depth counts emitters: 1 is the map itself, 2 its light on the first surface.
        "integrator": {"type": "path", "max_depth": order["bounces"] + 2},
        "environment": {
            "type": "envmap",
            "bitmap": mi.Bitmap(environment(np.load(order["map"]))),
            "to_world": mi.ScalarTransform4f(axes),
        },
    }
    for sampler in SAMPLERS:
        content[sampler] = sensor(described["camera"], order["size"], sampler)
    for number, item in enumerate(described["meshes"]):
        content[f"mesh{number}"] = mesh(arrays, number, item)
    return mi.load_dict(content)


def render(scene: mi.Scene, order: dict) -> dict:
    started = time.process_time()
    number = SAMPLERS.index(order["sampler"])
    image = np.array(mi.render(scene, sensor=number, spp=order["samples"], seed=order["seed"]))
    spent = time.process_time() - started
    np.save(order["npy"], image.astype(np.float32))
    return {"cpu_seconds": spent}


def main() -> int:
    job_file, descriptor = sys.argv[-2:]
    orders = os.fdopen(json.loads(Path(job_file).read_text())["orders"])
    answers = os.fdopen(int(descriptor), "w", buffering=1)

    def tell(event: str, **details) -> None:
        answers.write(json.dumps({"event": event, **details}) + "\n")

    try:
        tell("ready", version=mi.__version__, variant=choose_variant())
        scene = None
        for line in orders:
            order = json.loads(line)
            if order["order"] == "scene":
                scene = load(order)
                tell("done")
            else:
                tell("done", **render(scene, order))
    except Exception as error:
        traceback.print_exc()
        tell("failed", message=f"{type(error).__name__}: {error}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
