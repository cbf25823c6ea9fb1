# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings, panels and presets, and that nothing stays behind when the add-on is disabled."""

import threading
import types

import bpy
import pytest
import scenes

TEACHING = ("MEDIAN_CUT", "HIERARCHY", "RESAMPLED", "FILTERED")
FIXED_SETTINGS = {
    "samples": 64,
    "preview_samples": 256,
    "max_bounces": 4,
    "seed": 0,
    "device": "CPU",
    "sampler": "KDTREE",
    "block_count": 1024,
    "split_criterion": "MIN_VARIANCE",
    "block_probability": "MIN_VARIANCE",
    "auto_blocks": False,
    "compensation": 0.5,
    "pixel_filter": "BLACKMAN_HARRIS",
    "filter_width": 1.5,
    "light_rays": 0,
    "control_variate": True,
    "product_sampling": True,
    "learn_visibility": True,
    "adaptive_sampling": True,
    "point_set": "SOBOL",
}


def test_settings_exist_with_their_defaults(skytree):
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    settings = bpy.context.scene.skytree
    assert {name: getattr(settings, name) for name in FIXED_SETTINGS} == FIXED_SETTINGS


@pytest.mark.parametrize(
    "name, values",
    [
        ("device", ["CPU", "CUDA"]),
        ("sampler", ["KDTREE", "INVERSION", "ALIAS", "UNIFORM", *TEACHING]),
        ("split_criterion", ["RANGE", "VARIANCE", "SSE", "MIN_VARIANCE"]),
        ("block_probability", ["FITTED", "EXACT", "MIN_VARIANCE"]),
        ("pixel_filter", ["BOX", "GAUSSIAN", "BLACKMAN_HARRIS"]),
        ("point_set", ["SOBOL", "CMJ"]),
    ],
)
def test_choices(scene, name, values):
    items = scene.skytree.bl_rna.properties[name].enum_items
    assert [item.identifier for item in items] == values
    for value in values:
        setattr(scene.skytree, name, value)
        assert getattr(scene.skytree, name) == value


def test_every_setting_has_a_tooltip(scene):
    material = bpy.data.materials.new("M")
    for group in (scene.skytree, material.skytree):
        for prop in group.bl_rna.properties:
            if prop.identifier not in {"rna_type", "name"}:
                assert len(prop.description) > 10, prop.identifier


def test_presets(scene):
    settings = scene.skytree
    bpy.ops.skytree.apply_preset(preset="PAPER")
    assert (settings.sampler, settings.split_criterion, settings.block_probability) == (
        "KDTREE",
        "SSE",
        "FITTED",
    )
    bpy.ops.skytree.apply_preset(preset="INVERSION")
    assert settings.sampler == "INVERSION"
    bpy.ops.skytree.apply_preset(preset="BEST")
    for name in ("sampler", "block_count", "split_criterion", "block_probability", "pixel_filter"):
        assert getattr(settings, name) == FIXED_SETTINGS[name]


def test_settings_are_saved_with_the_scene(scene, tmp_path):
    scene.skytree.samples, scene.skytree.sampler = 77, "ALIAS"
    material = bpy.data.materials.new("Ward")
    material.use_fake_user = True
    material.skytree.use_ward, material.skytree.ward_alpha_y = True, 0.25
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert bpy.context.scene.skytree.samples == 77
    assert bpy.context.scene.skytree.sampler == "ALIAS"
    assert bpy.data.materials["Ward"].skytree.ward_alpha_y == 0.25


class Layout:
    """Stands in for a layout: records what a panel draws, and refuses properties that do not exist."""

    def __init__(self, drawn):
        self.drawn = drawn

    def prop(self, data, name, **_):
        assert hasattr(data, name), name
        self.drawn.append(name)

    def label(self, text="", **_):
        self.drawn.append(text)

    def operator(self, identifier, **_):
        module, name = identifier.split(".")
        assert hasattr(getattr(bpy.ops, module), name)
        self.drawn.append(identifier)
        return types.SimpleNamespace()

    def popover(self, panel, **_):
        assert hasattr(bpy.types, panel), panel

    def menu(self, menu, **_):
        self.drawn.append(menu)

    def __getattr__(self, name):
        return lambda *args, **kwargs: Layout(self.drawn)


def panels(skytree):
    return [cls for cls in scenes.part(skytree, "panels").CLASSES if issubclass(cls, bpy.types.Panel)]


