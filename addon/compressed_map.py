# SPDX-License-Identifier: GPL-3.0-or-later
"""Compressed maps (.skymap files of skytree_core) as Blender images.

Blender does not know the format: for it such an image has no pixels, but it has a path and can be packed, so
that a .blend file carries the few kilobytes that light it.
"""

from __future__ import annotations

import numpy as np

from . import native

SUFFIX = ".skymap"


def is_compressed(image) -> bool:
    """Told by the name of the file; asking for the size would make Blender complain about the format."""
    return image.source == "FILE" and image.filepath.lower().endswith(SUFFIX)


def decode(image, path: str) -> np.ndarray:
    """(height, width, 3) float32, row 0 at the top, from the packed bytes or the file at `path`.

    Raises ValueError, naming what is wrong, where it cannot be read."""
    compressed = native.core().CompressedMap
    try:
        if image.packed_file:
            return compressed.from_bytes(bytes(image.packed_file.data)).image()
        return compressed.load(path).image()
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror or error}") from error
