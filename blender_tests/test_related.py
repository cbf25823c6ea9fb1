# SPDX-License-Identifier: GPL-3.0-or-later
"""The methods of the related work, as settings of a render and as sides of a comparison."""

import json
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import scenes


@pytest.fixture
def lit(scene):
    scene.render.resolution_x, scene.render.resolution_y = 48, 32
    scene.skytree.max_bounces = 0
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.float_image("smooth", scenes.smooth_map()))
    return scene


@pytest.mark.parametrize("sampler", ["MEDIAN_CUT", "HIERARCHY", "RESAMPLED"])
def test_unbiased_methods_agree_with_the_kdtree(lit, sampler):
    expected = scenes.render_skytree(lit, 64, sampler="KDTREE")
    picture = scenes.render_skytree(lit, 64, sampler=sampler, seed=3)
    assert picture[..., :3].mean() == pytest.approx(expected[..., :3].mean(), rel=0.005)
    assert not np.array_equal(picture, expected)


def test_candidates_count(lit):
    few = scenes.render_skytree(lit, 1, sampler="RESAMPLED", candidates=1)
    many = scenes.render_skytree(lit, 1, sampler="RESAMPLED", candidates=32)
    truth = scenes.render_skytree(lit, 256, sampler="KDTREE", seed=9)
    errors = [np.sqrt(np.mean((picture - truth)[..., :3] ** 2)) for picture in (few, many)]
    assert errors[1] < 0.8 * errors[0]


def test_filtered_is_biased_and_says_so(lit, skytree):
    image = scenes.smooth_map()
    image[12, 20:23] = 300.0
    scenes.set_map(lit, scenes.float_image("spot", image))
    truth = scenes.render_skytree(lit, 512, sampler="KDTREE")
    assert "biased" not in scenes.messages(skytree)
    blurred = scenes.render_skytree(lit, 512, sampler="FILTERED", filter_samples=4)
    assert "biased" in scenes.messages(skytree)
    sharper = scenes.render_skytree(lit, 512, sampler="FILTERED", filter_samples=512)
    bias = [np.sqrt(np.mean((picture - truth)[..., :3] ** 2)) for picture in (blurred, sharper)]
    assert bias[0] > 2 * bias[1]


def test_reports_name_the_methods(lit, tmp_path):
    options = {"samples": 4, "reference_samples": 16}
    lit.skytree.filter_samples, lit.skytree.candidates = 16, 6
    for a, b in (("filtered", "resampled"), ("median_cut", "hierarchy")):
        folder = tmp_path / a
        bpy.ops.skytree.compare_report(folder=str(folder), a=a, b=b, **options)
        results = json.loads((folder / "report.json").read_text())["results"]
        labels = {results[side]["label"] for side in "ab"}
        settings = results["a"]["sampler"]
        if a == "filtered":
            assert labels == {"filtered (biased), for 16 samples", "resampled product, 6 candidates"}
            assert settings["biased"] and settings["filter_samples"] == 16
            assert "sample_variance" not in settings
        else:
            assert labels == {"median cut 1024", "hierarchical"}
            assert settings["sample_variance"] > 0


def test_the_overlay_draws_no_samples_of_a_filter(skytree):
    environments, overlay = (scenes.part(skytree, name) for name in ("environments", "pictures.overlay"))
    image = np.ascontiguousarray(scenes.smooth_map()[..., :3], np.float32)
    shown = SimpleNamespace(show_blocks=True, opacity=1.0, show_samples=True, sample_count=16)
    for name in ("FILTERED", "HIERARCHY"):
        settings = environments.SamplerSettings(name, filter_samples=4)
        sampler = environments.make_sampler(image, settings)
        built = environments.BuiltEnvironment(image, sampler, settings, map_size=(64, 32))
        assert ("dots" in overlay.geometry(SimpleNamespace(built=built), shown)) == (name == "HIERARCHY")
