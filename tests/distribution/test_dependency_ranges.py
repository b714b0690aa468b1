"""The ranges of pyproject.toml are the tested ones: their lower ends are what `.ci/lowest` installs."""

import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = {name: [Requirement(text) for text in texts] for name, texts in PROJECT["optional-dependencies"].items()}
CORE = [Requirement(text) for text in PROJECT["dependencies"]]
EVERY = [*CORE, *(need for needs in EXTRAS.values() for need in needs)]


def lowest_versions():
    """Return the versions of .ci/lowest.txt by package."""
    lines = (ROOT / ".ci" / "lowest.txt").read_text(encoding="utf-8").splitlines()
    pins = [line.partition("#")[0].strip() for line in lines]
    return {name: Version(number) for name, number in (pin.split("==") for pin in pins if pin)}


def lower_bound(need):
    """Return the lower end of a requirement's range."""
    bounds = [Version(one.version) for one in need.specifier if one.operator == ">="]
    assert len(bounds) == 1, f"`{need}` should have one lower bound"
    return bounds[0]


@pytest.mark.parametrize("need", EVERY, ids=str)
def test_a_lower_bound_is_the_version_that_is_tested(need):
    lowest = lowest_versions()

    assert need.name in lowest, f"add `{need.name}` to .ci/lowest.txt"
    assert lowest[need.name] == lower_bound(need)


def test_every_version_that_is_tested_is_a_bound():
    assert lowest_versions().keys() == {need.name for need in EVERY}


@pytest.mark.parametrize("need", [*CORE, *EXTRAS["dev"]], ids=str)
def test_what_is_installed_here_lies_in_its_range(need):
    if need.marker is not None and not need.marker.evaluate():
        pytest.skip("not asked for here")
    assert need.specifier.contains(version(need.name))


def test_the_extra_for_tests_brings_every_other_extra():
    """Else a part would be tested nowhere, or its lower end would not be the one installed."""
    known = {need.name: need.specifier for need in EXTRAS["dev"]}
    for name, needs in EXTRAS.items():
        for need in needs:
            assert known.get(need.name) == need.specifier, f"extra `{name}`: {need}"


def test_the_python_versions_told_are_those_allowed():
    told = [
        Version(found[1])
        for line in PROJECT["classifiers"]
        if (found := re.fullmatch(r"Programming Language :: Python :: (3\.\d+)", line))
    ]
    allowed = Requirement(f"python{PROJECT['requires-python']}").specifier

    assert told
    assert [minor for minor in range(30) if allowed.contains(f"3.{minor}.0")] == [one.minor for one in told]


def test_the_lock_names_every_dependency_in_its_range_with_a_hash_and_no_cuda():
    """`.ci/lock` writes it; `.ci/locked` installs it."""
    lines = [line for line in (ROOT / ".ci" / "lock.txt").read_text(encoding="utf-8").splitlines() if line[0] != "#"]
    found = [re.fullmatch(r"([\w.-]+)==(\S+) --hash=sha256:[0-9a-f]{64}", line) for line in lines]
    assert all(found)
    locked = {one[1].replace("_", "-"): Version(one[2]) for one in found}
    for need in EVERY:
        if need.marker is None or need.marker.evaluate({"python_version": "3.11"}):
            assert need.specifier.contains(locked[need.name.lower()]), need
    assert not [name for name in locked if name.startswith("nvidia")]
    assert locked["torch"].local == "cpu"
