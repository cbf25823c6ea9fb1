# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of build_addon.py: what it promises about steps, messages, counts and the packages it makes."""

import hashlib
import io
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))
from skytree_build import benchmarks, environments, gpu_check, packaging, steps, testing
from skytree_build.steps import ROOT, BuildError, Finished


def build_addon(*arguments):
    return subprocess.run(
        [sys.executable, ROOT / "build_addon.py", *arguments], capture_output=True, text=True, cwd=ROOT.parent
    )


# --- The command line ---


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ([], "command"),
        (["paint"], "'paint'"),
        (["test", "nonsense"], "unknown part nonsense"),
        (["package", "--fast"], "--fast"),
        (["demo", "--hdri", "missing.hdr"], "missing.hdr: there is no such file"),
    ],
)
def test_wrong_usage_is_named(arguments, named):
    finished = build_addon(*arguments)
    assert finished.returncode == 2
    assert named in finished.stderr


def test_help_lists_every_command():
    listed = build_addon("--help").stdout
    for command in ("demo", "test", "build", "package", "bench", "gpu-check", "compare", "figures"):
        assert re.search(rf"^\s+{command}\s", listed, re.M)


# --- Steps ---


@pytest.fixture
def logs(tmp_path, monkeypatch):
    monkeypatch.setattr(steps, "LOGS", tmp_path)
    return tmp_path


def test_failed_step_shows_the_end_of_its_log_and_where_it_is(logs):
    script = "for i in range(100): print('line', i)\nraise SystemExit(3)"
    with pytest.raises(BuildError) as failure:
        steps.run("Count to a hundred", [sys.executable, "-c", script])
    log = logs / "count-to-a-hundred.log"
    assert "Count to a hundred failed" in str(failure.value)
    assert "line 99" in str(failure.value) and "line 9\n" not in str(failure.value)
    assert str(log) in str(failure.value)
    assert "line 0" in log.read_text()


def test_missing_program_is_named(logs):
    with pytest.raises(BuildError, match="skytree-no-such-program cannot be started"):
        steps.run("Start", ["skytree-no-such-program"])


def test_step_that_hangs_is_ended_with_its_children(logs):
    finished = steps.run("Hang", ["sh", "-c", "sleep 1000 & sleep 1000"], check=False, minutes=0.01)
    assert finished.returncode < 0
    assert "ran longer than" in finished.log.read_text()


def test_step_gets_the_variables_given_to_it(logs):
    finished = steps.run("Show", ["sh", "-c", "echo [$SKYTREE_ZIP]"], SKYTREE_ZIP=Path("a.zip"))
    assert "[a.zip]" in finished.log.read_text()


@pytest.mark.parametrize("line, fraction", [("[3/12] Building CXX", 0.25), ("test_a.py ..s [ 40%]", 0.4)])
def test_status_line_reads_progress(line, fraction):
    status = steps.StatusLine("Compile")
    status.follow(line)
    assert status.fraction == pytest.approx(fraction)


def test_content_hash_sees_names_bytes_and_facts(tmp_path):
    (tmp_path / "a").write_text("1")
    digests = {steps.content_hash([tmp_path])}
    (tmp_path / "a").write_text("2")
    digests.add(steps.content_hash([tmp_path]))
    (tmp_path / "a").rename(tmp_path / "b")
    digests.add(steps.content_hash([tmp_path]))
    digests.add(steps.content_hash([tmp_path], "fact"))
    assert len(digests) == 4
    (tmp_path / "__pycache__").mkdir()
    (tmp_path / "__pycache__" / "x.pyc").write_text("")
    assert steps.content_hash([tmp_path], "fact") in digests


# --- What the machine must have ---


