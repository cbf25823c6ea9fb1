# SPDX-License-Identifier: GPL-3.0-or-later
"""read_image on files written here, on damaged ones, and on real maps with bad texels."""

import os
import subprocess
import sys

import numpy as np
import pytest
import skytree_core as sky
from conftest import bad_maps

oiio = pytest.importorskip("OpenImageIO", reason="needs the Python module OpenImageIO")

BAD = bad_maps()


def write(path, pixels, names=None, form="float", **attributes):
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, form)
    if names:
        spec.channelnames = names
    tile = attributes.pop("tile", 0)
    if tile:
        spec.tile_width = spec.tile_height = tile
    for name, value in attributes.items():
        spec.attribute(name, value)
    output = oiio.ImageOutput.create(str(path))
    assert output and output.open(str(path), spec), oiio.geterror()
    assert output.write_image(np.ascontiguousarray(pixels, np.float32)), output.geterror()
    output.close()
    return path


def pixels_of(channels, height=10, width=20):
    return np.random.default_rng(channels).random((height, width, channels), dtype=np.float32) * 5


@pytest.mark.parametrize("form", ["half", "float"])
@pytest.mark.parametrize("compression", ["none", "zip", "piz", "rle", "dwaa", "dwab"])
@pytest.mark.parametrize("tile", [0, 16])
def test_exr_of_every_kind(tmp_path, form, compression, tile):
    pixels = pixels_of(3, 40, 70)
    path = write(tmp_path / "a.exr", pixels, form=form, compression=compression, tile=tile)
    image = sky.read_image(path)
    assert image.shape == (40, 70, 3) and image.dtype == np.float32 and image.flags.c_contiguous
    lossy = compression.startswith("dwa")
    if lossy:
        assert np.abs(image - pixels).mean() < 0.1
    else:
        np.testing.assert_allclose(image, pixels, rtol=1e-3 if form == "half" else 0)


def test_mip_mapped_exr_gives_its_largest_level(tmp_path):
    pixels = pixels_of(3, 32, 64)
    source = oiio.ImageBuf(oiio.ImageSpec(64, 32, 3, "float"))
    source.set_pixels(oiio.ROI(0, 64, 0, 32, 0, 1, 0, 3), pixels)
    path = str(tmp_path / "mip.exr")
    made = oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, source, path, oiio.ImageSpec())
    assert made, oiio.geterror()
    np.testing.assert_allclose(sky.read_image(path), pixels, rtol=2e-3)


def test_radiance_hdr(tmp_path):
    pixels = pixels_of(3)
    image = sky.read_image(write(tmp_path / "a.hdr", pixels))
    assert np.abs(image - pixels).max() < pixels.max() / 100


def test_row_0_is_the_top(tmp_path):
    pixels = np.zeros((4, 8, 3), np.float32)
    pixels[0] = 1.0
    image = sky.read_image(write(tmp_path / "a.exr", pixels))
    assert image[0].min() == 1 and image[1:].max() == 0


@pytest.mark.parametrize(
    ("names", "order"),
    [
        (["R", "G", "B"], [0, 1, 2]),
        (["B", "G", "R"], [2, 1, 0]),
        (["A", "B", "G", "R"], [3, 2, 1]),
        (["R", "G", "B", "A"], [0, 1, 2]),
        (["sky.R", "sky.G", "sky.B"], [0, 1, 2]),
        (["Y"], [0, 0, 0]),
        (["Y", "A"], [0, 0, 0]),
        (["depth"], [0, 0, 0]),
    ],
)
def test_channels_are_found_by_name(tmp_path, names, order):
    pixels = pixels_of(len(names))
    image = sky.read_image(write(tmp_path / "a.exr", pixels, names))
    np.testing.assert_array_equal(image, pixels[..., order])


@pytest.mark.parametrize("names", [["R", "G"], ["U", "V"], ["RY", "BY", "Y"]])
def test_channels_that_are_no_colour_are_refused_by_name(tmp_path, names):
    path = write(tmp_path / "a.exr", pixels_of(len(names)), names)
    with pytest.raises(ValueError, match="a.exr.*(RGB|grey)"):
        sky.read_image(path)


