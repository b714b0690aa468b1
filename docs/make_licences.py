"""Write docs/licences.md, every package that an installation brings: `python docs/make_licences.py`.

With `--sbom FILE` it writes a CycloneDX 1.5 bill of materials of what is installed here instead. Both read only the
metadata of the installed packages and follow the dependencies of creative-nao without its extras.
"""

import argparse
import json
import re
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

from creative_nao import atomic

PAGE = Path(__file__).parent / "licences.md"
ROOT_PACKAGE = "creative-nao"
HEAD = """# Licences

What an installation brings along on Linux, without extras, with the licence that each package declares. The file is
written by `docs/make_licences.py`; versions are left out, since they differ between installations.
creative_nao itself is under the MIT licence. A bill of materials of an installation, versions included:

```sh
python docs/make_licences.py --sbom sbom.json
```

| package | licence |
| --- | --- |
"""


def normal(name: str) -> str:
    """Return a package name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def closure() -> dict[str, Distribution]:
    """Return every installed package that creative-nao needs, by normalised name."""
    found: dict[str, Distribution] = {}
    waiting = [ROOT_PACKAGE]
    while waiting:
        name = normal(waiting.pop())
        if name in found:
            continue
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:  # for another system
            continue
        needs = map(Requirement, found[name].requires or ())
        waiting += [need.name for need in needs if need.marker is None or need.marker.evaluate({"extra": ""})]
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


def page(packages: dict[str, Distribution]) -> str:
    """Return the page."""
    rows = [f"| {name} | {licence(package)} |" for name, package in packages.items() if name != ROOT_PACKAGE]
    return HEAD + "\n".join(rows) + "\n"


def bill(packages: dict[str, Distribution]) -> dict:
    """Return a CycloneDX 1.5 bill of materials."""
    components = [
        {
            "type": "library",
            "bom-ref": f"pkg:pypi/{name}@{package.version}",
            "name": name,
            "version": package.version,
            "purl": f"pkg:pypi/{name}@{package.version}",
            "licenses": [{"license": {"name": licence(package)}}],
        }
        for name, package in packages.items()
    ]
    root = next(one for one in components if one["name"] == ROOT_PACKAGE)
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": {**root, "type": "application"}},
        "components": [one for one in components if one is not root],
    }


def main() -> None:
    """Write the page, or the bill of materials."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sbom", type=Path, help="write a CycloneDX bill of materials here instead")
    target = parser.parse_args().sbom
    packages = closure()
    if target is None:
        atomic.write_text(PAGE, page(packages))
    else:
        atomic.write_text(target, json.dumps(bill(packages), indent=2) + "\n")


if __name__ == "__main__":
    main()
