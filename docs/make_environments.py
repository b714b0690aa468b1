"""Write docs/environments.md from the docstrings of the environments.

python docs/make_environments.py
"""

import importlib
import inspect
from pathlib import Path

from creative_nao.envs import ENVIRONMENTS, VECTOR_ENVIRONMENTS
from creative_nao.envs.boxing_task import BoxingTask
from creative_nao.envs.vector_env import RepertoireVectorEnv

_INTRODUCTION = """# Environments

This page is made from the docstrings of the classes (`python docs/make_environments.py`); a test compares their tables
with the spaces, and this page with the docstrings.

```python
import gymnasium as gym
import creative_nao

env = gym.make("CreativeNao/BoxingMental-v0")
observation, info = env.reset(seed=0)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
print(info["outcome"], info["nearest_name"], reward)

many = gym.make_vec("CreativeNao/BoxingMental-v0", 64, vectorization_mode="vector_entry_point")
observations, infos = many.reset(seed=0)
```
"""

_AFTER = """## Exact state

`get_state()` returns an `EnvState` of plain values and arrays, `set_state(state)` goes back to it; the environment then
goes on with the same bits. `state.save(path)` and `EnvState.load(path)` keep it in a file. `copy.deepcopy` and `pickle`
of an environment work, too. A vector environment returns and takes one state per sub-environment, each of which the
single environment takes as well.
"""


def class_of(entry_point: str) -> type:
    """Return the class behind an entry point such as ``package.module:Class``."""
    module, name = entry_point.split(":")
    return getattr(importlib.import_module(module), name)


def environments_page() -> str:
    """Return the page as Markdown."""
    parts = [_INTRODUCTION]
    for name, entry_point in ENVIRONMENTS.items():
        parts.append(_section(f"`{name}`", class_of(entry_point)))
    names = ", ".join(f"`{class_of(entry).__name__}`" for entry in VECTOR_ENVIRONMENTS.values())
    parts.append(f"## Vector environments\n\n{names}\n\n{_arguments(RepertoireVectorEnv)}")
    parts.append(_AFTER)
    title = '## dm_control: `creative_nao.envs.load("boxing")`'
    parts.append(f"{title}\n\n{_page(BoxingTask.__doc__ or '').split('Args:')[0].strip()}\n")
    return "\n".join(parts)


def _section(title: str, kind: type) -> str:
    return f"## {title}\n\n{_page(kind.__doc__ or '')}\n"


def _page(docstring: str) -> str:
    """Return a docstring with its headings one level deeper."""
    lines = inspect.cleandoc(docstring).splitlines()
    return "\n".join(f"#{line}" if line.startswith("## ") else line for line in lines)


def _arguments(kind: type) -> str:
    """Return the `Args` of a docstring as a table."""
    text = inspect.cleandoc(kind.__doc__ or "").split("Args:\n")[1].split("\n\n")[0]
    rows: list[str] = []
    for line in inspect.cleandoc(text).splitlines():
        if line.startswith(" "):
            rows[-1] += f" {line.strip()}"
        else:
            rows.append(line.strip())
    cells = [f"| {row.split(':', 1)[0]} | {row.split(':', 1)[1].strip()} |" for row in rows]
    return "\n".join(["| argument | meaning |", "| --- | --- |", *cells]) + "\n"


if __name__ == "__main__":
    Path(__file__).with_name("environments.md").write_text(environments_page(), encoding="utf-8")