def test_missing_packages_are_named_to_a_user_without_root(monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    monkeypatch.setattr(environments, "can_sudo", lambda: False)
    monkeypatch.setitem(environments.APT, "nothing", ["skytree-no-such-package", "dpkg"])
    with pytest.raises(BuildError) as failure:
        environments.require_packages("nothing")
    assert "apt-get install --no-install-recommends skytree-no-such-package\n" in str(failure.value)
    assert "--no-apt" in str(failure.value)


def test_no_apt_takes_the_machine_as_it_is(monkeypatch):
    monkeypatch.setattr(environments, "use_apt", False)
    monkeypatch.setitem(environments.APT, "nothing", ["skytree-no-such-package"])
    environments.require_packages("nothing")


def test_pinned_groups_have_exact_versions():
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]
    for group in groups:
        assert all(re.fullmatch(r"[\w-]+==[\w.]+", pin) for pin in environments.pinned(group)), group
    assert set(environments.pinned("build")) < set(environments.pinned("tools"))


def test_python_of_another_version_is_not_taken(tmp_path, monkeypatch):
    impostor = tmp_path / "python3.99"
    impostor.write_text("#!/bin/sh\necho 3.11 /usr/bin/python3\n")
    impostor.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert environments.find_python("3.99") is None


def test_python_is_the_same_by_whichever_name_it_is_found(monkeypatch):
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    found = environments.find_python(version)
    monkeypatch.setattr(sys, "executable", str(found))
    assert environments.find_python(version) == found
    assert not found.is_symlink()


# --- Counting tests ---


def outcome_of(tmp_path, report, returncode, output=""):
    log, junit = tmp_path / "part.log", tmp_path / "part.xml"
    log.write_text(output)
    if report is not None:
        junit.write_text(report)
    outcome = testing.read_junit(junit, Finished(returncode, log, []))
    return outcome.passed, outcome.failed, outcome.skipped


PASS, FAIL, SKIP = "<testcase/>", "<testcase><failure/></testcase>", "<testcase><skipped/></testcase>"


@pytest.mark.parametrize(
    ("cases", "returncode", "counts"),
    [
        (PASS + PASS + SKIP, 0, (2, 0, 1)),
        (PASS + FAIL + "<testcase><error/></testcase>", 1, (1, 2, 0)),
        ('<testcase status="run"/><testcase status="notrun"/>', 0, (1, 0, 1)),
        (PASS, 139, (1, 1, 0)),  # crashed after the report was written
        ("", 0, (0, 1, 0)),  # nothing ran
        (SKIP, 0, (0, 1, 1)),  # nothing but skips is no test either
    ],
)
def test_counts_of_a_part(tmp_path, cases, returncode, counts):
    report = f"<testsuites><testsuite>{cases}</testsuite></testsuites>"
    assert outcome_of(tmp_path, report, returncode) == counts


def test_part_without_report_has_failed(tmp_path):
    assert outcome_of(tmp_path, None, 1) == (0, 1, 0)
    assert outcome_of(tmp_path, None, 0) == (0, 1, 0)


def test_failed_test_is_shown_with_its_reason(tmp_path):
    log, junit = tmp_path / "part.log", tmp_path / "part.xml"
    log.write_text("noise\n=== 1 failed in 0.1s ===\n")
    junit.write_text(
        '<t><testcase classname="test_a" name="test_b"><failure>line\nE  2 != 3</failure></testcase></t>'
    )
    closing = "\n".join(testing.read_junit(junit, Finished(1, log, [])).closing)
    assert "test_a test_b" in closing and "E  2 != 3" in closing and str(log) in closing
    assert "=== 1 failed" in closing and "noise" not in closing


def test_every_part_runs_though_one_fails(monkeypatch, capsys):
    def broken():
        raise BuildError("Compile failed.")

    parts = {"broken": broken, "sound": lambda: testing.Outcome(passed=3, skipped=1)}
    monkeypatch.setattr(testing, "TEST_PARTS", parts)
    assert testing.run_tests([]) == 1
    printed = capsys.readouterr().out
    assert "Compile failed." in printed
    assert printed.endswith("\n3 passed, 1 failed, 1 skipped\n")


