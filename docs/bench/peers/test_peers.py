# SPDX-License-Identifier: GPL-3.0-or-later
"""Does the instrument measure what it says? Metrics and arithmetic on made-up images and times; and, where
Blender 4.5 and Mitsuba are in build/, that both see one scene. About ten seconds."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent), str(HERE.parents[1] / "demo")]
import benchmarks_page  # noqa: E402
import cases  # noqa: E402
import figures  # noqa: E402
import measuring  # noqa: E402
import peers_page  # noqa: E402
from analysis import Result, disagrees, promises  # noqa: E402
from metrics import error_figures  # noqa: E402

RNG = np.random.default_rng(3)
TRUTH = 0.2 + RNG.random((96, 128, 3))


def noisy(deviation: float) -> np.ndarray:
    return TRUTH + deviation * RNG.standard_normal(TRUTH.shape)


def test_reference_noise_is_subtracted():
    # Each half has the image's own noise: uncorrected, the error would be 22 % too large.
    found = error_figures(noisy(0.05), noisy(0.05), noisy(0.05))
    assert found["nrmse_tc"] == pytest.approx(0.05 / TRUTH.mean(), rel=0.03)
    expected = 0.05**2 * (1 / (TRUTH**2 + 0.01 * TRUTH.mean() ** 2)).mean()
    assert found["relmse_tc"] == pytest.approx(expected, rel=0.1)  # uncorrected: 1.5 times that


def test_a_firefly_in_the_reference_does_not_rule_the_figure():
    halves = [noisy(0.02), noisy(0.02)]
    halves[0][5:8, 5:9] += 60.0
    found = [measuring.image_figures(noisy(0.1), halves)["nrmse_tc"] for _ in range(4)]
    assert found == pytest.approx([0.1 / TRUTH.mean()] * 4, rel=0.05)


def test_a_reference_is_outdated_by_another_mean_or_by_fireflies():
    image, halves = noisy(0.1), [noisy(0.03), noisy(0.03)]
    assert not measuring.is_outdated(image, halves)
    assert measuring.is_outdated(1.01 * image, halves)
    halves[1][40, 30:33] += 20.0
    assert measuring.is_outdated(image, halves)


def test_flip_is_none_for_the_same_image_and_grows_with_noise():
    quiet, loud = (measuring.flip_error(noisy(d), TRUTH) for d in (0.02, 0.2))
    assert measuring.flip_error(TRUTH, TRUTH) == 0
    assert 0 < quiet < loud / 2 < 0.5


def test_standard_error_of_a_mean_is_what_repetition_shows():
    found = [measuring.mean_and_error([noisy(0.3), noisy(0.3)]) for _ in range(40)]
    assert np.std([f["mean"] for f in found]) == pytest.approx(found[0]["standard_error"], rel=0.35)


def made_up(slope: float = 0.5, faster: float = 1.0, mean: float = 1.0) -> Result:
    """Every method has the error N^-slope and 2 µs a sample after half a second; Skytree is faster."""
    methods = {}
    for name, method in cases.METHODS.items():
        time = 2.0 / (faster if method.engine == "SKYTREE" else 1)
        seconds = {n: [0.5 + 1e-6 * time * n * cases.WIDTH * cases.HEIGHT] * 4 for n in cases.SAMPLES}
        values = {n: n**-slope for n in cases.SAMPLES}
        figures_of = {
            str(n): [dict.fromkeys(measuring.FIGURES, v) | {"nrmse_tc": v * f} for f in (0.9, 1.1, 0.9, 1.1)]
            for n, v in values.items()
        }
        methods[name] = {"cpu_seconds": seconds, "figures": figures_of}
    references = {e: {"mean": 1.0, "standard_error": 1e-4} for e in cases.REFERENCES}
    references["SKYTREE"]["mean"] = mean
    return Result.read(
        {
            "case": {"scene": "spheres", "map": "city", "bounces": 0},
            "references": references,
            "methods": methods,
        }
    )


def test_time_is_without_start_up_and_efficiency_is_its_inverse_by_error_squared():
    result = made_up(faster=4)
    assert result.microseconds("Cycles") == pytest.approx(2)
    assert result.efficiency("Cycles", 16) == pytest.approx(1 / (16**-1 * 16 * 2))
    for samples in (4, 16, 64):
        assert result.over_best_peer("Skytree, best", samples) == pytest.approx(4)


def test_an_error_below_the_reference_counts_as_falling_like_1_over_n():
    result = made_up()
    for figures_of in result.methods["Skytree, best"]["figures"][64]:
        figures_of["nrmse_tc"] = 0.0
    assert result.error("Skytree, best", 64) == pytest.approx(16**-0.5 / 4)
    assert result.over_best_peer("Skytree, best", 64) == pytest.approx(4)


def test_error_at_equal_time_lies_on_the_line_of_the_logarithms():
    result = made_up(faster=4)
    error, inside = result.error_at_time("Skytree, best", result.common_time())
    assert inside and error == pytest.approx(64**-0.5)  # 16 samples of 2 µs are 64 of 0.5 µs
    error, inside = result.error_at_time("Cycles", 2 * 100)
    assert not inside and error == pytest.approx(0.1)


def test_a_wrong_mean_is_told():
    right, wrong = made_up(), made_up(mean=1.01)
    assert not disagrees(*right.mean_differences()["SKYTREE/CYCLES"])
    assert disagrees(*wrong.mean_differences()["SKYTREE/CYCLES"])
    text = peers_page.section([wrong], {e: e for e in cases.REFERENCES}, "images/peers")
    assert "SKYTREE/CYCLES spheres-city-0: +1.00 %" in text


def test_a_promise_is_kept_only_where_every_sample_count_keeps_it(tmp_path):
    kept = {p.text: p.kept for p in promises([made_up(faster=5.1)])}
    assert kept["direct light, over the best peer of each case: median"]
    assert not kept["direct light, over Cycles: median"]
    assert all(f.stat().st_size > 10000 for f in figures.draw([made_up(), made_up()], tmp_path, "peers"))


def test_settings_and_cases_of_a_trial():
    import peers

    assert peers.parse_settings(["compensation=0.5", "sampler=ALIAS", "blue_noise=true"]) == {
        **{"compensation": 0.5, "sampler": "ALIAS", "blue_noise": True}
    }
    assert {c.scene for c in peers.chosen_cases(False, "room-")} == {"room"}
    for wrong in (
        lambda: peers.parse_settings(["compensation"]),
        lambda: peers.chosen_cases(True, "kitchen"),
    ):
        with pytest.raises(peers.DemoError):
            wrong()


def test_the_page_keeps_the_sections_of_the_other_benchmarks():
    old = "# Benchmarks\n\nHead.\n\n## A\n\nold\n\n## B\n\nkeep\n"
    assert benchmarks_page.merged(old, "## A\n\nnew\n\n## C\n\nmore\n") == (
        "# Benchmarks\n\nHead.\n\n## A\n\nnew\n\n## B\n\nkeep\n\n## C\n\nmore\n"
    )


def test_mitsuba_and_blender_see_the_same_scene(tmp_path, monkeypatch):
    """Texture, anisotropy, camera and map: a mirrored or turned one changes pixels by far more than noise."""
    import peers
    import stores

    archives = list((peers.ROOT / "dist").glob("skytree-*.zip"))
    if not (peers.BLENDER.exists() and peers.MITSUBA.exists() and archives):
        pytest.skip("needs build/bpy-4.5, build/venv-mitsuba and dist/skytree-*.zip")
    sys.path.insert(0, str(peers.ROOT / ".ci"))
    from skytree_build.environments import find_llvm

    monkeypatch.setattr(peers, "CACHE", tmp_path)
    monkeypatch.setattr(stores, "WIDTH", 48)
    monkeypatch.setattr(stores, "HEIGHT", 36)
    with peers.open_renderers(archives[0], "", str(find_llvm() or "")) as renderers:
        for scene in ("suzanne", "aniso"):
            case = cases.Case(scene, "city")
            renderers.open(case, peers.bundled_map(peers.BLENDER, "city.exr"))
            ours, theirs = (
                renderers.render(case, m, n, 1)[0]
                for m, n in (("Skytree, best", 256), ("Mitsuba, multijitter", 256))
            )
            assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01), scene
            assert np.median(abs(ours - theirs) / theirs) < 0.02, scene
