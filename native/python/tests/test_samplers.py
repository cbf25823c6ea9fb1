# SPDX-License-Identifier: GPL-3.0-or-later
"""The samplers as numpy users see them; on maps made here and on real ones where there are any."""

import os
import threading
from pathlib import Path

import numpy as np
import pytest
import skytree_core as sky
from conftest import real_maps

CRITERIA = ("RANGE", "VARIANCE", "SSE", "MIN_VARIANCE", "MEDIAN_CUT")
PROBABILITIES = ("FITTED", "EXACT", "MIN_VARIANCE")
MAPS = real_maps()


def random_map(height=40, width=80, seed=0):
    image = np.random.default_rng(seed).gamma(0.3, 1.0, (height, width, 3)).astype(np.float32)
    image[height // 4, width // 3] = 2000.0
    return image


def all_samplers(image, block_count=1024):
    """Those whose density is constant in a texel."""
    for criterion in CRITERIA:
        for probability in PROBABILITIES:
            yield sky.KdTreeSampler(image, block_count, criterion, probability, block_density="CONSTANT")
    yield sky.InversionSampler(image)
    yield sky.InversionSampler(image, method="binary")
    yield sky.AliasSampler(image)
    yield sky.HierarchySampler(image)
    yield sky.UniformSampler()


def texel_directions(height, width):
    """Directions of texel centres (H,W,3) and solid angles of rows (H,)."""
    theta = (np.arange(height) + 0.5) * np.pi / height
    phi = np.pi * (1.0 - 2.0 * (np.arange(width) + 0.5) / width)
    directions = np.stack(
        np.broadcast_arrays(
            np.sin(theta)[:, None] * np.cos(phi),
            np.sin(theta)[:, None] * np.sin(phi),
            np.cos(theta)[:, None],
        ),
        axis=-1,
    )
    borders = np.cos(np.arange(height + 1) * np.pi / height)
    return directions, 2 * np.pi / width * (borders[:-1] - borders[1:])


def texel_of(directions, height, width):
    u = 0.5 - np.arctan2(directions[:, 1], directions[:, 0]) / (2 * np.pi)
    v = np.arccos(np.clip(directions[:, 2].astype(np.float64), -1, 1)) / np.pi
    column = np.clip((u * width).astype(int), 0, width - 1)
    return np.clip((v * height).astype(int), 0, height - 1), column


@pytest.mark.parametrize("sampler", list(all_samplers(random_map(), 300)), ids=repr)
def test_samples_follow_the_pdf(sampler):
    height, width, count = 40, 80, 200_000
    centres, solid_angles = texel_directions(height, width)
    probability = sampler.pdf(centres.reshape(-1, 3)).reshape(height, width) * solid_angles[:, None]
    assert probability.sum() == pytest.approx(1.0, abs=1e-4)
    directions, pdf = sampler.sample(np.random.default_rng(1).random((count, 3)))
    assert directions.dtype == pdf.dtype == np.float32
    assert directions.shape == (count, 3) and pdf.shape == (count,)
    np.testing.assert_array_equal(sampler.pdf(directions), pdf)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-6)
    drawn = np.zeros((height, width))
    np.add.at(drawn, texel_of(directions, height, width), 1)
    expected = probability * count
    enough = expected >= 10
    chi2 = ((drawn - expected) ** 2 / np.maximum(expected, 1e-30))[enough].sum()
    degrees = enough.sum() - 1
    assert abs(chi2 - degrees) < 5 * np.sqrt(2 * degrees)


