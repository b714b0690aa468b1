"""Suites from TOML files and from records: every key checked, with the nearest name when one is unknown."""

from __future__ import annotations

import dataclasses
import math
import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from creative_nao.agents.ppo import settings_from
from creative_nao.envs import ENVIRONMENTS
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError, nearest_name
from creative_nao.evaluation.entrants import check_entrant
from creative_nao.evaluation.suites.model import Suite, Taught
from creative_nao.fields import shown
from creative_nao.model import SPLITS, split_memories
from creative_nao.model.shipped import shipped_memories
from creative_nao.untrusted import read_text

MENTAL = "CreativeNao/BoxingMental-v0"
SUFFIX = ".toml"
MAX_FILE_BYTES = 200_000

WORDS = {"str": "text in quotes", "int": "a whole number", "float": "a number", "list": "a list"}


def read_suite(path: Path, *, trusted: bool = False) -> Suite:
    """Read a suite from a TOML file.

    Args:
        path: The file.
        trusted: Whether agents and environments that are named with a module, which would be imported, are taken.

    Raises:
        NotFoundError: If there is no such file, or it names an agent, environment or memory that does not exist.
        FileFormatError: If it is no TOML.
        SettingsError: If a key is unknown, missing, of another type or out of range; the message names it.
    """
    try:
        values = tomllib.loads(read_text(path, "suite", MAX_FILE_BYTES))
    except (ValueError, RecursionError) as error:
        if isinstance(error, FileFormatError):
            raise
        reason = "it is nested too deeply" if isinstance(error, RecursionError) else error
        raise FileFormatError(f"suite {path}: not TOML ({reason})") from error
    try:
        suite = suite_from_values({"name": path.stem, **values}, where=f"suite {path}")
        if not trusted:
            refuse_modules(suite, f"suite {path}")
        _check_names(suite, f"suite {path}")
    except (SettingsError, NotFoundError) as error:
        if str(path) in str(error):
            raise
        raise type(error)(f"suite {path}: {error}") from error
    return suite


def suite_from_values(values: Mapping[str, Any], *, where: str) -> Suite:
    """Make a suite out of plain values, as TOML or a record holds them.

    Args:
        values: Keys are the fields of `Suite`; lists stand for tuples. `training_env`, `oracle_envs`, `ppo` and
            `memories` (with `taught`) may be left out.
        where: Beginning of error messages.

    Raises:
        SettingsError: If a key is unknown, missing, of another type or out of range; the message names it.
    """
    values = dict(values)
    known = {field.name: str(field.type) for field in dataclasses.fields(Suite)}
    _check_keys(values, known, where)
    for name in ("agents", "envs", "memories", "oracle_envs"):
        if name in values:
            values[name] = _typed(values[name], known[name], f"{where}: `{name}`")
    if isinstance(per_action := values.get("seconds_per_action"), Mapping):
        values["seconds_per_action"] = [[env, cost] for env, cost in per_action.items()]
    taught = _taught(values.get("taught"), where)
    memories = [*values.get("memories", ()), *(taught.names if taught is not None else ())]
    chosen: dict[str, Any] = {
        "training_env": MENTAL,
        "oracle_envs": [env for env in values.get("envs", ()) if env == MENTAL],
        "n_seeds": 10,
        "n_actions": 30,
        **values,
        "memories": list(dict.fromkeys(memories)),
        "taught": taught,
    }
    for name in ("agents", "envs"):
        if name not in chosen:
            raise SettingsError(f"{where}: `{name}` is missing; it should be a list of names")
    for name, value in chosen.items():
        if name not in ("taught", "ppo", "seconds_per_action"):
            chosen[name] = _typed(value, known[name], f"{where}: `{name}`")
    chosen["memories"] = tuple(
        name for part in chosen["memories"] for name in (split_memories(part) if part in SPLITS else (part,))
    )
    chosen["ppo"] = settings_from(values.get("ppo", {}))
    chosen["seconds_per_action"] = _costs(values.get("seconds_per_action", ()), where)
    return Suite(**chosen)


def _taught(values: Any, where: str) -> Taught | None:
    if values is None:
        return None
    if not isinstance(values, Mapping):
        raise SettingsError(f"{where}: `taught` should be a table of settings, but is {shown(values)}")
    known = {field.name: str(field.type) for field in dataclasses.fields(Taught)}
    _check_keys(values, known, f"{where}, [taught]")
    if "seeds" not in values:
        raise SettingsError(f"{where}, [taught]: `seeds` is missing; it should be a list of seeds, one per memory")
    typed = {name: _typed(value, known[name], f"{where}, [taught]: `{name}`") for name, value in values.items()}
    return Taught(**typed)


def _check_keys(values: Mapping[str, Any], known: Mapping[str, str], where: str) -> None:
    for name in values:
        if name not in known:
            raise SettingsError(f"{where}: no key `{name}`{nearest_name(name, known)}; there are: {', '.join(known)}")


def _typed(value: Any, annotation: str, where: str) -> Any:
    """Return `value` as the annotation wants it, or say what it should be."""
    if value is None and "None" in annotation:
        return None
    wanted = annotation.split("[")[0].split(" ")[0]
    if wanted == "tuple":
        inner = annotation.split("[")[1].split(",")[0]
        if not isinstance(value, list | tuple):
            raise SettingsError(f"{where} should be {WORDS['list']}, but is {shown(value)}")
        return tuple(_typed(part, inner, f"{where}, entry {place}") for place, part in enumerate(value, 1))
    right = {"str": str, "int": int, "float": (int, float)}[wanted]
    if not isinstance(value, right) or isinstance(value, bool) or value != value or value in (math.inf, -math.inf):
        raise SettingsError(f"{where} should be {WORDS[wanted]}, but is {shown(value)}")
    return value


def refuse_modules(suite: Suite, where: str) -> None:
    """Refuse agents and environments that are named with a module: what stands in a file is not imported unasked.

    Raises:
        SettingsError: Naming the first of them, and how to ask.
    """
    for name in (*suite.agents, *suite.envs, suite.training_env, *suite.oracle_envs):
        if ":" in name and not os.path.isfile(name):
            raise SettingsError(
                f"{where}: `{name}` is a module that would be imported and run; if you trust the file, add --trust"
            )


def _costs(values: Any, where: str) -> tuple[tuple[str, float], ...]:
    pairs = values if isinstance(values, list | tuple) else [values]
    for pair in pairs:
        if not isinstance(pair, list | tuple) or len(pair) != 2 or not isinstance(pair[0], str):
            raise SettingsError(f"{where}: `seconds_per_action` should map environments to seconds: {shown(pair)}")
    return tuple((env, float(_typed(cost, "float", f"{where}: `seconds_per_action` of {env}"))) for env, cost in pairs)


def _check_names(suite: Suite, where: str) -> None:
    """Check that everything a suite names exists, before anything is started."""
    for agent in suite.agents:
        check_entrant(agent)
    for env in (*suite.envs, suite.training_env, *suite.oracle_envs):
        if env not in ENVIRONMENTS and ":" not in env:  # `module:name` registers its own
            raise NotFoundError(
                f"{where}: no environment `{env}`{nearest_name(env, ENVIRONMENTS)}; there are {', '.join(ENVIRONMENTS)}"
            )
    for memory in suite.memories:
        if suite.taught_seed(memory) is None and memory not in shipped_memories() and not os.path.isfile(memory):
            names = (*shipped_memories(), *SPLITS)
            raise NotFoundError(
                f"{where}: no memory `{memory}`{nearest_name(memory, names)}: neither a file, a shipped name, nor a "
                f"part of the bank ({', '.join(SPLITS)})"
            )
