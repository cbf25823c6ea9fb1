# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels of Blender images as linear float32, and what tells one state of an image from another."""

from __future__ import annotations

import os
import threading
import zlib
from dataclasses import dataclass, field

import bpy
import numpy as np

from . import compressed_map
from .messages import Messages
from .nodes import expression as ex

LINEAR_SPACES = ("Linear", "Non-Color", "Raw", "ACEScg", "scene_linear")


@dataclass(frozen=True)
class ImageSource:
    """One state of an image; equal sources have equal pixels."""

    identity: tuple
    name: str = field(compare=False)
    path: str = field(compare=False)
    is_sequence: bool = field(compare=False)
    image: object = field(compare=False, repr=False)

    def pixels(self) -> np.ndarray:
        """(height, width, channels 1..4) float32, scene-linear, row 0 at the top.

        Raises ValueError if there are no pixels (file missing or unreadable)."""
        if self.is_sequence:
            return _read_frame(self.path, self.image)
        return read_pixels(self.image)

    def rgb(self) -> np.ndarray:
        pixels = self.pixels()
        if pixels.shape[2] < 3:
            return np.repeat(pixels[..., :1], 3, axis=2)
        return np.ascontiguousarray(pixels[..., :3])


class ImageStore:
    """Makes ImageSources. Content that no file stands for (painted, generated) is told apart by a checksum,
    taken once until `invalidate` says that the image was edited."""

    def __init__(self):
        self._checksums: dict[int, int] = {}

    def invalidate(self, image):
        self._checksums.pop(identity_of(image), None)

    def source(self, image, image_user, owner: str, messages: Messages) -> ImageSource | None:
        """None, with a message, if the image has no pixels to give."""
        path = _path(image, image_user)
        if image.source == "MOVIE":
            messages.warn(
                f'{owner}: the image "{image.name}" is a movie, which is not read; '
                "convert it to an image sequence",
                topic="IMAGE",
            )
            return None
        if image.source == "VIEWER":
            messages.warn(
                f'{owner}: the image "{image.name}" is a render or viewer result, which is not read; '
                "save it and load the file",
                topic="IMAGE",
            )
            return None
        if compressed_map.is_compressed(image):
            return self._compressed(image, path, owner, messages)
        is_sequence = image.source == "SEQUENCE"
        if image.source == "TILED":
            messages.warn(f'{owner}: of the UDIM image "{image.name}" only the first tile is used')
        problem = _file_problem(path) if is_sequence or not all(image.size) else None
        if problem or not (is_sequence or all(image.size)):
            messages.warn(
                f'{owner}: the image "{image.name}" cannot be read: '
                f"{problem or path + ' is not an image that Blender can open'}",
                topic="IMAGE",
            )
            return None
        state = (
            identity_of(image),
            path,
            _modified(path),
            image.colorspace_settings.name,
            image.alpha_mode,
            tuple(image.size),
            image.packed_file.size if image.packed_file else 0,
        )
        if not is_sequence and (image.is_dirty or image.source == "GENERATED"):
            state = (*state, self._checksum(image))
        return ImageSource(state, image.name, path, is_sequence, image)

    def _compressed(self, image, path: str, owner: str, messages: Messages) -> ImageSource | None:
        packed = image.packed_file
        try:
            compressed_map.decode(image, path)  # some kilobytes: what is wrong is better said now
        except ValueError as error:
            messages.warn(f'{owner}: the image "{image.name}" cannot be read: {error}', topic="IMAGE")
            return None
        state = (identity_of(image), path, zlib.crc32(packed.data) if packed else _modified(path))
        return ImageSource(state, image.name, path, False, image)

    def _checksum(self, image) -> int:
        key = identity_of(image)
        if key not in self._checksums:
            self._checksums[key] = zlib.crc32(_raw_pixels(image))
        return self._checksums[key]


def identity_of(datablock) -> int:
    """A number that stands for a datablock as long as it exists (session_uid; Blender 3.4: its address)."""
    original = datablock.original or datablock
    return getattr(original, "session_uid", None) or original.as_pointer()


def read_pixels(image) -> np.ndarray:
    """See ImageSource.pixels; honours colour space, packed files and unsaved edits."""
    if compressed_map.is_compressed(image):
        return compressed_map.decode(image, _path(image, None))
    width, height = image.size
    channels = image.channels
    raw = _raw_pixels(image)
    if width * height == 0 or raw.size != width * height * channels:
        raise ValueError(
            f'The image "{image.name}" has no pixels: {_file_problem(_path(image, None)) or "reload it"}'
        )
    pixels = raw.reshape(height, width, channels)[::-1]
    if not image.is_float and not image.colorspace_settings.name.startswith(LINEAR_SPACES):
        pixels = _linear_from_bytes(pixels)
    return pixels


def _raw_pixels(image) -> np.ndarray:
    raw = np.empty(len(image.pixels), np.float32)
    if raw.size:
        image.pixels.foreach_get(raw)
    return raw


def _linear_from_bytes(pixels: np.ndarray) -> np.ndarray:
    # Blender hands out byte images as encoded values / 255, whatever their colour space.
    encoded = np.linspace(0.0, 1.0, 256)
    table = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4).astype(
        np.float32
    )
    linear = np.array(pixels, np.float32)
    colors = linear[..., :3]
    colors[...] = table[(colors * 255.0 + 0.5).astype(np.uint8)]
    return linear


def _read_frame(path: str, image) -> np.ndarray:
    # image.pixels of a sequence is empty in background. Only the main thread may add a datablock.
    if threading.current_thread() is threading.main_thread():
        try:
            frame = bpy.data.images.load(path)
        except RuntimeError as error:
            raise ValueError(f"{path}: {error}") from error
        try:
            frame.colorspace_settings.name = image.colorspace_settings.name
            return read_pixels(frame)
        finally:
            bpy.data.images.remove(frame)
    from . import native

    return native.core().read_image(path)


def _path(image, image_user) -> str:
    path = image.filepath_from_user(image_user=image_user) if image_user else image.filepath_from_user()
    return bpy.path.abspath(path, library=image.library) if path else ""


def _modified(path: str) -> int:
    try:
        return os.stat(path).st_mtime_ns
    except OSError:
        return 0


def _file_problem(path: str) -> str | None:
    if not path:
        return "it has no file"
    if os.path.isdir(path):
        return f"{path} is a directory"
    if not os.path.exists(path):
        return f"{path} does not exist"
    if not os.access(path, os.R_OK):
        return f"{path} may not be read (permission denied)"
    return None


def mean_value(expression: ex.Expression, messages: Messages) -> float:
    """Mean over the image of a scalar expression whose leaves are image textures."""
    try:
        return float(evaluate_texture(expression).mean())
    except ValueError as error:
        messages.warn(str(error))
        return 0.5


def evaluate_texture(expression: ex.Expression) -> np.ndarray:
    """Expression over the texels of its image leaves; the largest image sets the size, others are
    repeated."""
    loaded = {leaf: leaf.source.texels() for leaf in ex.leaves(expression)}
    height = max((a.shape[0] for a in loaded.values()), default=1)
    width = max((a.shape[1] for a in loaded.values()), default=1)

    def texels(leaf):
        array = loaded[leaf]
        rows = np.arange(height) * array.shape[0] // height
        columns = np.arange(width) * array.shape[1] // width
        return array if array.shape[:2] == (height, width) else array[rows][:, columns]

    return ex.evaluate(expression, texels)
