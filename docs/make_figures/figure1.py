# SPDX-License-Identifier: GPL-3.0-or-later
"""Figure 1: a map rebuilt from the blocks of a kd-tree, by the paper's three measures of variation and by
ours, at the paper's 48 KB and its ratio of 1:170 (Ergun, Kurt and Ozturk, SCCG 2012)."""

from __future__ import annotations

import numpy as np
import pictures
import plots
import skytree_core
import stage
from context import Context
from PIL import Image, ImageDraw

TITLE = "Figure 1: the map rebuilt from blocks"
CRITERIA = {"RANGE": "range", "VARIANCE": "variance", "SSE": "SSE", "MIN_VARIANCE": "least variance (ours)"}
PAPERS_BYTES, PAPERS_RATIO = 48 * 1024, 170
# Each texel in the four bytes of RGBE, as the paper counts (8 MB for 2048 x 1024).
BYTES_OF_A_TEXEL = 4
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def make(context: Context) -> None:
    entry = context.maps.named("uffizi")
    image = entry.image()
    full = BYTES_OF_A_TEXEL * image.shape[0] * image.shape[1]
    budgets = {"48 KB": PAPERS_BYTES, "1:170": full // PAPERS_RATIO}
    context.expect(len(CRITERIA) * len(budgets) + 1)
    rows, maps = [], {}
    for budget, most in budgets.items():
        for criterion in CRITERIA:
            compressed = skytree_core.CompressedMap(image, most, criterion)
            maps[budget, criterion] = compressed
            errors = errors_of(image, compressed.image())
            rows.append(
                {
                    "map": entry.name,
                    "budget": budget,
                    "criterion": criterion,
                    "bytes": compressed.nbytes,
                    "ratio": full / compressed.nbytes,
                    "blocks": compressed.block_count,
                    "bits_per_block": 8 * compressed.nbytes / compressed.block_count,
                    **errors,
                }
            )
            context.step()
    context.table("figure1", rows)
    context.picture("figure1", sheet(entry.name, image, maps, rows, budgets))
    context.picture("figure1_blocks", blocks_sheet(entry.name, image, maps, rows))
    context.picture("figure1_light", lit_by_it(context, image, maps["48 KB", "SSE"]))
    context.step()


def errors_of(image: np.ndarray, rebuilt: np.ndarray) -> dict[str, float]:
    """PSNR of what one sees (exposed, sRGB curve, 8 bits), errors of luminance in stops, and of linear
    radiance; all but PSNR weighted by solid angle."""
    exposure = pictures.exposure_for(image)
    seen, seen_rebuilt = (np.asarray(pictures.view(a, exposure), float) for a in (image, rebuilt))
    mse = ((seen - seen_rebuilt) ** 2).mean()
    weights = np.sin((np.arange(len(image)) + 0.5) * np.pi / len(image))[:, None] * np.ones(image.shape[1])
    weights /= weights.sum()
    true, found = (np.maximum(a @ LUMINANCE, 0).astype(np.float64) for a in (image, rebuilt))
    floor = 1e-3 * (weights * true).sum()  # stops of black texels would be infinite
    stops = np.log2((found + floor) / (true + floor))
    mean = (weights * true).sum()
    return {
        "psnr_db": float(10 * np.log10(255**2 / mse)),
        "rms_stops": float(np.sqrt((weights * stops**2).sum())),
        "mean_abs_stops": float((weights * np.abs(stops)).sum()),
        "nrmse_radiance": float(np.sqrt((weights * (found - true) ** 2).sum()) / mean),
        "power_ratio": float((weights * found).sum() / mean),
    }


def sheet(name: str, image: np.ndarray, maps: dict, rows: list[dict], budgets: dict) -> Image.Image:
    """The map, then for each budget what the blocks of each criterion make of it."""
    size = (480, round(480 * image.shape[0] / image.shape[1]))
    exposure = pictures.exposure_for(image)

    def tile(radiance: np.ndarray) -> Image.Image:
        return pictures.view(radiance, exposure).resize(size, Image.Resampling.BOX)

    full = BYTES_OF_A_TEXEL * image.shape[0] * image.shape[1]
    grid = []
    for budget in budgets:
        line = [(tile(image), f"The map\n{image.shape[1]} × {image.shape[0]}, {full / 1e6:.2f} MB")]
        for row in (row for row in rows if row["budget"] == budget):
            text = (
                f"By {CRITERIA[row['criterion']]}, {budget}\n{row['bytes']} bytes, {row['blocks']} blocks\n"
                f"PSNR {row['psnr_db']:.1f} dB, {row['rms_stops']:.2f} stops rms"
            )
            line.append((tile(maps[budget, row["criterion"]].image()), text))
        grid.append(line)
    return plots.labelled_grid(grid, f"{name}, rebuilt from the blocks of a kd-tree")


def blocks_sheet(name: str, image: np.ndarray, maps: dict, rows: list[dict]) -> Image.Image:
    """The borders of the blocks at 1:170 over the left half of the map: this is where the criteria differ."""
    half, scale = image[:, : image.shape[1] // 2], 820 / (image.shape[1] // 2)
    size = (820, round(half.shape[0] * scale))
    base = pictures.view(half, pictures.exposure_for(image)).convert("L").convert("RGB")
    base = Image.blend(base.resize(size, Image.Resampling.LANCZOS), Image.new("RGB", size, "white"), 0.45)
    grid: list[list] = [[], []]
    for index, row in enumerate(row for row in rows if row["budget"] == "1:170"):
        tile = base.copy()
        draw = ImageDraw.Draw(tile)
        for x0, y0, x1, y1 in maps["1:170", row["criterion"]].bounds * scale:
            draw.rectangle((x0, y0, x1, y1), outline=(200, 30, 60))
        grid[index // 2].append((tile, f"By {CRITERIA[row['criterion']]}: {row['blocks']} blocks in the map"))
    return plots.labelled_grid(grid, f"The blocks of {name} at 1:170, left half of the map")


def lit_by_it(context: Context, image: np.ndarray, compressed) -> Image.Image:
    """The teapot lit by the map and lit by the 48 KB alone, read back from a file."""
    file = context.out / "uffizi.part.skymap"
    compressed.save(file)
    alone = skytree_core.read_image(file)
    file.unlink()
    width, height, samples = (200, 120, 8) if context.quick else (400, 240, 64)
    renders = []
    for light in (image, alone):
        scene = stage.teapot_stage(light, width, height, turned_as=image)
        renders.append(scene.render(stage.build("kdtree", light), samples).image)
    exposure = pictures.exposure_for(renders[0])
    error = float(np.abs(renders[1] - renders[0]).mean() / renders[0].mean())
    rows = [
        {
            "samples": samples,
            "bytes": compressed.nbytes,
            "mean_abs_difference": error,
            "mean_ratio": float(renders[1].mean() / renders[0].mean()),
        }
    ]
    context.table("figure1_light", rows)
    factor = pictures.difference_factor(renders[0], renders[1:], exposure)
    grid = [
        [
            (pictures.view(renders[0], exposure), "Lit by the map"),
            (pictures.view(renders[1], exposure), f"Lit by {compressed.nbytes} bytes alone"),
            (
                pictures.difference(renders[1], renders[0], exposure, factor),
                f"Difference × {factor:g}",
            ),
        ]
    ]
    return plots.labelled_grid(grid, f"The chrome-steel teapot, {samples} samples per pixel")
