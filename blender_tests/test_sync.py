# SPDX-License-Identifier: GPL-3.0-or-later
"""What is sent to the native scene again after a change: only what changed."""

import shutil

import bpy
import numpy as np
import pytest
import scenes
from mathutils import Matrix


class Live:
    """A SceneSync that follows a depsgraph as a viewport does, through Blender's own update handler."""

    def __init__(self, skytree):
        self.sync = scenes.part(skytree, "sync.scene").SceneSync()
        self.depsgraph = bpy.context.evaluated_depsgraph_get()
        self.sync.sync(self.depsgraph)

    def changes(self, action) -> dict:
        """Uploads that an edit causes, by kind."""
        before = dict(self.sync.counts)
        action()

        def follow(scene, depsgraph):
            self.sync.update(depsgraph)

        bpy.app.handlers.depsgraph_update_post.append(follow)
        try:
            bpy.context.view_layer.update()
        finally:
            bpy.app.handlers.depsgraph_update_post.remove(follow)
        after = self.sync.counts
        sent = {kind: after[kind] - before.get(kind, 0) for kind in after}
        return {kind: count for kind, count in sent.items() if count}

    def picture(self, core):
        """A render of the native scene as it stands, without another sync."""
        scene = bpy.context.scene
        depsgraph = bpy.context.evaluated_depsgraph_get()
        camera = scene.camera.evaluated_get(depsgraph)
        projection = camera.calc_matrix_camera(depsgraph, x=64, y=48)
        self.sync.set_camera(camera.matrix_world, projection)
        session = core.RenderSession()
        session.start(self.sync.scene, 64, 48, 8, max_bounces=scene.skytree.max_bounces)
        assert session.wait(60.0) and session.error is None
        return session.pixels()


@pytest.fixture
def live(scene, skytree):
    scenes.demo_objects(scene)
    scenes.set_map(scene, scenes.bundled())
    bpy.context.view_layer.update()
    follower = Live(skytree)
    yield follower
    core = scenes.part(skytree, "native").core()
    # Whatever was sent piece by piece has to show the same as all of it sent at once.
    scenes.assert_same_picture(follower.picture(core), Live(skytree).picture(core))


def sphere_of(scene):
    return next(ob for ob in scene.objects if ob.name.startswith("Sphere"))


def test_a_full_sync_counts_everything(live):
    assert live.sync.counts == {"meshes": 3, "instances": 3, "materials": 3, "environments": 1}


def test_nothing_changes_nothing(live):
    assert live.changes(lambda: None) == {}


def test_moving_sends_a_transform(live, scene):
    def move():
        sphere_of(scene).location.x += 0.5

    assert live.changes(move) == {"transforms": 1}


def test_editing_sends_one_mesh(live, scene):
    def edit():
        mesh = sphere_of(scene).data
        mesh.transform(Matrix.Scale(1.1, 4))
        mesh.update()

    assert live.changes(edit) == {"meshes": 1}


def test_material_sends_one_material(live):
    def paint():
        material = bpy.data.materials["Clay"]
        scenes.shader_node(material).inputs["Color"].default_value = (0.1, 0.9, 0.1, 1)

    assert live.changes(paint) == {"materials": 1}


def test_assigning_a_material_sends_a_reference(live, scene):
    def assign():
        sphere_of(scene).data.materials[0] = bpy.data.materials["Metal"]

    changes = live.changes(assign)
    assert changes.get("instance_materials") == 1
    assert not {"environments", "instances"} & set(changes)


def test_world_rotation_sends_no_map(live, scene, skytree):
    environments = scenes.part(skytree, "environments").environments
    builds = environments.builds

    def rotate():
        mapping = next(n for n in scene.world.node_tree.nodes if n.type == "MAPPING")
        mapping.inputs["Rotation"].default_value = (0, 0.2, 1.0)

    assert live.changes(rotate) == {"environments": 1}
    assert environments.builds == builds


