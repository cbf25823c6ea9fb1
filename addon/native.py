# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds skytree_core, the native core.

Blender 4.2 and later install the wheel themselves. Blender 3.4 knows no wheels: there the one that lies in
the add-on's wheels/ folder is unpacked once into the user's cache. SKYTREE_CORE_PATH names a folder that
holds a freshly built skytree_core, for development.
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import importlib
import os
import shutil
import sys
import tempfile
import zipfile

PATH_VARIABLE = "SKYTREE_CORE_PATH"
_core = None


class CoreUnavailableError(RuntimeError):
    """The native core cannot be loaded; the text says why and what to do."""


def core():
    """The module skytree_core; raises CoreUnavailableError."""
    global _core
    if _core is None:
        _core = _load()
    return _core


def _load():
    folder = os.environ.get(PATH_VARIABLE)
    if folder:
        _prepend(folder)
    try:
        return importlib.import_module("skytree_core")
    except ModuleNotFoundError as error:
        # Something that skytree_core itself lacks is another problem than skytree_core missing.
        if error.name != "skytree_core":
            raise CoreUnavailableError(f"Skytree's native core does not load: {error}") from error
    except ImportError as error:
        raise CoreUnavailableError(_explain(error)) from error
    try:
        _prepend(unpack_wheel(_bundled_wheel(), cache_folder()))
        return importlib.import_module("skytree_core")
    except (ImportError, OSError, zipfile.BadZipFile) as error:
        raise CoreUnavailableError(_explain(error)) from error


def _explain(error: Exception) -> str:
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return (
        f"Skytree's native core does not load in Python {python} on {sys.platform}: {error}. "
        "Install the zip again"
    )


def _prepend(folder: str):
    if folder not in sys.path:
        sys.path.insert(0, folder)
    importlib.invalidate_caches()


def _bundled_wheel() -> str:
    folder = os.path.join(os.path.dirname(__file__), "wheels")
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
    wheels = sorted(glob.glob(os.path.join(folder, "skytree_core-*.whl")))
    matching = [w for w in wheels if tag in os.path.basename(w)]
    if not matching:
        found = ", ".join(map(os.path.basename, wheels)) or "none"
        raise CoreUnavailableError(
            f"Skytree's native core is missing: no wheel for {tag} in {folder} (found: {found}). "
            f"Install Skytree from its release zip, or set {PATH_VARIABLE} to where skytree_core lies"
        )
    return matching[-1]


def cache_folder() -> str:
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.join(base, "skytree", "core")


def unpack_wheel(wheel: str, cache: str) -> str:
    """Folder with the wheel's files, named by its content's hash, so that versions lie side by side.

    One Blender at a time looks and unpacks: of several that start together one would take away what another
    has just unpacked and loads. Files come into the folder by a renaming, which is atomic, so that one that
    is killed leaves no half of it. A folder whose files do not have the sizes in the wheel is unpacked
    again."""
    with open(wheel, "rb") as stream:
        digest = hashlib.sha256(stream.read()).hexdigest()[:16]
    target = os.path.join(cache, digest)
    os.makedirs(cache, exist_ok=True)
    with zipfile.ZipFile(wheel) as archive, _locked(cache):
        if _is_complete(archive, target):
            return target
        fresh = tempfile.mkdtemp(prefix=digest, dir=cache)
        try:
            archive.extractall(fresh)
            shutil.rmtree(target, ignore_errors=True)
            os.rename(fresh, target)
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
    return target


@contextlib.contextmanager
def _locked(folder: str):
    """Keeps other processes that lock the folder out; the system unlocks it for one that dies."""
    import fcntl  # here, as where there is none core() is to say what is missing

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # network drives may have no locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _is_complete(archive: zipfile.ZipFile, folder: str) -> bool:
    for entry in archive.infolist():
        path = os.path.join(folder, entry.filename)
        if not entry.is_dir() and not (os.path.isfile(path) and os.path.getsize(path) == entry.file_size):
            return False
    return True