@pytest.mark.skipif(not MAPS, reason="no real maps: set SKYTREE_HDRI to a folder of EXR or HDR files")
@pytest.mark.parametrize("path", MAPS, ids=lambda p: p.stem)
def test_real_maps(path):
    image = sky.read_image(path)
    u = np.random.default_rng(2).random((100_000, 3), dtype=np.float32)
    solid_angles = texel_directions(*image.shape[:2])[1]
    for sampler in (
        sky.KdTreeSampler(image),
        sky.KdTreeSampler(image, 1024, "MIN_VARIANCE", "MIN_VARIANCE", block_density="CONSTANT"),
        sky.InversionSampler(image),
        sky.AliasSampler(image),
    ):
        directions, pdf = sampler.sample(u)
        np.testing.assert_array_equal(sampler.pdf(directions), pdf)
        every = texel_directions(*image.shape[:2])[0].reshape(-1, 3)
        mass = sampler.pdf(every).reshape(image.shape[:2]) * solid_angles[:, None]
        assert mass.sum(dtype=np.float64) == pytest.approx(1.0, abs=1e-4)
        # chi^2 over 16 x 32 cells of the map
        rows, columns = texel_of(directions, *image.shape[:2])
        height, width = image.shape[:2]
        cell = (rows * 16 // height) * 32 + columns * 32 // width
        drawn = np.bincount(cell, minlength=512)
        cells = (np.arange(height) * 16 // height)[:, None] * 32 + np.arange(width) * 32 // width
        expected = np.bincount(cells.ravel(), weights=mass.ravel(), minlength=512) * len(u)
        enough = expected >= 10
        chi2 = ((drawn - expected) ** 2)[enough] @ (1 / expected[enough])
        degrees = max(enough.sum() - 1, 1)
        assert abs(chi2 - degrees) < 6 * np.sqrt(2 * degrees)


def test_attributes_of_the_kdtree():
    image = random_map()
    for criterion in CRITERIA:
        for probability in PROBABILITIES:
            sampler = sky.KdTreeSampler(image, 200, criterion, probability, block_density="CONSTANT")
            assert sampler.block_count == 200 and sampler.block_density == "CONSTANT"
            bounds = sampler.bounds
            assert bounds.shape == (200, 4) and bounds.dtype == np.int32
            covered = np.zeros(image.shape[:2], int)
            for x0, y0, x1, y1 in bounds:
                covered[y0:y1, x0:x1] += 1
            assert (covered == 1).all()
            assert sampler.probabilities.sum() == pytest.approx(1.0)
            assert sampler.empirical.sum() == pytest.approx(1.0)
            assert (np.diff(sampler.empirical) <= 0).all()
            assert sampler.alpha > 0 and sampler.fit_error >= 0 and sampler.kl_divergence >= 0
            assert 0 < sampler.nbytes <= 48 * 1024
            assert sampler.build_seconds > 0


def test_blocks_of_linear_density():
    image = random_map()
    height, width = image.shape[:2]
    sampler = sky.KdTreeSampler(image, 200, "MIN_VARIANCE", "MIN_VARIANCE")  # the default there
    assert sampler.block_density == "LINEAR" and sampler.block_count == 200
    bounds, tilts = sampler.bounds, sampler.tilts
    assert bounds.shape == (200, 4) and bounds.dtype == np.float32
    assert tilts.shape == (200, 2) and np.abs(tilts).max() < 0.981 and np.abs(tilts).max() > 0.1
    covered = np.zeros((2 * height, width), int)
    for x0, y0, x1, y1 in bounds:
        columns = np.arange(x0 - 0.5, x1 - 0.5).astype(int)
        covered[int(2 * y0) : int(2 * y1), columns] += 1
    assert (covered == 1).all()

    # The pdf is what probabilities and tilts say, at four points of every block, and integrates to 1.
    heights = (1 - np.cos(np.pi * bounds[:, 1::2].astype(np.float64) / height)) / 2
    rise = heights[:, 1] - heights[:, 0]
    solid_angles = 4 * np.pi * rise * (bounds[:, 2] - bounds[:, 0]) / width
    assert solid_angles.sum() == pytest.approx(4 * np.pi)
    for p in (0.25, 0.75):
        for q in (0.25, 0.75):
            phi = 2 * np.pi * (0.5 - (bounds[:, 0] + p * (bounds[:, 2] - bounds[:, 0])) / width)
            z = 1 - 2 * (heights[:, 0] + q * rise)
            r = np.sqrt(1 - z**2)
            pdf = sampler.pdf(np.stack((r * np.cos(phi), r * np.sin(phi), z), axis=1))
            shape = (1 + tilts[:, 0] * (2 * p - 1)) * (1 + tilts[:, 1] * (2 * q - 1))
            np.testing.assert_allclose(pdf, sampler.probabilities / solid_angles * shape, rtol=1e-3)
    directions, pdf = sampler.sample(np.random.default_rng(1).random((20000, 3), np.float32))
    np.testing.assert_array_equal(sampler.pdf(directions), pdf)
    rebuilt = sampler.reconstruct()
    assert rebuilt.mean() == pytest.approx(image.mean(), rel=0.02)
    assert np.abs(rebuilt - image).mean() < 0.9 * np.abs(image - image.mean(axis=(0, 1))).mean()


def test_auto_block_count_and_compensation():
    image = random_map()
    choice = ("MIN_VARIANCE", "MIN_VARIANCE")
    automatic = sky.KdTreeSampler(image, "AUTO", *choice)
    assert 16 < automatic.block_count < 4096
    assert sky.KdTreeSampler(image, "AUTO").block_count == 1024  # the paper's blocks
    plain = sky.KdTreeSampler(image, 256, *choice)
    compensated = sky.KdTreeSampler(image, 256, *choice, compensation=1.0)
    centre = texel_directions(*image.shape[:2])[0][10, 26][None]
    assert compensated.pdf(centre)[0] > plain.pdf(centre)[0]
    with pytest.raises(ValueError, match='block_count is "SOME"'):
        sky.KdTreeSampler(image, "SOME", *choice)
    with pytest.raises(ValueError, match="compensation is 2"):
        sky.KdTreeSampler(image, 256, *choice, compensation=2.0)
    with pytest.raises(ValueError, match="choose EXACT or MIN_VARIANCE"):
        sky.KdTreeSampler(image, 256, compensation=0.5)
    with pytest.raises(ValueError, match="block_density LINEAR needs"):
        sky.KdTreeSampler(image, 256, block_density="LINEAR")


def test_fitted_probabilities_are_the_papers_model():
    sampler = sky.KdTreeSampler(random_map(), 256)
    rank = np.arange(256)
    model = np.log1p(1 / (sampler.alpha + rank)) / np.log1p(256 / sampler.alpha)
    np.testing.assert_allclose(sampler.probabilities, model, rtol=1e-5)
    difference = model - sampler.empirical
    assert sampler.fit_error == pytest.approx(np.sqrt(np.mean(difference**2)), rel=1e-6)


def test_pixel_statistics_are_the_papers():
    """Unweighted pixels: a block's share is the sum of its pixels, and the map rebuilt from it their mean."""
    image = random_map()
    sampler = sky.KdTreeSampler(image, 100, "SSE", "FITTED", statistics="PIXELS")
    luminance = image @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    sums = [luminance[y0:y1, x0:x1].sum() for x0, y0, x1, y1 in sampler.bounds]
    np.testing.assert_allclose(sampler.empirical, np.array(sums) / luminance.sum(), rtol=1e-5)
    rebuilt = sampler.reconstruct()
    assert rebuilt.shape == image.shape and rebuilt.dtype == np.float32
    for x0, y0, x1, y1 in sampler.bounds:
        mean = image[y0:y1, x0:x1].mean(axis=(0, 1))
        np.testing.assert_allclose(
            rebuilt[y0:y1, x0:x1], np.broadcast_to(mean, (y1 - y0, x1 - x0, 3)), rtol=1e-5
        )


def test_reconstruct_outlives_the_array_it_was_built_from():
    image = random_map()
    sampler = sky.KdTreeSampler(image.astype(np.float64)[:, ::-1])  # converted to a temporary array
    rebuilt = sampler.reconstruct()
    assert rebuilt.mean() == pytest.approx(image.mean(), rel=0.05)


def test_a_direction_meets_the_texel_that_blender_shows_there():
    image = np.full((16, 32, 3), 1e-3, np.float32)
    image[5, 20] = 1e4
    centres = texel_directions(16, 32)[0]
    for sampler in all_samplers(image):
        if isinstance(sampler, sky.UniformSampler):
            continue
        pdf = sampler.pdf(centres.reshape(-1, 3))
        assert pdf.argmax() == 5 * 32 + 20


def test_inputs_of_any_floating_dtype_and_layout():
    sampler = sky.KdTreeSampler(random_map())
    u = np.random.default_rng(3).random((64, 3), dtype=np.float32)
    expected = sampler.sample(u)
    for other in (u.astype(np.float64), np.asfortranarray(u), np.repeat(u, 2, axis=0)[::2]):
        for a, b in zip(expected, sampler.sample(other), strict=True):
            np.testing.assert_array_equal(a, b)
    assert sampler.sample(np.zeros((0, 3)))[0].shape == (0, 3)
    below_one = np.full((1, 3), np.nextafter(1.0, 0.0))  # a double that single precision rounds to 1
    assert np.isfinite(sampler.sample(below_one)[1]).all()
    scaled = sampler.pdf(7.5 * expected[0])
    np.testing.assert_allclose(scaled, expected[1], rtol=1e-6)


@pytest.mark.parametrize(
    ("u", "message"),
    [
        (np.zeros(3), r"u has shape \(3,\)"),
        (np.zeros((2, 2)), r"u has shape \(2, 2\)"),
        (np.zeros((2, 3), int), "u has dtype int64"),
        (np.array([[0, 0, 1.0]]), r"u\[0\] .*in \[0, 1\)"),
        (np.array([[0, 0, 0], [0, -0.1, 0]]), r"u\[1\] "),
        (np.array([[np.nan, 0, 0]]), r"u\[0\] "),
        ("text", "u has dtype"),
    ],
)
def test_bad_random_numbers_are_named(u, message):
    for sampler in (sky.KdTreeSampler(random_map()), sky.UniformSampler()):
        with pytest.raises(ValueError, match=message):
            sampler.sample(u)


@pytest.mark.parametrize(
    ("directions", "message"),
    [
        (np.zeros((4, 2)), r"directions has shape \(4, 2\)"),
        (np.zeros((1, 3)), r"directions\[0\] .*no direction"),
        (np.array([[0, 0, 1], [0, np.inf, 0]]), r"directions\[1\]"),
        (np.array([[0, np.nan, 0]]), r"directions\[0\]"),
    ],
)
def test_bad_directions_are_named(directions, message):
    with pytest.raises(ValueError, match=message):
        sky.KdTreeSampler(random_map()).pdf(directions)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((4, 8)), r"image has shape \(4, 8\)"),
        (np.zeros((4, 8, 4)), r"image has shape \(4, 8, 4\)"),
        (np.zeros((0, 8, 3)), r"image has shape \(0, 8, 3\)"),
        (np.zeros((4, 8, 3), np.uint8), "image has dtype uint8"),
        (np.zeros((4, 8, 3), complex), "image has dtype complex128"),
        (np.zeros((1, 70000, 3)), "70000 x 1 texels is too large"),
        (None, "image"),
    ],
)
def test_bad_images_are_named(image, message):
    for make in (sky.KdTreeSampler, sky.InversionSampler, sky.AliasSampler):
        with pytest.raises(ValueError, match=message):
            make(image)


