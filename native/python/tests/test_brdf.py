# SPDX-License-Identifier: GPL-3.0-or-later
"""NdKdTreeSampler, BrdfTable and BrdfKdTree from numpy, and the closure TABULATED."""

import numpy as np
import pytest
import skytree_core


def bump(shape):
    axes = np.meshgrid(*[(np.arange(n) + 0.5) / n for n in shape], indexing="ij")
    return 0.02 + np.exp(-20 * sum((x - 0.4) ** 2 for x in axes))


@pytest.mark.parametrize("probability", ["FITTED", "EXACT", "MIN_VARIANCE"])
@pytest.mark.parametrize(
    ("shape", "condition"), [((64,), 0), ((32, 32), 0), ((16, 16, 16), 1), ((8,) * 4, 2)]
)
def test_integral_is_unbiased_and_pdf_is_the_samples(shape, condition, probability):
    table = bump(shape)
    tree = skytree_core.NdKdTreeSampler(table, condition, 200, 8, block_probability=probability)
    rng = np.random.default_rng(1)
    free = len(shape) - condition
    given = np.full((20000, condition), 0.3) if condition else None
    points, pdf = tree.sample(rng.random((20000, free + 1)), given)
    assert points.shape == (20000, free)
    np.testing.assert_array_equal(tree.pdf(points, given), pdf)
    cells = [np.full(20000, int(0.3 * n)) for n in shape[:condition]]
    cells += [(points[:, i] * n).astype(int) for i, n in enumerate(shape[condition:])]
    estimate = table[tuple(cells)] / pdf
    expected = table[tuple(int(0.3 * n) for n in shape[:condition])].mean()
    assert abs(estimate.mean() - expected) < 5 * estimate.std() / 141
    assert 0 < tree.nbytes < 64 * 200 + 1000
    assert tree.alphas.shape == (tree.slice_count,)


def test_one_lit_cell_between_uneven_borders():
    table = np.zeros((4, 4))
    table[1, 2] = 1
    edges = [np.array([0, 0.1, 0.15, 0.9, 1.0]), np.array([0, 0.5, 0.6, 0.9, 1.0])]
    tree = skytree_core.NdKdTreeSampler(table, edges=edges, uniform_share=0.1)
    points, _ = tree.sample(np.random.default_rng(2).random((10000, 3)))
    inside = (points[:, 0] >= 0.1) & (points[:, 0] < 0.15) & (points[:, 1] >= 0.6) & (points[:, 1] < 0.9)
    assert abs(inside.mean() - 0.9) < 0.03
    np.testing.assert_array_equal(tree.pdf([[-0.1, 0.5], [1.2, 0.5]]), 0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (dict(table=np.ones((2,) * 5)), "1 to 4 dimensions"),
        (dict(table=-np.ones((4, 4))), "negative"),
        (dict(table=np.ones((4, 4)), condition_dimensions=2), "leave a dimension"),
        (dict(table=np.ones(4), block_count=0), "block_count"),
        (dict(table=np.ones(4), split_criterion="RANGE"), "VARIANCE, SSE, MIN_VARIANCE"),
        (dict(table=np.ones(4), edges=[np.linspace(0, 2, 5)]), "begin at 0 and end at 1"),
    ],
)
def test_bad_tables_are_explained(arguments, words):
    with pytest.raises(ValueError, match=words):
        skytree_core.NdKdTreeSampler(**arguments)


def hemisphere(rng, count, lowest=0.05):
    z, phi = rng.uniform(lowest, 1, count), rng.uniform(0, 2 * np.pi, count)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1).astype(np.float32)


@pytest.mark.parametrize("alphas", [(0.3,), (0.4, 0.1)])
@pytest.mark.parametrize("model", ["ward", "ggx"])
def test_brdf_furnace_and_reciprocity(model, alphas):
    brdf = skytree_core.BrdfKdTree(getattr(skytree_core.BrdfTable, model)(*alphas))
    rng = np.random.default_rng(3)
    wo = np.tile(hemisphere(rng, 1), (30000, 1))
    wi, pdf = brdf.sample(wo, rng.random((30000, 2)))
    np.testing.assert_array_equal(brdf.pdf(wo, wi), pdf)
    assert np.all((pdf > 0) == (wi[:, 2] > 0))
    weight = np.where(pdf > 0, brdf.evaluate(wo, wi)[:, 0] * wi[:, 2] / np.maximum(pdf, 1e-30), 0)
    # The same integral by uniform directions.
    uniform = hemisphere(rng, 400000, 0)
    albedo = np.mean(brdf.evaluate(np.tile(wo[:1], (400000, 1)), uniform)[:, 0] * uniform[:, 2]) * 2 * np.pi
    assert weight.mean() == pytest.approx(albedo, abs=0.02)
    assert weight.mean() < 1.01
    a, b = hemisphere(rng, 1000), hemisphere(rng, 1000)
    np.testing.assert_allclose(brdf.evaluate(a, b), brdf.evaluate(b, a), rtol=2e-3, atol=1e-6)
    assert brdf.nbytes < 1 << 20
    assert brdf.table_nbytes == 4 * np.prod(skytree_core.BrdfTable.ggx(*alphas).shape)


def test_bad_merl_files(tmp_path):
    with pytest.raises(RuntimeError, match="cannot be opened"):
        skytree_core.BrdfTable.merl(str(tmp_path / "none.binary"))
    path = tmp_path / "half.binary"
    path.write_bytes(np.array((90, 90, 180), np.int32).tobytes() + bytes(1000))
    with pytest.raises(RuntimeError, match=r"half.binary.*truncated"):
        skytree_core.BrdfTable.merl(str(path))


def test_closure_needs_a_brdf_of_the_scene():
    scene = skytree_core.Scene()
    with pytest.raises(ValueError, match="add_brdf"):
        scene.add_material([{"type": "TABULATED"}])
    brdf = scene.add_brdf(skytree_core.BrdfKdTree(skytree_core.BrdfTable.ggx(0.3)))
    scene.add_material([{"type": "TABULATED", "brdf": brdf, "color": (0.5, 0.5, 0.5)}])
    scene.remove_brdf(brdf)
    with pytest.raises(ValueError, match="brdf"):
        scene.remove_brdf(brdf)
