# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison without a window: error figures, sides, report files and their repeatability."""

import base64
import csv
import json
import re
import struct
import threading
import zlib

import bpy
import numpy as np
import pytest
import scenes
from scenes import part

WIDTH, HEIGHT = 48, 32


@pytest.fixture
def lit(scene):
    """The demo objects under a map with a small sun."""
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.skytree.max_bounces = 0
    scenes.demo_objects(scene)
    for mesh in bpy.data.meshes:
        # Blender 3.4 adds up smooth normals in the order in which its threads come: their last bits vary.
        mesh.polygons.foreach_set("use_smooth", [False] * len(mesh.polygons))
    image = scenes.smooth_map()
    image[8, 20] = 2000.0
    scenes.set_map(scene, scenes.float_image("sun", image))
    return scene


def reference_of(skytree, truth, noise=0.0):
    return part(skytree, "compare.metrics").Reference(truth - noise, truth + noise)


# Figures


def test_figures_of_known_images(skytree):
    metrics = part(skytree, "compare.metrics")
    truth = np.full((10, 10, 3), 2.0, np.float32)
    figures = metrics.error_figures(truth + 0.5, reference_of(skytree, truth))
    assert figures["rmse"] == pytest.approx(0.5)
    assert figures["relmse"] == pytest.approx(0.25 / (4.0 + 0.04))
    assert figures["nrmse_tc"] == pytest.approx(0.25)
    assert figures["mean_difference"] == pytest.approx(0.25)


def test_one_firefly_is_trimmed_but_counts_in_rmse(skytree):
    truth = np.ones((40, 50, 3), np.float32)
    image = truth.copy()
    image[3, 7] = 1e4
    figures = part(skytree, "compare.metrics").error_figures(image, reference_of(skytree, truth))
    assert figures["nrmse_tc"] == 0.0
    assert figures["rmse"] > 100.0


def test_the_references_own_error_is_taken_off(skytree):
    """A reference whose halves are apart by sigma has itself an error of sigma / sqrt 2 squared in all it
    judges."""
    rng = np.random.default_rng(0)
    truth = np.full((64, 64, 3), 1.0)
    halves = truth + 0.1 * rng.standard_normal((2, *truth.shape))
    image = truth + 0.05 * rng.standard_normal(truth.shape)
    metrics = part(skytree, "compare.metrics")
    figures = metrics.error_figures(image, metrics.Reference(*halves))
    assert figures["nrmse_tc"] == pytest.approx(0.05, rel=0.05)
    assert figures["rmse"] > 1.5 * figures["nrmse_tc"]


@pytest.mark.parametrize(
    ("image", "half", "words"), [((4, 4, 3), (4, 5, 3), "render both alike"), ((4, 4, 3), (4, 4, 3), "black")]
)
def test_figures_that_do_not_exist(skytree, image, half, words):
    metrics = part(skytree, "compare.metrics")
    with pytest.raises(ValueError, match=words):
        metrics.error_figures(np.zeros(image), metrics.Reference(np.zeros(half), np.zeros(half)))


def test_sampler_figures_against_sums(skytree):
    """Uniform sampling of a map with one lit texel: weight and variance follow from that texel's solid
    angle."""
    metrics = part(skytree, "compare.metrics")
    core = part(skytree, "native").core()
    image = np.zeros((16, 32, 3), np.float32)
    image[5, 9] = 3.0
    solid_angle = (np.cos(5 * np.pi / 16) - np.cos(6 * np.pi / 16)) * 2 * np.pi / 32
    figures = metrics.sampler_figures(core.UniformSampler(), image, points=1)
    assert figures["largest_weight"] == pytest.approx(4 * np.pi / solid_angle, rel=1e-4)
    assert figures["sample_variance"] == pytest.approx(4 * np.pi / solid_angle - 1, rel=1e-4)