def test_bad_settings_are_named():
    image = random_map()
    with pytest.raises(ValueError, match="block_count is 0; it must be from 1 to 32768"):
        sky.KdTreeSampler(image, 0)
    with pytest.raises(ValueError, match='split_criterion is "sse"; it must be one of RANGE, VARIANCE'):
        sky.KdTreeSampler(image, 64, "sse")
    with pytest.raises(ValueError, match="block_probability"):
        sky.KdTreeSampler(image, 64, "SSE", "SSE")
    with pytest.raises(ValueError, match="statistics"):
        sky.KdTreeSampler(image, statistics="TEXELS")
    with pytest.raises(ValueError, match="uniform_share"):
        sky.KdTreeSampler(image, uniform_share=0.0)
    with pytest.raises(ValueError, match="method"):
        sky.InversionSampler(image, method="linear")


def test_bad_texels_are_counted_and_reported():
    image = random_map()
    image[3, 4, 1], image[5, 6, 0], image[7, 8, 2], image[9, 9, 2] = np.nan, np.inf, -1, -np.inf
    for sampler in (sky.KdTreeSampler(image), sky.InversionSampler(image), sky.AliasSampler(image)):
        assert sampler.bad_texels == 4
        assert "1 NaN, 2 infinite, 1 negative" in sampler.bad_texels_message
        assert np.isfinite(sampler.sample(np.random.default_rng(0).random((1000, 3)))[1]).all()
    assert np.isfinite(sky.KdTreeSampler(image).reconstruct()).all()
    assert sky.KdTreeSampler(random_map()).bad_texels_message == ""