def test_adding_and_removing(live, scene):
    def add():
        scenes.sphere(scene, (0, 3, 1), 0.5)

    # Without a material of its own it gets the default one.
    assert live.changes(add) == {"meshes": 1, "instances": 1, "materials": 1}

    def remove():
        bpy.data.objects.remove(sphere_of(scene))

    assert live.changes(remove) == {}
    assert live.sync.scene.stats["instances"] == 3


def test_hiding(live, scene):
    def hide():
        sphere_of(scene).hide_viewport = True

    live.changes(hide)
    assert live.sync.scene.stats["instances"] == 2


def test_undoing_a_modifier(live, scene):
    ob = sphere_of(scene)

    def add():
        ob.modifiers.new("Wave", "CAST").factor = 0.5

    def remove():
        ob.modifiers.clear()

    assert live.changes(add).get("meshes") == 1
    assert live.changes(remove).get("meshes") == 1


def test_new_frame_of_an_animation(live, scene):
    ob = sphere_of(scene)
    for frame, x in ((1, 0.0), (10, 2.0)):
        ob.location.x = x
        ob.keyframe_insert("location", frame=frame)
    live.changes(lambda: None)
    changes = live.changes(lambda: scene.frame_set(10))
    live.sync.update(bpy.context.evaluated_depsgraph_get())
    assert "meshes" not in changes


def test_image_sequence_follows_the_frame(scene, tmp_path):
    """Frame n of a sequence as the world: each frame another brightness."""
    for i in (1, 2):
        image = scenes.float_image(f"frame{i}", np.full((4, 8, 3), 0.25 * i, np.float32))
        shutil.copy(bpy.path.abspath(image.filepath), tmp_path / f"seq.000{i}.exr")
    texture, _ = scenes.set_map(scene, tmp_path / "seq.0001.exr")
    texture.image.source = "SEQUENCE"
    texture.image_user.frame_duration, texture.image_user.frame_start = 2, 1
    texture.image_user.frame_offset, texture.image_user.use_auto_refresh = 0, True
    seen = []
    for frame in (1, 2):
        scene.frame_set(frame)
        seen.append(scenes.render_skytree(scene, 1)[0, 0, 0])
    np.testing.assert_allclose(seen, (0.25, 0.5), rtol=1e-3)


def test_packed_and_generated_maps(scene):
    path = bpy.path.abspath(scenes.float_image("packme", np.full((4, 8, 3), 0.7, np.float32)).filepath)
    packed = bpy.data.images.load(path)
    packed.pack()
    packed.filepath = "//nowhere.exr"
    scenes.set_map(scene, packed)
    np.testing.assert_allclose(scenes.render_skytree(scene, 1)[..., :3], 0.7, rtol=1e-3)

    generated = bpy.data.images.new("generated", 8, 4, float_buffer=True)
    generated.pixels.foreach_set(np.tile(np.array([0.3, 0.4, 0.5, 1.0], np.float32), 32))
    scenes.set_map(scene, generated)
    np.testing.assert_allclose(scenes.render_skytree(scene, 1)[0, 0, :3], (0.3, 0.4, 0.5), rtol=1e-3)
    # Painting on it shows at once, although no file changed.
    generated.pixels.foreach_set(np.tile(np.array([0.6, 0.2, 0.1, 1.0], np.float32), 32))
    np.testing.assert_allclose(scenes.render_skytree(scene, 1)[0, 0, :3], (0.6, 0.2, 0.1), rtol=1e-3)


def test_byte_map_is_decoded(cycles):
    from test_world import assert_same_picture

    image = bpy.data.images.new("bytes", 64, 32)
    rgba = np.ones((32, 64, 4), np.float32)
    rgba[..., :3] = scenes.smooth_map()[::-1] * 0.3
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    scenes.set_map(cycles, image)
    assert_same_picture(cycles, tolerance=0.05)
