# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts what the window tests saw into the documentation: docs/screenshots.md and docs/images/window/.

Usage, after a run of test_window.py:  python publish.py [FOLDER OF SCREENSHOTS]
Screenshots that the run did not make keep their last picture.
"""

import sys
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "images" / "window"
STATES = {
    "viewport": (
        "The live viewport",
        {
            "rendered": "Rendered shading, refined to its 16 samples",
            "orbit_after": "After orbit, pan and zoom by mouse",
            "camera_border": "Camera view, zoomed and moved, with a render border",
            "orthographic": "An orthographic view from the front",
            "quad_view": "Quad view: four renderers",
            "two_views": "Two 3D views",
            "full_screen": "The same view enlarged",
            "film_transparent": "Film transparent",
            "local_view": "Local view of one object",
            "edit_mode": "Edit mode",
            "changed": "After a change of every setting",
            "failure": "A render thread that ran out of memory: the last picture and a message",
            "floating_lower_right": "The floating preview in a Solid view",
            "floating_large": "The floating preview, enlarged",
        },
    ),
    "compare": (
        "Comparing",
        {
            "split": "Split",
            "dragged": "The line dragged to the left",
            "side_by_side": "Side by Side",
            "flip_b": "Flip, after the key J",
            "difference": "Difference",
            "equal_time": "Equal Time",
            "capturing": "Capturing a reference",
            "reference": "Figures and convergence once there is a reference",
            "stale_reference": "A reference that has become stale",
            "difference_to_reference": "Difference to the captured reference",
            "quad_view": "Four comparisons in quad view",
            "camera_border": "Camera view with a border",
            "film_transparent": "Film transparent",
            "orthographic": "Orthographic, from above",
            "report_running": "A report in the background: progress and cancel in the sidebar",
            "report_done": "The report is done",
        },
    ),
    "pictures": (
        "Pictures of the sampler",
        {
            "overlay_blocks": "Blocks over the view, coloured by probability",
            "overlay_samples": "Directions that the sampler chooses, as dots",
            "sphere_on": "Blocks and samples on a sphere about the origin",
            "panel_blocks": "World properties: the map with its blocks, and rebuilt from them",
            "panel_pdf": "World properties: the empirical and the fitted probabilities",
            "panel_exposure": "World properties: the map in false colours, in stops",
        },
    ),
}


def main():
    screenshots = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "screenshots"
    IMAGES.mkdir(parents=True, exist_ok=True)
    lines = [
        "# What the window tests see",
        "",
        "Screenshots of Debian's Blender 3.4 on a virtual screen of 800 x 520 pixels, made by",
        "`./build_addon.py test window` while it drives the real window; `blender_tests/window/publish.py`",
        "put them here.",
    ]
    for file, (title, states) in STATES.items():
        lines += ["", f"## {title}"]
        for name, caption in states.items():
            source, target = screenshots / file / f"{name}.png", IMAGES / f"{file}_{name}.jpg"
            if source.exists():
                Image.open(source).convert("RGB").save(target, quality=60, optimize=True)
            if target.exists():
                lines += ["", f"{caption}:", "", f"![{caption}](images/window/{target.name})"]
    (ROOT / "docs" / "screenshots.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