# --- Packages ---

MANIFEST = 'schema_version = "1.0.0"\nid = "skytree"\nversion = "0.0.0"\n\n[permissions]\nfiles = "Read"\n'


def test_manifest_gets_version_and_wheels_once():
    once = packaging.stamped_manifest(MANIFEST, ["a.whl"])
    twice = packaging.stamped_manifest(once, ["b.whl", "c.whl"])
    assert tomllib.loads(once)["wheels"] == ["./wheels/a.whl"]
    assert tomllib.loads(twice) == {
        "schema_version": "1.0.0",
        "id": "skytree",
        "version": packaging.VERSION,
        "wheels": ["./wheels/b.whl", "./wheels/c.whl"],
        "permissions": {"files": "Read"},
    }


def test_manifest_without_version_is_refused():
    with pytest.raises(BuildError, match="blender_manifest.toml"):
        packaging.stamped_manifest('id = "skytree"\n', [])


def test_bl_info_gets_the_version():
    stamped = packaging.stamped_init('bl_info = {\n    "version": (0, 0, 0),\n    "blender": (3, 4, 0),\n}\n')
    assert f'"version": ({", ".join(packaging.VERSION.split("."))}),' in stamped
    assert '"blender": (3, 4, 0)' in stamped
    with pytest.raises(BuildError, match="bl_info"):
        packaging.stamped_init("")


@pytest.fixture
def archive():
    if "SKYTREE_ZIP" not in os.environ:
        pytest.skip("SKYTREE_ZIP does not name a package (build_addon.py test sets it)")
    return Path(os.environ["SKYTREE_ZIP"])


@pytest.fixture
def wheel(archive):
    with zipfile.ZipFile(archive) as extension:
        (name,) = [name for name in extension.namelist() if name.endswith(".whl")]
        yield zipfile.ZipFile(io.BytesIO(extension.read(name)))


def test_archive_is_an_extension_of_one_folder(archive):
    assert archive.name == f"skytree-{packaging.VERSION}-linux-x64.zip"
    assert archive.stat().st_size < 25e6
    with zipfile.ZipFile(archive) as extension:
        names = extension.namelist()
        manifest = tomllib.loads(extension.read("skytree/blender_manifest.toml").decode())
        assert {entry.date_time for entry in extension.infolist()} == {packaging.ZIP_EPOCH}
    assert {name.split("/")[0] for name in names} == {"skytree"}
    assert manifest["version"] == packaging.VERSION
    wheels = [name.replace("skytree/", "./") for name in names if name.endswith(".whl")]
    assert manifest["wheels"] == wheels
    assert not [name for name in names if "__pycache__" in name]


def test_archive_is_made_of_the_same_bytes_again(archive):
    before = hashlib.sha256(archive.read_bytes()).hexdigest()
    assert hashlib.sha256(packaging.package().read_bytes()).hexdigest() == before


def test_wheel_has_a_module_for_each_python_of_its_name(wheel):
    names = wheel.namelist()
    (record,) = [name for name in names if name.endswith(".dist-info/WHEEL")]
    pythons = re.findall(r"^Tag: cp(\d+)-none-manylinux", wheel.read(record).decode(), re.M)
    modules = re.findall(r"skytree_core/_native\.cpython-(\d+)-", "\n".join(names))
    assert "311" in pythons and sorted(pythons) == sorted(modules)


def test_package_says_the_projects_version(wheel):
    assert f'__version__ = "{packaging.VERSION}"' in wheel.read("skytree_core/__init__.py").decode()


def test_bundled_libraries_have_names_of_their_own_and_licences(wheel, tmp_path):
    wheel.extractall(tmp_path)
    libraries = tmp_path / "skytree_core" / "lib"
    for file, soname in {
        "libembree3.so.3": "libskytree_embree3.so.3",
        "libskytree_tbb.so.12": "libskytree_tbb.so.12",
    }.items():
        dynamic = subprocess.run(["readelf", "-d", libraries / file], capture_output=True, text=True).stdout
        assert f"soname: [{soname}]" in dynamic
        assert "[libtbb.so.12]" not in dynamic and "[$ORIGIN]" in dynamic
    for text in ("Apache-2.0.txt", "embree.txt", "tbb.txt"):
        assert "Apache" in (libraries / "licenses" / text).read_text()