def test_progress_is_called_and_cancels():
    image = random_map(200, 400)
    calls = []
    sky.KdTreeSampler(image, progress=calls.append)
    assert calls == sorted(calls) and len(calls) > 10 and 0 <= calls[0] and calls[-1] <= 1
    with pytest.raises(sky.BuildCancelled, match="cancelled"):
        sky.KdTreeSampler(image, progress=lambda done: done < 0.5)

    def broken(done):
        raise ZeroDivisionError("from the callback")

    with pytest.raises(ZeroDivisionError, match="from the callback"):
        sky.KdTreeSampler(image, progress=broken)


def test_shared_statistics_give_the_same_samplers():
    image = random_map(100, 200)
    statistics = sky.MapStatistics(image)
    assert statistics.nbytes == 0
    for criterion, probability in (("MIN_VARIANCE", "MIN_VARIANCE"), ("SSE", "FITTED")):
        for block_count in (300, 80, "AUTO"):
            alone = sky.KdTreeSampler(image, block_count, criterion, probability, threads=1)
            shared = sky.KdTreeSampler(statistics, block_count, criterion, probability, threads=3)
            np.testing.assert_array_equal(shared.bounds, alone.bounds)
            np.testing.assert_array_equal(shared.probabilities, alone.probabilities)
            np.testing.assert_array_equal(shared.tilts, alone.tilts)
            np.testing.assert_array_equal(shared.reconstruct(), alone.reconstruct())
    u = np.random.default_rng(1).random((1000, 3))
    for shared in (statistics, sky.MapStatistics(image)):
        for one, other in zip(
            sky.AliasSampler(image).sample(u), sky.AliasSampler(shared).sample(u), strict=True
        ):
            np.testing.assert_array_equal(one, other)
    assert statistics.nbytes > 4 * 100 * 200
    with pytest.raises(ValueError, match="image has shape"):
        sky.MapStatistics(image[..., :2])
    with pytest.raises(ValueError, match="threads is -1"):
        sky.KdTreeSampler(image, threads=-1)
    for make in (sky.InversionSampler, sky.AliasSampler, sky.HierarchySampler):
        u = np.random.default_rng(1).random((1000, 3))
        for one, three in zip(
            make(image, threads=1).sample(u), make(image, threads=3).sample(u), strict=True
        ):
            np.testing.assert_array_equal(one, three)


