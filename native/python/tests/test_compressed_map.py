# SPDX-License-Identifier: GPL-3.0-or-later
"""CompressedMap for numpy: files, messages, light; what a file's bytes may be is tested in C++."""

import numpy as np
import pytest
import skytree_core


@pytest.fixture
def image():
    rows, columns = np.mgrid[0:64, 0:128]
    sky = 1.0 + np.sin(columns / 9) * np.cos(rows / 7)
    sky[10:13, 20:23] = 400.0
    return (sky[..., None] * np.array([1.0, 0.8, 0.5])).astype(np.float32)


def test_a_saved_map_comes_back_bit_for_bit(image, tmp_path):
    made = skytree_core.CompressedMap(image, 4096)
    file = tmp_path / "sky.skymap"
    made.save(file)
    assert file.stat().st_size == made.nbytes <= 4096
    assert [entry.name for entry in tmp_path.iterdir()] == ["sky.skymap"]
    loaded = skytree_core.CompressedMap.load(str(file))
    assert (loaded.width, loaded.height, loaded.block_count) == (128, 64, made.block_count)
    np.testing.assert_array_equal(loaded.image(), made.image())
    np.testing.assert_array_equal(loaded.bounds, made.bounds)
    np.testing.assert_array_equal(skytree_core.read_image(file), made.image())
    assert loaded.to_bytes() == file.read_bytes()


@pytest.mark.parametrize("criterion", ["RANGE", "VARIANCE", "SSE", "MIN_VARIANCE"])
def test_blocks_are_those_of_the_sampler_at_their_mean(image, criterion):
    made = skytree_core.CompressedMap(image, split_criterion=criterion, max_blocks=200)
    tree = skytree_core.KdTreeSampler(image, 200, criterion, "EXACT")
    np.testing.assert_array_equal(made.bounds, tree.bounds)
    np.testing.assert_allclose(made.image(), tree.reconstruct(), rtol=0.0021, atol=2e-3)


def test_light_of_the_blocks_is_the_light_of_the_map(image):
    made = skytree_core.CompressedMap(image, 2048)
    solid = np.sin((np.arange(64) + 0.5) * np.pi / 64)[:, None, None]
    np.testing.assert_allclose((made.image() * solid).sum((0, 1)), (image * solid).sum((0, 1)), rtol=2e-3)


def test_messages_name_file_cause_and_remedy(image, tmp_path):
    load = skytree_core.CompressedMap.load
    with pytest.raises(FileNotFoundError, match="missing.skymap"):
        load(tmp_path / "missing.skymap")
    with pytest.raises(OSError):
        load(tmp_path)
    file = tmp_path / "sky.skymap"
    skytree_core.CompressedMap(image, 2048).save(file)
    good = file.read_bytes()
    for data, cause in (
        (b"#?RADIANCE\n" + good, "sky.skymap: not a compressed map"),
        (good[:-100], "sky.skymap: cut short: .*copy it again"),
        (
            good[:-1] + bytes([good[-1] ^ 4]),
            "sky.skymap: damaged: the checksum does not match; copy it again",
        ),
    ):
        file.write_bytes(data)
        with pytest.raises(ValueError, match=cause):
            load(file)
    with pytest.raises(ValueError, match="cut short"):
        skytree_core.CompressedMap.from_bytes(good[:100])
    with pytest.raises(ValueError, match="max_bytes is 3"):
        skytree_core.CompressedMap(image, 3)
    with pytest.raises(ValueError, match="split_criterion"):
        skytree_core.CompressedMap(image, 2048, "SEE")
    with pytest.raises(OSError, match="nowhere"):
        skytree_core.CompressedMap(image, 2048).save(tmp_path / "nowhere" / "sky.skymap")


def test_alpha_by_each_objective():
    shares = 1.0 / (np.arange(64) + 3.0) ** 1.4
    fits = {
        name: skytree_core.fit_rank_model(shares, name)
        for name in ("LEAST_SQUARES", "LIKELIHOOD", "SECOND_MOMENT")
    }
    assert min(fits, key=lambda name: fits[name].rms_error) == "LEAST_SQUARES"
    assert min(fits, key=lambda name: fits[name].kl_divergence) == "LIKELIHOOD"
    assert min(fits, key=lambda name: fits[name].second_moment) == "SECOND_MOMENT"
    model = skytree_core.rank_probabilities(fits["LIKELIHOOD"].alpha, 64)
    assert model.sum() == pytest.approx(1)
    assert fits["LIKELIHOOD"].largest_ratio == pytest.approx((shares / shares.sum() / model).max())
    for wrong in (np.array([]), np.array([-1.0, 2.0]), np.zeros(3), np.array([np.nan])):
        with pytest.raises(ValueError):
            skytree_core.fit_rank_model(wrong)


def test_the_sampler_takes_the_objective(image):
    trees = {
        name: skytree_core.KdTreeSampler(image, 128, alpha_objective=name)
        for name in ("LEAST_SQUARES", "LIKELIHOOD")
    }
    assert trees["LIKELIHOOD"].kl_divergence <= trees["LEAST_SQUARES"].kl_divergence
    assert trees["LIKELIHOOD"].alpha != trees["LEAST_SQUARES"].alpha