def test_integers_are_taken_as_srgb(tmp_path):
    path = write(tmp_path / "a.png", np.full((2, 4, 3), 0.5, np.float32), form="uint8")
    np.testing.assert_allclose(sky.read_image(path), ((128 / 255 + 0.055) / 1.055) ** 2.4, rtol=1e-3)


def test_cropped_exr_fills_its_display_window(tmp_path):
    pixels = pixels_of(3, 4, 6)
    spec = oiio.ImageSpec(6, 4, 3, "float")
    spec.x, spec.y = 2, 1
    spec.full_x, spec.full_y, spec.full_width, spec.full_height = 0, 0, 12, 8
    path = str(tmp_path / "crop.exr")
    output = oiio.ImageOutput.create(path)
    assert output.open(path, spec) and output.write_image(pixels)
    output.close()
    image = sky.read_image(path)
    assert image.shape == (8, 12, 3)
    np.testing.assert_array_equal(image[1:5, 2:8], pixels)
    assert image.sum() == pytest.approx(pixels.sum(), rel=1e-5)


def test_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="none.exr: no such file"):
        sky.read_image(tmp_path / "none.exr")


def test_directory(tmp_path):
    with pytest.raises(IsADirectoryError, match="is a directory"):
        sky.read_image(tmp_path)


def test_empty_file(tmp_path):
    path = tmp_path / "empty.exr"
    path.touch()
    with pytest.raises(ValueError, match="empty.exr: the file is empty"):
        sky.read_image(path)


@pytest.mark.parametrize("name", ["text.exr", "text.hdr", "text.txt"])
def test_not_an_image(tmp_path, name):
    path = tmp_path / name
    path.write_text("This is no picture.\n" * 20)
    with pytest.raises((ValueError, OSError), match=name):
        sky.read_image(path)


@pytest.mark.parametrize(("suffix", "keep"), [(".exr", 0.6), (".exr", 0.02), (".hdr", 0.6)])
def test_truncated_file(tmp_path, suffix, keep):
    path = write(tmp_path / f"cut{suffix}", pixels_of(3, 100, 200))
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * keep)])
    with pytest.raises((ValueError, OSError), match=f"cut{suffix}"):
        sky.read_image(path)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may read everything")
def test_no_permission(tmp_path):
    path = write(tmp_path / "secret.exr", pixels_of(3))
    path.chmod(0)
    with pytest.raises(PermissionError, match="secret.exr: no permission"):
        sky.read_image(path)


def test_no_permission_as_told_by_the_system(tmp_path, monkeypatch):
    path = write(tmp_path / "secret.exr", pixels_of(3))

    def refuse(*args, **kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    with pytest.raises(PermissionError, match="secret.exr: no permission"):
        sky.read_image(path)


def test_without_openimageio_the_message_says_how_to_get_it(tmp_path):
    path = write(tmp_path / "a.exr", pixels_of(3))
    code = (
        "import sys; sys.modules['OpenImageIO'] = None\n"
        "import skytree_core\n"
        f"try: skytree_core.read_image({str(path)!r})\n"
        "except ImportError as error: print(error)\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert "pip install OpenImageIO" in done.stdout, done.stderr


@pytest.mark.skipif(not BAD, reason="no maps with bad texels at hand")
@pytest.mark.parametrize("path", BAD, ids=lambda p: p.stem)
def test_real_maps_with_bad_texels(path):
    image = sky.read_image(path)
    bad = ~np.isfinite(image).all(axis=2) | (np.nan_to_num(image, nan=0) < 0).any(axis=2)
    assert bad.sum() > 0
    for sampler in (sky.KdTreeSampler(image), sky.InversionSampler(image)):
        assert sampler.bad_texels == bad.sum()
        pdf = sampler.sample(np.random.default_rng(0).random((10000, 3)))[1]
        assert np.isfinite(pdf).all() and (pdf > 0).all()
