# SPDX-License-Identifier: GPL-3.0-or-later
"""The comparison and the overlay drawn offscreen."""

from types import SimpleNamespace

import numpy as np
import pytest
from mathutils import Matrix
from scenes import part
from test_gpu_draw import HEIGHT, WIDTH, drawn, noise  # noqa: F401 (drawn is a fixture)

KDTREE, UNIFORM = (0.2, 0.4, 0.6), (0.8, 0.1, 0.3)


@pytest.fixture
def comparison(skytree):
    """A view whose pictures A and B are of one colour each, without any session."""
    view_module, methods = part(skytree, "compare.view"), part(skytree, "compare.methods")
    settings = part(skytree, "environments").SamplerSettings
    picture, view_of = part(skytree, "viewport.renderer").Picture, part(skytree, "viewport.view").View
    view = view_of((0.0,) * 16, (0.0,) * 16, WIDTH, HEIGHT)
    sides = {}
    for name, method, color in (("a", "KDTREE", KDTREE), ("b", "UNIFORM", UNIFORM)):
        pixels = np.ones((HEIGHT, WIDTH, 4), np.float32)
        pixels[..., :3] = color
        method = methods.Method(settings(method))
        sides[name] = view_module.Side(method, picture=picture(pixels, view, 1, 64, 0.5), seconds=0.5)
    return SimpleNamespace(
        sides=sides, request=SimpleNamespace(view=view), problem="", capture=None, captured=None,
        reference_is_stale=False,
    )  # fmt: skip


def colors_of(image, columns):
    return np.unique(image[:, columns, :3].reshape(-1, 3).round(2), axis=0).tolist()


@pytest.mark.parametrize(
    ("mode", "show_b", "left", "right"),
    [
        ("SPLIT", False, KDTREE, UNIFORM),
        ("SIDE", False, KDTREE, UNIFORM),
        ("FLIP", False, KDTREE, KDTREE),
        ("FLIP", True, UNIFORM, UNIFORM),
        ("DIFFERENCE", False, (1.2, 0.6, 0.6), (1.2, 0.6, 0.6)),
    ],
)
def test_arrangements(skytree, drawn, comparison, mode, show_b, left, right):  # noqa: F811
    draw = part(skytree, "compare.draw").draw_pictures
    image = drawn(lambda: draw(comparison, mode, 0.25, show_b, 2.0))
    line = WIDTH // 4 if mode == "SPLIT" else WIDTH // 2
    assert np.allclose(colors_of(image, slice(0, line)), [left], atol=0.01)
    assert np.allclose(colors_of(image, slice(line, WIDTH)), [right], atol=0.01)


def test_the_difference_is_absolute(skytree, drawn, comparison):  # noqa: F811
    gpu_draw, compare_draw = part(skytree, "viewport.gpu_draw"), part(skytree, "compare.draw")
    a, b = noise(HEIGHT, WIDTH, 1), noise(HEIGHT, WIDTH, 2)

    def draw():
        compare_draw.draw_difference(gpu_draw.upload(a), gpu_draw.upload(b), 0, 0, WIDTH, HEIGHT, 3.0)

    assert np.allclose(drawn(draw)[..., :3], 3.0 * np.abs(a - b)[..., :3], atol=5e-3)


def test_names_line_and_plot_are_drawn_over_it(skytree, drawn, comparison):  # noqa: F811
    """The white line stands where the split is; a plot appears with the first measurements."""
    labels, plot = part(skytree, "compare.labels"), part(skytree, "compare.plot")
    report = part(skytree, "compare.report")
    compared = SimpleNamespace(
        mode="SPLIT",
        split=0.5,
        show_b=False,
        show_figures=True,
        show_plot=True,
        plot_axis="SAMPLES",
        gain=1.0,
    )

    def draw(free=(0, 0, 700, 400)):  # names above the picture, the plot's corner in it
        labels.draw_over(comparison, compared, free)

    line = drawn(lambda: draw((1000, 1000, 260, 400)))[3, :, :3].min(axis=1)
    assert line[WIDTH // 2 - 1 : WIDTH // 2 + 1].min() > 0.8 and line[: WIDTH // 2 - 2].max() == 0.0
    compared.show_figures = False
    bare = drawn(draw)
    compared.show_figures = True
    for name, side in comparison.sides.items():
        factor = {"a": 1.0, "b": 2.0}[name]
        side.steps = [
            report.Step(n, dict.fromkeys(report.ERROR_FIELDS, factor * n**-0.5), n * 0.1, n * 0.2)
            for n in (1, 2, 4)
        ]
    assert plot.curve_of(comparison.sides["a"], "SAMPLES")[2] == pytest.approx((0.60206, -0.60206))
    assert plot.curve_of(comparison.sides["a"], "TIME")[0] == pytest.approx((-1.0, 0.0))
    lines = labels.side_lines(comparison, "b", with_figures=True)
    assert lines[0] == "B  uniform" and lines[1] == "64 spp   500 ms"
    assert any("efficiency 5" in line for line in labels.side_lines(comparison, "a", True)), lines
    assert np.abs(drawn(draw) - bare).mean() > 0.01


def test_the_overlay_lies_on_the_sphere(skytree, drawn, scene):  # noqa: F811
    """Seen along +Y at the unit sphere, a block of half the map covers half of the picture."""
    overlay, environments = part(skytree, "pictures.overlay"), part(skytree, "environments")
    half = np.array([[16, 0, 48, 16]], np.int32)  # columns about u = 1/2: the half with x > 0
    sampler = SimpleNamespace(bounds=half, probabilities=np.array([1.0]))
    built = environments.BuiltEnvironment(
        np.ones((16, 64, 3), np.float32), sampler, environments.SamplerSettings(), "map", (64, 16)
    )
    current = SimpleNamespace(built=built, key=("half",))
    scene.skytree_overlay.show_blocks, scene.skytree_overlay.opacity = True, 1.0
    look_along_y = Matrix(((1, 0, 0, 0), (0, 0, 1, 0), (0, -1, 0, 0), (0, 0, 0, 1)))
    to_pixels = Matrix.Diagonal((WIDTH / 2, HEIGHT / 2, 0.001, 1.0))
    to_pixels.translation = (WIDTH / 2, HEIGHT / 2, 0.0)
    image = drawn(lambda: overlay.draw(current, scene.skytree_overlay, to_pixels @ look_along_y))
    covered = image[..., :3].max(axis=2) > 0.05
    middle = covered[HEIGHT // 2 - 8 : HEIGHT // 2 + 8]
    assert middle[:, WIDTH // 2 + 2 : WIDTH - 8].all()
    assert not middle[:, 8 : WIDTH // 2 - 2].any()