def test_sampler_figures_stop_soon(skytree):
    metrics = part(skytree, "compare.metrics")
    image, stop, asked = np.ones((256, 512, 3), np.float32), threading.Event(), []

    class Sampler:
        def pdf(self, directions):
            asked.append(len(directions))
            stop.set()
            return np.full(len(directions), 1 / (4 * np.pi), np.float32)

    with pytest.raises(metrics.StoppedError):
        metrics.sampler_figures(Sampler(), image, 2, stop)
    assert asked == [metrics.POINTS_PER_CHUNK] and asked[0] < 4 * 256 * 512
    with pytest.raises(metrics.StoppedError):
        metrics.usable_radiance(image, stop)


def test_a_kdtree_fits_its_map_better_than_uniform(skytree):
    metrics = part(skytree, "compare.metrics")
    core = part(skytree, "native").core()
    image = scenes.smooth_map()
    image[8, 20] = 2000.0
    trees = core.KdTreeSampler(image, 256, "MIN_VARIANCE", "MIN_VARIANCE"), core.UniformSampler()
    tree, uniform = (metrics.sampler_figures(s, image) for s in trees)
    assert tree["sample_variance"] < 0.05 * uniform["sample_variance"]
    assert tree["largest_weight"] < uniform["largest_weight"]


# Sides as text


def test_method_texts(skytree):
    choice = part(skytree, "compare.job").side_choice("kdtree:256:sse:Fitted")
    method = part(skytree, "compare.methods").method_of(choice, bpy.context.scene.skytree)
    assert method.label == "kd-tree 256, SSE / fitted"
    choice = part(skytree, "compare.job").side_choice("bsdf")
    assert not part(skytree, "compare.methods").method_of(choice, None).light_sampling


@pytest.mark.parametrize("text", ["kd", "inversion:4", "kdtree:0", "kdtree:8:NONE", "kdtree:8:SSE:EXACT:1"])
def test_method_texts_that_mean_nothing(skytree, text):
    with pytest.raises(ValueError, match=re.escape(text)):
        part(skytree, "compare.job").side_choice(text)


# Files


def test_exr_layers_read_back(skytree, tmp_path):
    rng = np.random.default_rng(1)
    layers = {"A": rng.random((37, 21, 3)).astype(np.float32), "Reference": np.zeros((37, 21, 3), np.float32)}
    path = tmp_path / "layers.exr"
    part(skytree, "compare.image_files").write_exr(path, layers, {"skytree": "{}"})
    stored, attributes = read_exr(path)
    for name, layer in layers.items():
        for index, letter in enumerate("RGB"):
            assert np.array_equal(stored[f"{name}.Combined.{letter}"], layer[..., index])
    assert attributes["skytree"] == b"{}"
    image = bpy.data.images.load(str(path))
    assert tuple(image.size) == (21, 37) or image.type == "MULTILAYER"


def test_layers_of_two_sizes_are_refused(skytree, tmp_path):
    layers = {"A": np.zeros((4, 4, 3)), "B": np.zeros((4, 5, 3))}
    with pytest.raises(ValueError, match="of one size"):
        part(skytree, "compare.image_files").write_exr(tmp_path / "x.exr", layers)


def test_png_reads_back(skytree, tmp_path):
    pixels = np.random.default_rng(2).integers(0, 256, (13, 17, 3)).astype(np.uint8)
    path = tmp_path / "x.png"
    path.write_bytes(part(skytree, "compare.image_files").png_bytes(pixels))
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    stored = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(stored)
    assert np.array_equal(np.round(stored.reshape(13, 17, -1)[::-1, :, :3] * 255).astype(np.uint8), pixels)