def test_modules_need_nothing_but_the_c_library(wheel, tmp_path):
    for name in [name for name in wheel.namelist() if re.search(r"_native\..*\.so$", name)]:
        dynamic = subprocess.run(
            ["readelf", "-d", wheel.extract(name, tmp_path)], capture_output=True, text=True
        ).stdout
        needed = set(re.findall(r"NEEDED.*\[(.*)\]", dynamic))
        assert needed <= {"libc.so.6", "libm.so.6", "ld-linux-x86-64.so.2"}, name


def test_blenders_own_validation_accepts_the_archive(archive):
    found = sorted(
        (steps.BUILD / "bpy-4.5").glob("lib/python3.11/site-packages/bpy/*/scripts/**/blender_ext.py")
    )
    if not found:
        pytest.skip("build/bpy-4.5 is not there")
    finished = subprocess.run([sys.executable, found[0], "validate", archive], capture_output=True, text=True)
    assert finished.returncode == 0, finished.stdout + finished.stderr


# --- Benchmarks ---


def test_promises_are_held_against_medians():
    def entries(name, *times):
        return [{"run_type": "iteration", "run_name": name, "cpu_time": time} for time in times]

    report = {
        "benchmarks": [
            *entries("sample/inversion_binary/4096", 90, 100, 900),
            *entries("sample/kdtree_fitted/4096", 10, 5, 10),
            *entries("sample/inversion_guided/4096", 29, 29, 29),
            {"run_type": "aggregate", "run_name": "sample/inversion_guided/4096", "cpu_time": 1e9},
        ]
    }
    times = benchmarks.read_times(report)
    assert times == {
        "sample/inversion_binary/4096": 100,
        "sample/kdtree_fitted/4096": 10,
        "sample/inversion_guided/4096": 29,
    }
    table, broken, missing = benchmarks.promise_table(times)
    assert (broken, missing) == (1, 2)
    assert "10.00×   promised ≥ 10×: kept" in table and "2.90×   promised ≥ 3×: NOT KEPT" in table


# --- The GPU check ---


def test_the_packed_python_runs_anywhere(tmp_path, monkeypatch):
    monkeypatch.setattr(gpu_check, "PACKAGES", ("pytest", "numpy"))
    gpu_check.pack_python(environments.environment("venv", "tools", "3.11"), tmp_path / "python")
    moved = tmp_path.rename(tmp_path.with_name("elsewhere"))
    variables = {"PYTHONHOME": moved / "python", "PYTHONPATH": moved / "python" / "packages"}
    variables["LD_LIBRARY_PATH"] = moved / "lib"
    code = "import ctypes, csv, numpy, pytest, sys; print(numpy.arange(3).sum(), *sys.path, numpy.__file__)"
    command = [moved / "python" / "bin" / "python3", "-c", code]
    clean = {name: str(value) for name, value in variables.items()}
    said = subprocess.run(command, capture_output=True, text=True, env=clean, cwd="/")
    assert said.returncode == 0, said.stderr
    total, *places = said.stdout.split()
    assert total == "3" and all(place.startswith(str(moved)) for place in places)


def test_the_systems_own_libraries_stay_out_of_the_gpu_check():
    system = ("libc.so.6", "libm.so.6", "libstdc++.so.6", "libgcc_s.so.1", "ld-linux-x86-64.so.2")
    assert all(gpu_check.SYSTEM_LIBRARIES.match(name) for name in system)
    assert not any(gpu_check.SYSTEM_LIBRARIES.match(name) for name in ("libcrypt.so.1", "libtbb.so.12"))
