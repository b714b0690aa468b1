"""Write the pages of the documentation that are made from code, packages and records: `python docs/make_pages.py NAME`.

The sentences stand in `docs/templates`. `docs/publish_results.py` brings finished runs into the documentation.
"""

from __future__ import annotations

import functools
import importlib
import inspect
import json
import re
import tomllib
from collections import Counter
from collections.abc import Iterable
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
from packaging.requirements import Requirement
from tyro.extras import SubcommandApp

from creative_nao import storage
from creative_nao.evaluation.pages import render

DOCS = Path(__file__).parent
TEMPLATES = DOCS / "templates"
PROJECT = tomllib.loads((DOCS.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = {name: needs for name, needs in PROJECT["optional-dependencies"].items() if name not in ("dev", "docs")}
"""What the extras for users need; the two others are for developers."""

RELIABILITY = DOCS / "reliability.md"
RECORDS = {"faults": DOCS / "faults.json", "attempts": DOCS / "attempts.json"}
"""What the tests recorded, by the name of its tables in reliability.md."""

PACKAGES = (
    "creative_nao",
    "creative_nao.demonstrations",
    "creative_nao.model",
    "creative_nao.measures",
    "creative_nao.maps",
    "creative_nao.envs",
    "creative_nao.testing",
    "creative_nao.agents",
    "creative_nao.exchange",
    "creative_nao.robot",
)
"""The packages whose `__all__` is the public interface, in reading order."""

app = SubcommandApp()


@app.command
def api() -> None:
    """Write api.md, the list of public names, from the packages' `__all__` and docstrings."""
    storage.write_text(DOCS / "api.md", api_page())


@app.command
def environments() -> None:
    """Write environments.md from the docstrings of the environments; dm-control has to be installed."""
    storage.write_text(DOCS / "environments.md", environments_page())


@app.command
def faults() -> None:
    """Write the tables of faults into reliability.md from faults.json, which `pytest tests/faults` records."""
    _write_tables("faults")


@app.command
def attempts() -> None:
    """Write the table of attempts into reliability.md from attempts.json, which `pytest --write-attempts` records."""
    _write_tables("attempts")


@app.command
def licences(sbom: Path | None = None) -> None:
    """Write licences.md, every package that an installation brings; all extras have to be installed.

    It follows the dependencies that pyproject.toml declares, those of the extras for users among them, through the
    metadata of the installed packages.

    Args:
        sbom: Write a CycloneDX 1.5 bill of materials of what is installed here to this file instead.
    """
    if sbom is None:
        storage.write_text(DOCS / "licences.md", licences_page())
    else:
        storage.write_text(sbom, json.dumps(bill_of_materials(), indent=2) + "\n")


@app.command
def agents() -> None:
    """Write agent_cards.md from the shipped agents; `make_images.py training` draws its curves."""
    storage.write_text(DOCS / "agent_cards.md", agents_page())


def api_page() -> str:
    """Return the page of public names."""
    packages = []
    for package in PACKAGES:
        module = importlib.import_module(package)
        values = {name: getattr(module, name) for name in module.__all__}
        rows = [(f"{name}{_signature(value)}", _first_sentence(value)) for name, value in values.items()]
        packages.append({"name": package, "about": _first_sentence(module), "rows": rows})
    return render("api.md.jinja", TEMPLATES, packages=packages)


def _signature(value: object) -> str:
    """Return the arguments of a function by name and kind, without hints and defaults; nothing for other values."""
    if not inspect.isroutine(value):
        return ""
    words, keyword_only = [], False
    for argument in inspect.signature(value).parameters.values():
        if argument.kind is argument.KEYWORD_ONLY and not keyword_only:
            words.append("*")
            keyword_only = True
        star = {argument.VAR_POSITIONAL: "*", argument.VAR_KEYWORD: "**"}.get(argument.kind, "")
        keyword_only = keyword_only or star == "*"
        optional = "" if argument.default is argument.empty or star else "="
        words.append(f"{star}{argument.name}{optional}")
    return f"({', '.join(words)})"


def _first_sentence(value: object) -> str:
    """Return the first paragraph of a docstring; for a constant, its type."""
    if inspect.ismodule(value) or inspect.isclass(value) or inspect.isroutine(value):
        return " ".join((inspect.getdoc(value) or "").split("\n\n")[0].split())
    return f"Constant, `{'Path' if isinstance(value, Path) else type(value).__name__}`."


def environments_page() -> str:
    """Return the page about the environments."""
    from creative_nao.envs import ENVIRONMENTS, VECTOR_ENVIRONMENTS
    from creative_nao.envs.boxing_task import BoxingTask
    from creative_nao.envs.vector_env import RepertoireVectorEnv

    names: dict[str, list[str]] = {}
    for name, entry in ENVIRONMENTS.items():
        names.setdefault(entry, []).append(name)
    return render(
        "environments.md.jinja",
        TEMPLATES,
        environments={"`, `".join(ids): _docstring(_class_of(entry)) for entry, ids in names.items()},
        vector_classes=[_class_of(entry).__name__ for entry in dict.fromkeys(VECTOR_ENVIRONMENTS.values())],
        arguments=_arguments(RepertoireVectorEnv),
        task=_docstring(BoxingTask).split("Args:")[0].strip(),
    )


def _class_of(entry_point: str) -> type:
    module, name = entry_point.split(":")
    return getattr(importlib.import_module(module), name)


def _docstring(kind: type) -> str:
    """Return a docstring with its headings one level deeper."""
    return re.sub("^## ", "### ", inspect.cleandoc(kind.__doc__ or ""), flags=re.MULTILINE)


def _arguments(kind: type) -> list[tuple[str, str]]:
    """Return the `Args` of a docstring: names and what they mean."""
    text = inspect.cleandoc((kind.__doc__ or "").split("Args:\n")[1].split("\n\n")[0])
    lines = re.sub(r"\n +", " ", text).splitlines()
    return [(name, meaning.strip()) for name, _, meaning in (line.partition(":") for line in lines)]


def fault_table(record: dict[str, Any]) -> str:
    """Return what was tried and survived as two Markdown tables: commands by faults, and how each fault is answered."""
    cases = record["cases"]
    names = list(dict.fromkeys(case["fault"] for case in cases))
    answers = {}
    for name in names:
        mine = [case for case in cases if case["fault"] == name]
        codes = dict(sorted(Counter(case["exit_code"] for case in mine).items()))
        answers[name] = (codes, max((case["said"] for case in mine if case["exit_code"] > 0), key=len, default=""))
    commands = {
        command: [_share([one for one in cases if (one["command"], one["fault"]) == (command, name)]) for name in names]
        for command in dict.fromkeys(case["command"] for case in cases)
    }
    return render("faults.md.jinja", TEMPLATES, faults=names, commands=commands, answers=answers)


def _share(cases: list[dict[str, Any]]) -> str:
    return f"{sum(case['survived'] for case in cases)} of {len(cases)}" if cases else "-"


def attempt_table(record: dict[str, Any]) -> str:
    """Return what was tried against files, environments and pages as a Markdown table with a row for each case."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for case in record["cases"]:
        fresh = {"n": 0, "held": 0, "outcomes": {}, "tests": {}}
        row = rows.setdefault((case["kind"], case["case"]), fresh)
        row["n"] += case["n"]
        row["held"] += case["n"] * case["held"]
        row["outcomes"][case["outcome"]] = row["tests"][case["test"]] = None
    return render("attempts.md.jinja", TEMPLATES, rows=rows)


def with_tables(page: str, name: str, record: dict[str, Any]) -> str:
    """Return the page with its tables of `faults` or of `attempts` written anew."""
    begin, end = f"<!-- {name}: written by docs/make_pages.py -->", f"<!-- end of {name} -->"
    table = {"faults": fault_table, "attempts": attempt_table}[name](record)
    before, rest = page.split(begin)
    return f"{before}{begin}\n{table}{end}{rest.split(end)[1]}"


def _write_tables(name: str) -> None:
    record = json.loads(RECORDS[name].read_text(encoding="utf-8"))
    storage.write_text(RELIABILITY, with_tables(RELIABILITY.read_text(encoding="utf-8"), name, record))


def licences_page() -> str:
    """Return the page of licences."""
    everywhere = _closure()
    by_extra = {extra: _closure([extra]) for extra in EXTRAS}
    rows = [
        (name, _licence(package), [one for one in EXTRAS if name in by_extra[one] and name not in everywhere])
        for name, package in _closure(EXTRAS).items()
    ]
    return render("licences.md.jinja", TEMPLATES, packages=rows)


def _declared(extras: Iterable[str]) -> list[str]:
    """Return the requirements of creative-nao with these extras."""
    return [*PROJECT["dependencies"], *(need for extra in extras for need in EXTRAS[extra])]


def _needed(requirements: Iterable[str], extras: frozenset[str] = frozenset()) -> list[tuple[str, frozenset[str]]]:
    """Return what requirements of a package with `extras` mean on this system: names, and the extras wanted of them."""
    return [
        (re.sub(r"[-_.]+", "-", need.name).lower(), frozenset(need.extras))  # as package indexes compare names
        for need in map(Requirement, requirements)
        if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in ("", *extras))
    ]


def _closure(extras: Iterable[str] = ()) -> dict[str, Distribution]:
    """Return every installed package that creative-nao with these extras needs, by name."""
    found: dict[str, Distribution] = {}
    done: set[tuple[str, frozenset[str]]] = set()
    waiting = _needed(_declared(extras))
    while waiting:
        name, wanted = waiting.pop()
        if (name, wanted) in done:
            continue
        done.add((name, wanted))
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:  # for another system, or of an extra that is not installed
            continue
        waiting += _needed(found[name].requires or (), wanted)
    return dict(sorted(found.items()))


def _licence(package: Distribution) -> str:
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


def bill_of_materials() -> dict[str, Any]:
    """Return a CycloneDX 1.5 bill of materials of what is installed here."""
    packages = _closure(EXTRAS)
    root = _component(PROJECT["name"], PROJECT["version"], [{"expression": PROJECT["license"]}], "application")
    parts = {name: _component(name, one.version, _cyclonedx_licence(one)) for name, one in packages.items()}
    for part in parts.values():
        if digest := _locked().get((part["name"], part["version"])):
            part["hashes"] = [{"alg": "SHA-256", "content": digest}]
    ranges = [{"name": "range", "value": str(need)} for need in PROJECT["dependencies"]]
    root["properties"] = ranges
    needs = {root["bom-ref"]: _needed(_declared(EXTRAS))}
    needs |= {parts[name]["bom-ref"]: _needed(one.requires or ()) for name, one in packages.items()}
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


@functools.cache
def _locked() -> dict[tuple[str, str], str]:
    """Return the SHA-256 of each file of .ci/lock.txt by package and version."""
    lines = (DOCS.parent / ".ci" / "lock.txt").read_text(encoding="utf-8").splitlines()
    found = re.findall(r"^(\S+)==(\S+) --hash=sha256:(\w+)$", "\n".join(lines), re.MULTILINE)
    return {(name, version): digest for name, version, digest in found}


def _cyclonedx_licence(package: Distribution) -> list[dict]:
    """Return the licence as CycloneDX wants it: an SPDX expression as such, anything else by name."""
    expression = package.metadata.get("License-Expression")
    return [{"expression": expression}] if expression else [{"license": {"name": _licence(package)}}]


def _component(name: str, version: str, licences: list[dict], kind: str = "library") -> dict:
    """Return a package as CycloneDX describes one; its purl is the reference to it, too."""
    purl = f"pkg:pypi/{name}@{version}"
    return {"type": kind, "bom-ref": purl, "name": name, "version": version, "purl": purl, "licenses": licences}


def agents_page() -> str:
    """Return the cards of the shipped agents; plays the episodes of `random` on their memories and seeds."""
    from creative_nao.agents import load_agent
    from creative_nao.agents.learned_map.truth import N_POINTS

    chance = random_scores()
    cards = []
    for name in agent_names():
        header = load_agent(name).header
        score, by_chance = header.score, chance[name.split("/")[1]]
        gain = np.array([a.reward - b.reward for a, b in zip(score.episodes, by_chance.episodes, strict=True)])
        by_memory = gain.reshape(len(score.memories), -1).mean(axis=1)
        drawn = np.random.default_rng(0).integers(len(by_memory), size=(10_000, len(by_memory)))
        low, high = np.quantile(by_memory[drawn].mean(axis=1), [0.025, 0.975])
        film, curves = (f"images/agents/{name.replace('/', '-')}{end}" for end in (".gif", "_curves.png"))
        cards.append({
            "name": name,
            "header": header,
            "score": score,
            "gain": (gain.mean(), low, high),
            "is_better": low > 0.0,
            "appropriate_pct": np.mean(
                [one.appropriateness_pct for one in score.episodes if one.appropriateness_pct is not None]
            ),
            "film": film if (DOCS / film).is_file() else None,
            "curves": curves if (DOCS / curves).is_file() else None,
            "n_memories": header.n_actions_training // N_POINTS if header.agent == "learned_map" else None,
        })  # fmt: skip
    return render("agent_cards.md.jinja", TEMPLATES, cards=cards, chance=chance)


def agent_names() -> list[str]:
    """Return the shipped agents by environment."""
    from creative_nao.agents import shipped_agents

    return sorted(shipped_agents(), key=lambda name: tuple(reversed(name.split("/"))))


def random_scores() -> dict[str, Any]:
    """Return the score of `random` on the memories and seeds of the shipped agents' scores, by environment."""
    from creative_nao.agents import load_agent, make_agent
    from creative_nao.agents.play import Score, evaluate_agent

    scores = {}
    for name in agent_names():
        score, env = load_agent(name).header.score, name.split("/")[1]
        if env not in scores:
            episodes = evaluate_agent(make_agent("random"), score.env, score.memories, score.seeds)
            scores[env] = Score(score.env, True, episodes)
    return scores


if __name__ == "__main__":
    app.cli(prog="python docs/make_pages.py")