def test_the_same_input_gives_the_same_tree_on_any_thread():
    image = random_map(100, 200)
    expected = sky.KdTreeSampler(image, 500, "MIN_VARIANCE", "MIN_VARIANCE")
    results = []

    def build():
        results.append(sky.KdTreeSampler(image, 500, "MIN_VARIANCE", "MIN_VARIANCE"))

    threads = [threading.Thread(target=build) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for result in results:
        np.testing.assert_array_equal(result.bounds, expected.bounds)
        np.testing.assert_array_equal(result.probabilities, expected.probabilities)


def test_constant_maps_stay_one_block_and_are_sampled_uniformly():
    for value in (0.0, 2.0):
        sampler = sky.KdTreeSampler(np.full((20, 40, 3), value))
        assert sampler.block_count == 1
        pdf = sampler.sample(np.random.default_rng(0).random((100, 3)))[1]
        np.testing.assert_allclose(pdf, 1 / (4 * np.pi), rtol=1e-6)


def test_devices():
    devices = sky.devices()
    assert devices[0].type == "CPU" and devices[0].name
    assert all(device.type in ("CPU", "CUDA") for device in devices)


def test_types_are_declared():
    package = Path(sky.__file__).parent
    assert (package / "py.typed").exists()
    stubs = (package / "_native.pyi").read_text()
    for name in sky.__all__:
        if name not in ("read_image", "resampled", "stratified"):  # these are Python
            assert name in stubs
    assert os.path.exists(package / "__init__.py")