def read_exr(path) -> tuple[dict[str, np.ndarray], dict[str, bytes]]:
    """Channels and attributes of a single-part float EXR with ZIP compression, read by the format's
    description."""
    data = path.read_bytes()
    assert struct.unpack_from("<i", data)[0] == 20000630
    at, attributes = 8, {}
    while data[at]:
        end = data.index(b"\0", at)
        name, at = data[at:end].decode(), end + 1
        at = data.index(b"\0", at) + 1
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name], at = data[at + 4 : at + 4 + size], at + 4 + size
    at += 1
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    names = [
        n.decode()
        for n in re.findall(rb"([^\0]+)\0\x02\0\0\0\0\0\0\0\x01\0\0\0\x01\0\0\0", attributes["channels"])
    ]
    blocks = -(-height // 16)
    planes = np.empty((height, len(names), width), np.float32)
    for offset in struct.unpack_from(f"<{blocks}Q", data, at):
        y, size = struct.unpack_from("<ii", data, offset)
        lines = min(16, height - y)
        raw = data[offset + 8 : offset + 8 + size]
        if size < 4 * lines * len(names) * width:
            coded = np.frombuffer(zlib.decompress(raw), np.uint8).astype(np.int64)
            coded[1:] -= 128
            split = (np.cumsum(coded) % 256).astype(np.uint8)
            half = (len(split) + 1) // 2
            merged = np.empty_like(split)
            merged[0::2], merged[1::2] = split[:half], split[half:]
            raw = merged.tobytes()
        planes[y : y + lines] = np.frombuffer(raw, "<f4").reshape(lines, len(names), width)
    return {name: planes[:, i] for i, name in enumerate(names)}, attributes


# Reports


def report(tmp_path, name="report", **options):
    folder = tmp_path / name
    defaults = {"a": "kdtree", "b": "uniform", "samples": 8, "reference_samples": 64}
    assert bpy.ops.skytree.compare_report(folder=str(folder), **{**defaults, **options}) == {"FINISHED"}
    return folder


def test_report_is_complete_and_tells_what_it_compares(lit, tmp_path):
    lit.skytree.seed = 5
    folder = report(tmp_path)
    document = json.loads((folder / "report.json").read_text())
    assert document["settings"]["seed"] == 5
    assert document["settings"]["resolution"] == f"{WIDTH} x {HEIGHT}"
    assert document["machine"]["blender"] == bpy.app.version_string
    assert document["results"]["a"]["sampler"]["method"] == "KDTREE"
    assert [row["samples"] for row in document["results"]["b"]["convergence"]] == [1, 2, 4, 8]
    errors = {key: document["results"][key]["errors"]["nrmse_tc"] for key in "ab"}
    assert errors["a"] < 0.5 * errors["b"], "the kd-tree does not beat uniform sampling under a small sun"

    with open(folder / "convergence.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert float(rows[3]["nrmse_tc"]) == document["results"]["a"]["errors"]["nrmse_tc"]

    layers, attributes = read_exr(folder / "comparison.exr")
    a, truth = layers["A.Combined.G"], layers["Reference.Combined.G"]
    assert a.shape == (HEIGHT, WIDTH)
    assert np.array_equal(layers["Difference_A.Combined.G"], a - truth)
    assert json.loads(attributes["skytree"])["settings"] == document["settings"]


def test_the_page_needs_nothing_else(lit, tmp_path):
    lit.name = "<b>Scene & more"
    folder = report(tmp_path)
    page = (folder / "report.html").read_text()
    assert "&lt;b&gt;Scene &amp; more" in page and "<b>Scene" not in page
    markup, script = page.split("<script>")
    sources = re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?([^"\')\s>]+)', markup)
    assert sources and all(source.startswith("data:image/png;base64,") for source in sources)
    assert not re.search(r"fetch|import|XMLHttp", script)
    assert "http://" not in page and "https://" not in page and "<!--title-->" not in page
    for name in ("a", "b", "reference", "difference_a", "difference_b", "difference_ab"):
        embedded = re.search(rf'id="{name}" [^>]*base64,([^"]+)"', page)[1]
        assert base64.b64decode(embedded) == (folder / f"{name}.png").read_bytes()


def test_a_report_repeats_to_the_bit(lit, tmp_path):
    lit.render.threads_mode = "FIXED"
    folders = []
    for threads in (1, 3):
        lit.render.threads = threads
        folders.append(report(tmp_path, f"threads{threads}"))
    for name in ("a.png", "b.png", "reference.png", "difference_ab.png", "comparison.exr"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name
    documents = [json.loads((folder / "report.json").read_text()) for folder in folders]
    for document in documents:
        assert document.pop("times")["a"][-1]["device_seconds"] > 0
    assert documents[0] == documents[1]


def test_equal_time_is_repeated_by_its_samples(lit, tmp_path):
    folder = report(tmp_path, "time", samples=0, seconds=0.02)
    results = json.loads((folder / "report.json").read_text())["results"]
    samples = results["a"]["samples"]
    assert samples >= 1
    again = report(tmp_path, "again", samples=samples)
    assert json.loads((again / "report.json").read_text())["results"]["a"]["errors"] == results["a"]["errors"]


def test_all_methods_converge_to_the_same_picture(lit, tmp_path):
    """Means of methods that sample differently agree within noise: none is biased."""
    image = scenes.smooth_map()  # without a sun: uniform and BSDF sampling converge as well
    scenes.set_map(lit, scenes.float_image("smooth", image))
    for method in ("kdtree:64:SSE:FITTED", "inversion", "alias", "uniform", "bsdf"):
        folder = report(
            tmp_path, method.replace(":", "_"), a=method, b="kdtree", samples=64, reference_samples=256
        )
        errors = json.loads((folder / "report.json").read_text())["results"]["a"]["errors"]
        assert abs(errors["mean_difference"]) < 0.003, method


def test_reports_that_cannot_be_made(lit, tmp_path):
    lit.skytree_compare.a.method = "REFERENCE"
    with pytest.raises(RuntimeError, match="renders its own reference"):
        bpy.ops.skytree.compare_report(folder=str(tmp_path), b="kdtree")
    with pytest.raises(RuntimeError, match="is no method"):
        bpy.ops.skytree.compare_report(folder=str(tmp_path), a="median", b="kdtree")
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(RuntimeError, match="file"):
        bpy.ops.skytree.compare_report(folder=str(blocked), a="kdtree", samples=1, reference_samples=2)
    scenes.world_tree(lit)[1].inputs["Color"].default_value = (0, 0, 0, 1)
    with pytest.raises(RuntimeError, match="black"):
        bpy.ops.skytree.compare_report(folder=str(tmp_path), a="kdtree", samples=1, reference_samples=2)


def test_a_report_shows_what_a_final_render_shows(lit, tmp_path):
    """Hidden in renders: not there. Hidden in the viewport alone: there. The file stays as it was."""
    with_both = tmp_path / "both", tmp_path / "without"
    lit.render.engine = "CYCLES"
    bpy.data.objects["Sphere"].hide_viewport = True
    for folder in with_both:
        report(tmp_path, folder.name, samples=4)
        bpy.data.objects["Sphere"].hide_render = True
    assert lit.render.engine == "CYCLES"
    both, without = (read_exr(folder / "comparison.exr")[0]["Reference.Combined.R"] for folder in with_both)
    left, right = (np.abs(both - without)[:, half].mean() for half in (slice(24), slice(24, 48)))
    assert left > 5.0 * right, "the left sphere was not in the first report or is in the second"


def test_the_command_line(skytree, lit, tmp_path, capsys):
    main = part(skytree, "compare.cli").main
    out = tmp_path / "cli"
    arguments = [
        "--a",
        "kdtree:64",
        "--b",
        "alias",
        "--samples",
        "2",
        "--reference-samples",
        "8",
        "--seed",
        "3",
    ]
    assert main([*arguments, "--size", "20x10", "--out", str(out)]) == 0
    document = json.loads((out / "report.json").read_text())
    assert document["settings"]["resolution"] == "20 x 10" and document["settings"]["seed"] == 3
    assert str(out / "report.html") in capsys.readouterr().out
    assert main(["--a", "nothing", "--out", str(out)]) == 1
    assert "no method" in capsys.readouterr().err


def test_view_transform_of_known_values(skytree, scene):
    display = part(skytree, "viewport.display")
    scene.view_settings.view_transform = "Standard"
    linear = np.zeros((2, 3, 3), np.float32)
    linear[0], linear[1] = (0.0, 0.21404, 1.0), 4.0
    to_bytes, name = display.view_of(scene)
    shown = to_bytes(linear)
    assert name.startswith("Standard")
    assert abs(shown[0, 0].astype(int) - (0, 127, 255)).max() <= 1
    assert (shown[1] == 255).all()
    assert scene.render.image_settings.file_format == "OPEN_EXR", (
        "the scene's image settings were not restored"
    )
