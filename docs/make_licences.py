"""Write docs/licences.md, every package that an installation brings: `python docs/make_licences.py`.

With `--sbom FILE` it writes a CycloneDX 1.5 bill of materials of what is installed here instead. Both follow the
dependencies that pyproject.toml declares, those of the extras among them save the ones for developers, through the
metadata of the installed packages. The page is to be written where all extras are installed.
"""

import argparse
import json
import re
import tomllib
from collections.abc import Iterable
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

from creative_nao import storage

PAGE = Path(__file__).parent / "licences.md"
PROJECT = tomllib.loads((PAGE.parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ROOT_PACKAGE = PROJECT["name"]
EXTRAS = {name: needs for name, needs in PROJECT["optional-dependencies"].items() if name not in ("dev", "docs")}
"""What the extras for users need; the two others are for developers."""
HEAD = """# Licences

What an installation brings along on Linux, with the licence that each package declares and, where only extras need it,
their names. The file is written by `docs/make_licences.py`; versions are left out, since they differ between
installations. creative_nao itself is under the MIT licence.

A bill of materials of an installation in CycloneDX 1.5, with versions and with what needs what; a test checks one
against the schema of the format:

```sh
python docs/make_licences.py --sbom sbom.json
```

| package | licence | extras |
| --- | --- | --- |
"""


def normal(name: str) -> str:
    """Return a package name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def declared(extras: Iterable[str]) -> list[str]:
    """Return the requirements of creative-nao with these extras."""
    return [*PROJECT["dependencies"], *(need for extra in extras for need in EXTRAS[extra])]


def needed(requirements: Iterable[str], extras: frozenset[str] = frozenset()) -> list[tuple[str, frozenset[str]]]:
    """Return what requirements of a package with `extras` mean on this system: names, and the extras wanted of them."""
    return [
        (normal(need.name), frozenset(need.extras))
        for need in map(Requirement, requirements)
        if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in ("", *extras))
    ]


def closure(extras: Iterable[str] = ()) -> dict[str, Distribution]:
    """Return every installed package that creative-nao with these extras needs, by name."""
    found: dict[str, Distribution] = {}
    done: set[tuple[str, frozenset[str]]] = set()
    waiting = needed(declared(extras))
    while waiting:
        name, wanted = waiting.pop()
        if (name, wanted) in done:
            continue
        done.add((name, wanted))
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:  # for another system, or of an extra that is not installed
            continue
        waiting += needed(found[name].requires or (), wanted)
    return dict(sorted(found.items()))


def licence(package: Distribution) -> str:
    """Return the declared licence: the SPDX expression, else a short licence field, else the classifiers."""
    metadata = package.metadata
    short = (metadata.get("License") or "").strip()
    classified = [
        line.split("::")[-1].strip()
        for line in metadata.get_all("Classifier") or []
        if line.startswith("License ::") and not line.endswith("OSI Approved")
    ]
    if metadata.get("License-Expression"):
        return metadata["License-Expression"]
    if short and "\n" not in short and len(short) < 60:
        return short
    return ", ".join(classified) or "see its files"


def page() -> str:
    """Return the page."""
    everywhere = closure()
    by_extra = {extra: closure([extra]) for extra in EXTRAS}
    rows = []
    for name, package in closure(EXTRAS).items():
        extras = [extra for extra, packages in by_extra.items() if name in packages and name not in everywhere]
        rows.append(f"| {name} | {licence(package)} | {', '.join(extras)} |")
    return HEAD + "\n".join(rows) + "\n"


def described_licence(package: Distribution) -> list[dict]:
    """Return the licence as CycloneDX wants it: an SPDX expression as such, anything else by name."""
    expression = package.metadata.get("License-Expression")
    return [{"expression": expression}] if expression else [{"license": {"name": licence(package)}}]


def component(name: str, version: str, licences: list[dict], kind: str = "library") -> dict:
    """Return a package as CycloneDX describes one; its purl is the reference to it, too."""
    purl = f"pkg:pypi/{name}@{version}"
    return {"type": kind, "bom-ref": purl, "name": name, "version": version, "purl": purl, "licenses": licences}


def bill() -> dict:
    """Return a CycloneDX 1.5 bill of materials of what is installed here."""
    packages = closure(EXTRAS)
    root = component(ROOT_PACKAGE, PROJECT["version"], [{"expression": PROJECT["license"]}], "application")
    parts = {name: component(name, one.version, described_licence(one)) for name, one in packages.items()}
    needs = {root["bom-ref"]: needed(declared(EXTRAS))}
    needs |= {parts[name]["bom-ref"]: needed(one.requires or ()) for name, one in packages.items()}
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.5.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": root},
        "components": list(parts.values()),
        "dependencies": [
            {"ref": reference, "dependsOn": sorted({parts[name]["bom-ref"] for name, _ in wanted if name in parts})}
            for reference, wanted in needs.items()
        ],
    }


def main() -> None:
    """Write the page, or the bill of materials."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sbom", type=Path, help="write a CycloneDX bill of materials here instead")
    target = parser.parse_args().sbom
    if target is None:
        storage.write_text(PAGE, page())
    else:
        storage.write_text(target, json.dumps(bill(), indent=2) + "\n")


if __name__ == "__main__":
    main()
