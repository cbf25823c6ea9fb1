# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes PNG and multi-layer OpenEXR files with numpy and zlib alone.

Blender's own writers put dates, host names and render times into the files; these do not, so that equal
pixels make equal files. EXR layout: "OpenEXR File Layout" and "Technical Introduction to OpenEXR"
(openexr.com), single-part scan lines, ZIP compression (16 lines a block, bytes split and delta-coded before
deflate), 32-bit float.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
EXR_MAGIC, EXR_VERSION, EXR_LONG_NAMES = 20000630, 2, 0x400
EXR_FLOAT, EXR_ZIP, EXR_LINES_PER_BLOCK = 2, 3, 16


def png_bytes(pixels: np.ndarray) -> bytes:
    """A PNG of (H,W,3) uint8 sRGB, row 0 at the top."""
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3:
        raise ValueError(f"A PNG takes (H,W,3) uint8, not {pixels.shape} {pixels.dtype}")
    height, width = pixels.shape[:2]
    # Filter 2 (difference to the line above) compresses renders far better than none.
    lines = np.full((height, 1 + 3 * width), 2, np.uint8)
    flat = pixels.reshape(height, -1)
    lines[0, 1:] = flat[0]
    lines[1:, 1:] = flat[1:] - flat[:-1]
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = (
        (b"IHDR", header),
        (b"sRGB", b"\0"),
        (b"IDAT", zlib.compress(lines.tobytes(), 9)),
        (b"IEND", b""),
    )
    return PNG_SIGNATURE + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in chunks
    )


def write_exr(path: Path, layers: dict[str, np.ndarray], attributes: dict[str, str] | None = None) -> None:
    """Writes layers {name: (H,W,3) float} of one size, row 0 at the top, as channels NAME.Combined.R/G/B,
    which Blender shows as render layers; `attributes` become string attributes of the header."""
    shapes = {layer.shape for layer in layers.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 3 or next(iter(shapes))[2] != 3:
        raise ValueError(f"The layers of {path} must all be (H,W,3) of one size, not {sorted(shapes)}")
    height, width = next(iter(shapes))[:2]
    channels = {
        f"{name}.Combined.{letter}": layer[..., index].astype("<f4")
        for name, layer in layers.items()
        for index, letter in enumerate("RGB")
    }
    names = sorted(channels)
    planes = np.stack(
        [channels[name] for name in names], axis=1
    )  # (height, channel, width): as lines are stored
    blocks = [
        _zip_block(planes[y : y + EXR_LINES_PER_BLOCK].tobytes())
        for y in range(0, height, EXR_LINES_PER_BLOCK)
    ]
    header = _exr_header(names, width, height, attributes or {})
    offset = len(header) + 8 * len(blocks)
    with open(path, "wb") as file:
        file.write(header)
        for block in blocks:
            file.write(struct.pack("<Q", offset))
            offset += 8 + len(block)
        for index, block in enumerate(blocks):
            file.write(struct.pack("<ii", index * EXR_LINES_PER_BLOCK, len(block)) + block)


def _zip_block(raw: bytes) -> bytes:
    data = np.frombuffer(raw, np.uint8)
    split = np.concatenate((data[0::2], data[1::2]))
    coded = split.copy()
    coded[1:] = split[1:] - split[:-1] + np.uint8(128)
    packed = zlib.compress(coded.tobytes(), 6)
    return packed if len(packed) < len(raw) else raw


def _exr_header(channels: list[str], width: int, height: int, attributes: dict[str, str]) -> bytes:
    channel_list = b"".join(
        name.encode() + b"\0" + struct.pack("<iB3xii", EXR_FLOAT, 0, 1, 1) for name in channels
    )
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    fields = [
        ("channels", "chlist", channel_list + b"\0"),
        ("compression", "compression", struct.pack("<B", EXR_ZIP)),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
        ("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0.0, 0.0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1.0)),
        *((name, "string", text.encode()) for name, text in attributes.items()),
    ]
    long_names = any(len(name) > 31 for name in (*channels, *attributes))
    start = struct.pack("<ii", EXR_MAGIC, EXR_VERSION | (EXR_LONG_NAMES if long_names else 0))
    return (
        start
        + b"".join(
            name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
            for name, kind, value in fields
        )
        + b"\0"
    )