def test_panels_draw(scene, skytree):
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled())
    scenes.render_skytree(scene, 1)
    drawn = []
    context = types.SimpleNamespace(
        scene=scene, world=scene.world, engine="SKYTREE", material=bpy.data.materials["Clay"],
        region=None, area=None, space_data=None, preferences=bpy.context.preferences,
        window_manager=bpy.context.window_manager, view_layer=bpy.context.view_layer,
    )  # fmt: skip
    for cls in panels(skytree):
        if not cls.poll(context):
            continue
        stand_in = types.SimpleNamespace(layout=Layout(drawn), bl_label=cls.bl_label)
        for method in ("draw_header", "draw_header_preset", "draw"):
            if method in vars(cls):
                vars(cls)[method](stand_in, context)
    assert set(FIXED_SETTINGS) <= set(drawn)
    assert {"film_transparent", "threads_mode", "use_ward", "use_table"} <= set(drawn)


def test_panels_show_figures_of_the_last_build(scene, skytree):
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled())
    scenes.render_skytree(scene, 1)
    rows = dict(scenes.part(skytree, "panels").figures(scenes.part(skytree, "status").last))
    assert rows["Map"] == "1024 x 512" and rows["Blocks"] == "1024"
    assert {"Alpha", "Fit error", "Memory", "Inversion tables", "Build"} <= set(rows)
    assert rows["Memory"].endswith("KB") and float(rows["Memory"].split()[0]) <= 50.0


def test_panels_belong_to_this_engine_alone(scene, skytree):
    other = types.SimpleNamespace(engine="CYCLES", scene=scene, material=None, world=scene.world)
    assert not any(cls.poll(other) for cls in panels(skytree))


def test_world_and_material_nodes_can_be_edited(skytree):
    names = [cls.__name__ for cls in bpy.types.Panel.__subclasses__()]
    for name in ("EEVEE_WORLD_PT_surface", "EEVEE_MATERIAL_PT_surface"):
        cls = getattr(bpy.types, name, None)
        assert cls is not None or name not in names
        if cls is not None:
            assert "SKYTREE" in cls.COMPAT_ENGINES


def leftovers(skytree):
    found = {name for name in dir(bpy.types) if "skytree" in name.lower()}
    found |= {f"operator {name}" for name in dir(bpy.ops.skytree)}
    for holder in (bpy.types.Scene, bpy.types.Material, bpy.types.WindowManager, bpy.types.World):
        if hasattr(holder, "skytree"):
            found.add(f"{holder.__name__}.skytree")
    for cls in subclasses(bpy.types.Panel):
        if "SKYTREE" in (getattr(cls, "COMPAT_ENGINES", None) or ()) and "SKYTREE" not in cls.__name__:
            found.add(cls.__name__)
    found |= {f"thread {t.name}" for t in threading.enumerate() if "skytree" in t.name.lower()}
    timers = bpy.app.timers
    clock, pictures = "viewport.clock", "pictures.map_pictures"
    found |= {f"timer {n}" for n in (clock, pictures) if timers.is_registered(scenes.part(skytree, n)._tick)}
    for name in dir(bpy.app.handlers):
        handlers = getattr(bpy.app.handlers, name)
        if isinstance(handlers, list):
            found |= {
                f"handler {h.__module__}" for h in handlers if "skytree" in getattr(h, "__module__", "")
            }
    return found


def own_panels(skytree):
    """All panels of the add-on that belong to its engine, in whichever module."""
    return [
        cls
        for cls in subclasses(bpy.types.Panel)
        if cls.__module__.startswith(skytree.__name__ + ".") and hasattr(cls, "COMPAT_ENGINES")
    ]


def subclasses(cls):
    for subclass in cls.__subclasses__():
        yield subclass
        yield from subclasses(subclass)


def test_enabling_ten_times_leaves_nothing(scene, skytree):
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled())
    scenes.render_skytree(scene, 1)
    scenes.part(skytree, "environments").environments.clear()  # waits for its threads
    before = leftovers(skytree)
    shown = {cls: cls.COMPAT_ENGINES for cls in own_panels(skytree)}
    for _ in range(10):
        skytree.unregister()
        assert leftovers(skytree) == set()
        skytree.register()
        assert leftovers(skytree) == before
        assert all("SKYTREE" in engines for engines in shown.values()), "a panel is never shown again"
    assert not scenes.part(skytree, "environments").environments.sizes()["maps"], "a map stayed in memory"
    bpy.context.scene.render.engine = "SKYTREE"
    assert scenes.render_skytree(bpy.context.scene, 1)[..., :3].max() > 0.0
