# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading environment maps through OpenImageIO's Python module.

The native library is not linked: Debian's pulls 357 MB of others with it, while the module is at hand
everywhere (inside Blender, on PyPI, in Debian).
"""

from __future__ import annotations

import os

import numpy as np

from ._native import CompressedMap

_INSTALL = "install it with `pip install OpenImageIO` or, on Debian, `apt install python3-openimageio`"


def read_image(path: str | os.PathLike) -> np.ndarray:
    """Radiance of an image file: (H, W, 3) float32, scene-linear RGB, row 0 at the top, C-contiguous.

    Reads what OpenImageIO reads: OpenEXR (scanline, tiled, mip-mapped, half, float, any compression),
    Radiance HDR and more; the largest level of the first part. Channels are found by name: R, G and B in any
    order, or Y or a single channel, which is taken as grey; others, alpha among them, are left out. Files of
    integers are taken as sRGB. A CompressedMap's file gives its blocks, without OpenImageIO. Values are as
    stored: NaN, infinite and negative ones stay (samplers and renders take them for 0).

    Raises FileNotFoundError, IsADirectoryError, PermissionError or another OSError where the file cannot be
    read, ValueError where it is not an image of this kind, ImportError without OpenImageIO; each names the
    file, the cause and what can be done.
    """
    path = os.fspath(path)
    _check_file(path)
    if _is_compressed_map(path):
        return CompressedMap.load(path).image()
    oiio = _openimageio()
    image = oiio.ImageInput.open(path)
    if image is None:
        cause = oiio.geterror().strip() or "unknown error"
        raise ValueError(f"{path}: not an image that OpenImageIO can read ({cause}); save it as EXR or HDR")
    try:
        return _read(image, path)
    finally:
        image.close()


def _is_compressed_map(path: str) -> bool:
    with open(path, "rb") as file:
        return file.read(4) == b"SKYM"


def _openimageio():
    try:
        import OpenImageIO
    except ImportError as error:
        raise ImportError(f"read_image needs the Python module OpenImageIO; {_INSTALL}") from error
    return OpenImageIO


def _check_file(path: str) -> None:
    if not os.path.exists(path):
        raise FileNotFoundError(f"{path}: no such file; check the path")
    if os.path.isdir(path):
        raise IsADirectoryError(f"{path}: is a directory; give the path of an image file in it")
    try:
        with open(path, "rb"):
            pass
    except PermissionError as error:
        raise PermissionError(f"{path}: no permission to read it; change the file's permissions") from error
    if os.path.getsize(path) == 0:
        raise ValueError(f"{path}: the file is empty (0 bytes); it may not have been downloaded completely")


def _read(image, path: str) -> np.ndarray:
    spec = image.spec()
    if spec.deep:
        raise ValueError(f"{path}: holds deep samples, not an image; flatten it")
    if spec.width < 1 or spec.height < 1 or spec.nchannels < 1:
        raise ValueError(f"{path}: has no pixels ({spec.width} x {spec.height}, {spec.nchannels} channels)")
    channels = _rgb_channels(list(spec.channelnames), path)
    begin, end = min(channels), max(channels) + 1
    pixels = image.read_image(0, 0, begin, end, "float")
    if pixels is None:
        cause = image.geterror() or "unknown error"
        raise OSError(f"{path}: damaged or incomplete ({cause}); copy or download it again")
    pixels = np.asarray(pixels, np.float32).reshape(spec.height, spec.width, end - begin)
    pixels = np.ascontiguousarray(pixels[..., [c - begin for c in channels]])
    if spec.format.basetype not in _float_types():
        pixels = _srgb_to_linear(pixels)
    return _display_window(pixels, spec)


def _float_types():
    oiio = _openimageio()
    return (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)


def _rgb_channels(names: list[str], path: str) -> list[int]:
    """Indices of R, G and B (thrice the same for grey)."""
    plain = [name.rsplit(".", 1)[-1].upper() for name in names]  # "Layer.R" -> "R"

    def find(*wanted: str) -> int | None:
        return next((i for i, name in enumerate(plain) if name in wanted), None)

    rgb = [find("R", "RED"), find("G", "GREEN"), find("B", "BLUE")]
    if None not in rgb:
        return rgb
    if "RY" in plain or "BY" in plain:
        raise ValueError(f"{path}: stores luminance and chroma ({', '.join(names)}); save it as RGB")
    grey = find("Y", "L", "I", "GRAY", "GREY", "LUMINANCE")
    if grey is None and len(names) == 1:
        grey = 0
    if grey is None and rgb != [None, None, None]:
        found = ", ".join(names)
        raise ValueError(f"{path}: has no full set of R, G and B channels, only {found}; save it as RGB")
    if grey is None and len(names) >= 3:
        return [0, 1, 2]
    if grey is None:
        raise ValueError(f"{path}: channels {', '.join(names)} are neither RGB nor grey; save it as RGB")
    return [grey] * 3


def _srgb_to_linear(pixels: np.ndarray) -> np.ndarray:
    low = pixels <= 0.04045
    return np.where(low, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4).astype(np.float32)


def _display_window(pixels: np.ndarray, spec) -> np.ndarray:
    """A cropped file stores part of the map; the rest of it is black."""
    whole = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    if whole == (spec.x, spec.y, spec.width, spec.height) or spec.full_width < 1 or spec.full_height < 1:
        return pixels
    result = np.zeros((spec.full_height, spec.full_width, 3), np.float32)
    x, y = spec.x - spec.full_x, spec.y - spec.full_y
    left, top = max(x, 0), max(y, 0)
    right, bottom = min(x + spec.width, spec.full_width), min(y + spec.height, spec.full_height)
    if right > left and bottom > top:
        result[top:bottom, left:right] = pixels[top - y : bottom - y, left - x : right - x]
    return result
