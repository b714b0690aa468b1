"""Importing the package is quick, because it loads nothing heavy."""

import json
import subprocess
import sys

HEAVY = {"torch", "mujoco", "numba", "matplotlib", "dm_control", "stable_baselines3", "jinja2", "rich", "tyro"}
LOADED = "import json, sys; import creative_nao{more}; print(json.dumps(sorted(sys.modules)))"


def loaded(more=""):
    code = LOADED.format(more=more)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def test_importing_the_package_loads_nothing_heavy():
    assert not HEAVY & loaded()


def test_heavy_modules_are_seen_when_they_are_loaded():
    assert "numba" in loaded("; import creative_nao.model.simd")
