# SPDX-License-Identifier: GPL-3.0-or-later
"""Methods of the related work as numpy users see them (docs/related.md)."""

import numpy as np
import pytest
import skytree_core as sky
from test_samplers import random_map, texel_directions

UP = np.array([[0.0, 0.0, 1.0]])


def smooth_map(height=32, width=64):
    centres, _ = texel_directions(height, width)
    value = 1.0 + 0.5 * centres[..., 2] + 0.3 * centres[..., 0] * centres[..., 1]
    return np.repeat(value[..., None], 3, axis=-1).astype(np.float32)


def brute_irradiance(image, normals):
    centres, solid_angles = texel_directions(*image.shape[:2])
    cosines = np.maximum(centres.reshape(-1, 3) @ np.asarray(normals).T, 0.0)
    light = (image * solid_angles[:, None, None]).reshape(-1, 3)
    return cosines.T @ light


def test_harmonics_follow_a_smooth_map_and_ring_at_a_sun():
    normals = np.vstack([np.eye(3), -np.eye(3)])
    image = smooth_map()
    estimate = sky.harmonic_irradiance(sky.harmonic_coefficients(image), normals)
    np.testing.assert_allclose(estimate, brute_irradiance(image, normals), rtol=0.01)
    sun = np.zeros((32, 64, 3), np.float32)
    sun[3, 20] = 1000.0
    ringing = sky.harmonic_irradiance(sky.harmonic_coefficients(sun), -UP)
    exact = sky.harmonic_irradiance(sky.harmonic_coefficients(sun), UP)
    assert exact.min() > 0 and not np.allclose(ringing, 0.0)  # below the sun there is no light


def test_harmonics_refuse_what_they_cannot_use():
    with pytest.raises(ValueError, match="coefficients has shape"):
        sky.harmonic_irradiance(np.zeros((4, 3)), UP)
    with pytest.raises(ValueError, match="no direction"):
        sky.harmonic_irradiance(np.zeros((9, 3)), np.zeros((1, 3)))


def test_point_lights_have_the_maps_power():
    image = random_map()
    _, solid_angles = texel_directions(*image.shape[:2])
    directions, power = sky.KdTreeSampler(image, 64, "MEDIAN_CUT", "EXACT").point_lights()
    assert directions.shape == power.shape == (64, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, rtol=1e-5)
    expected = (image * solid_angles[:, None, None]).sum(axis=(0, 1))
    np.testing.assert_allclose(power.sum(axis=0), expected, rtol=1e-4)


def test_filtered_map_has_no_density_but_filters():
    image = random_map()
    filtered = sky.FilteredMap(image, samples=16)
    for call in (lambda: filtered.pdf(UP), lambda: filtered.sample(np.full((1, 3), 0.5))):
        with pytest.raises(ValueError, match="draws no directions"):
            call()
    _, solid_angles = texel_directions(*image.shape[:2])
    mean = (image * solid_angles[:, None, None]).sum(axis=(0, 1)) / (4 * np.pi)
    np.testing.assert_allclose(filtered.lookup(image, UP, 1e-6)[0], mean, rtol=1e-4)
    assert 0 < filtered.nbytes < image.nbytes / 2 and filtered.samples == 16
    with pytest.raises(ValueError, match="samples is 0"):
        sky.FilteredMap(image, 0)
    with pytest.raises(ValueError, match="overlap"):
        sky.FilteredMap(image, 4, overlap=0.0)


def test_session_tells_what_a_filtered_map_needs():
    scene, session = sky.Scene(), sky.RenderSession(threads=1)
    with pytest.raises(ValueError, match="no light samples"):
        session.start(scene, 8, 8, 1, sampler=sky.FilteredMap(random_map()), bsdf_sampling=False)
    with pytest.raises(ValueError, match="candidates"):
        session.start(scene, 8, 8, 1, candidates=-1)


def test_stratified_numbers_fill_their_strata():
    u = sky.stratified(64, seed=3)
    assert u.dtype == np.float32 and u.min() >= 0 and u.max() < 1
    assert sorted((u[:, 0] * 64).astype(int)) == list(range(64))
    assert len({tuple(cell) for cell in (u[:, 1:] * 8).astype(int)}) == 64
    with pytest.raises(ValueError, match="square number, such as 81"):
        sky.stratified(70)


def spread(image, draw, repeats=200):
    """Mean and deviation over repeats of an estimate of the irradiance from above."""
    estimates = [draw(seed) for seed in range(repeats)]
    return np.mean(estimates), np.std(estimates)


def test_stratification_takes_noise_away():
    image = smooth_map()
    tree = sky.KdTreeSampler(image, 256, "MIN_VARIANCE", "MIN_VARIANCE")
    filtered = sky.FilteredMap(image, samples=1 << 30)  # never filters: the map itself

    def estimate(u):
        directions, pdf = tree.sample(u)
        light = filtered.lookup(image, directions, 1.0)[:, 0]
        return np.mean(light * np.maximum(directions[:, 2], 0) / pdf)

    mean, deviation = spread(image, lambda seed: estimate(sky.stratified(64, seed)))
    _, independent = spread(image, lambda seed: estimate(np.random.default_rng(seed).random((64, 3))))
    assert mean == pytest.approx(brute_irradiance(image, UP)[0, 0], rel=0.02)
    assert deviation < 0.4 * independent


def test_resampling_is_unbiased_and_follows_the_product():
    image = random_map()
    tree = sky.KdTreeSampler(image, 64, "MIN_VARIANCE", "MIN_VARIANCE")
    filtered = sky.FilteredMap(image, samples=1 << 30)

    def light(directions):
        return filtered.lookup(image, directions, 1.0)[:, 0].astype(np.float64)

    def product(directions):
        return light(directions) * np.maximum(directions[:, 2], 0)

    generator = np.random.default_rng(5)
    directions, weights = sky.resampled(
        tree, product, generator.random((40000, 8, 3)), generator.random(40000)
    )
    estimates = product(directions) * weights
    plain, pdf = tree.sample(generator.random((40000, 3)))
    single = product(plain) / pdf
    tolerance = 5 * np.hypot(estimates.std(), single.std()) / 200
    assert estimates.mean() == pytest.approx(single.mean(), abs=tolerance)
    assert estimates.std() < 0.6 * single.std()
    assert (directions[weights > 0, 2] > 0).all()
