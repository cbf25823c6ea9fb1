# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender as a process of its own: it ends, and its own libraries do not get into the core's way."""

import os
import subprocess
import sys
from pathlib import Path

import bpy
import pytest
import scenes

SCRIPT = """
import importlib, sys
sys.path.insert(0, {tests!r})
import bpy
import installing
module = installing.install()
import scenes
scene = scenes.new_scene(32, 24)
scenes.demo_objects(scene)
scenes.set_map(scene, scenes.bundled())
picture = scenes.render_skytree(scene, 16, seed=3)
core = importlib.import_module(module.__name__ + ".native").core()
import numpy
sampler = core.KdTreeSampler(numpy.arange(1, 32 * 64 * 3 + 1, dtype=numpy.float32).reshape(32, 64, 3), 64)
print("RESULT", repr(float(picture[..., :3].mean())), repr(float(sampler.alpha)), flush=True)
"""


def result_of(tmp_path, preload: list[Path] = ()) -> tuple[float, float]:
    """(image mean, alpha of a fit) from a fresh process, which has to end by itself."""
    script = tmp_path / "render.py"
    script.write_text(SCRIPT.format(tests=str(Path(__file__).parent)))
    environment = dict(os.environ, BLENDER_USER_RESOURCES=str(tmp_path / "user"))
    environment.update(
        BLENDER_USER_SCRIPTS=str(tmp_path / "user" / "scripts"), LD_PRELOAD=":".join(map(str, preload))
    )
    (tmp_path / "user" / "scripts" / "addons").mkdir(parents=True, exist_ok=True)
    if bpy.app.binary_path:
        command = [
            bpy.app.binary_path,
            "-b",
            "--factory-startup",
            "--python-exit-code",
            "3",
            "--python",
            script,
        ]
    else:
        command = [sys.executable, script]
    finished = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=180, check=False
    )
    line = next((line for line in finished.stdout.splitlines() if line.startswith("RESULT")), None)
    assert line, finished.stdout[-2000:] + finished.stderr[-2000:]
    assert finished.returncode == 0, finished.stderr[-2000:]
    return tuple(float(word) for word in line.split()[1:])


def test_a_script_that_renders_ends(tmp_path):
    """A hanging exit would run into the time limit of the process."""
    mean, alpha = result_of(tmp_path)
    assert mean > 0.0 and alpha > 0.0


def test_own_embree_and_ceres_are_used(tmp_path):
    """Official Blender programs hold Embree 4 and Ceres in the global scope, where a careless core would
    find them and silently hit nothing. Simulated by preloading the libraries that came with bpy."""
    folder = Path(bpy.__file__).parents[4] / "lib"
    if not folder.is_dir():
        folder = next(
            (p / "lib" for p in Path(bpy.__file__).parents if (p / "lib" / "libembree4.so.4").exists()), None
        )
    if folder is None:
        pytest.skip("this Blender brings no libraries of its own")
    libraries = sorted(
        path for name in ("libembree4.so*", "libceres.so*", "libglog.so*") for path in folder.glob(name)
    )
    if not libraries:
        pytest.skip(f"no Embree or Ceres in {folder}")
    plain = result_of(tmp_path)
    assert result_of(tmp_path, libraries) == plain


def test_debians_blender_unpacks_the_wheel_once(tmp_path, skytree, monkeypatch):
    """Where Blender installs no wheels, some may unpack at the same time, and damage is repaired: what one of
    them has found complete is never taken away."""
    import zipfile
    from concurrent.futures import ThreadPoolExecutor

    native = scenes.part(skytree, "native")
    wheel = tmp_path / "skytree_core-0.1.0-cp311-cp311-linux_x86_64.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for i in range(50):
            archive.writestr(f"skytree_core/part{i}.py", "x = 1\n" * 1000)

    def unpack(cache):
        folder = Path(native.unpack_wheel(str(wheel), str(cache)))
        return folder, folder.stat().st_ino, len(list((folder / "skytree_core").iterdir()))

    with ThreadPoolExecutor(8) as pool:
        for i in range(20):
            cache = tmp_path / f"cache{i}"
            ((folder, _, files),) = set(pool.map(unpack, [cache] * 8))
            assert files == 50
    Path(folder, "skytree_core", "part7.py").write_text("damaged")
    assert native.unpack_wheel(str(wheel), str(cache)) == str(folder)
    assert Path(folder, "skytree_core", "part7.py").read_text().startswith("x = 1")
    assert sorted(p.name for p in cache.iterdir()) == [folder.name]


def test_missing_core_is_explained(skytree, monkeypatch):
    native = scenes.part(skytree, "native")
    monkeypatch.setattr(native, "_core", None)
    monkeypatch.setattr(native, "_load", lambda: native._bundled_wheel())
    if Path(native.__file__).with_name("wheels").is_dir():
        pytest.skip("this add-on brings its core along")
    with pytest.raises(native.CoreUnavailableError, match="no wheel for cp"):
        native.core()
