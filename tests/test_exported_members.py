"""What is promised is there: public names, their arguments, their examples, and a light import."""

import doctest
import importlib
import inspect
import pkgutil
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import creative_nao as cn

ROOT = Path(__file__).parents[1]
PAGE = runpy.run_path(str(ROOT / "docs" / "make_pages.py"))
PACKAGES = PAGE["PACKAGES"]
TOP_LEVEL = {
    "load_demonstrations": ["folder"],
    "train": ["demonstrations", "seed", "seeds"],
    "load_memory": ["name"],
    "Memory.generate": ["self", "pb", "n_steps"],
    "Memory.infer_pb": ["self", "trajectory"],
    "Memory.save": ["self", "path"],
    "pb_map": ["memory", "resolution"],
    "PBMap.save": ["self", "path"],
    "PBMap.plot": ["self", "path"],
    "measures.dtw": ["a", "b"],
    "measures.dtw_matrix": ["list_a", "list_b"],
    "measures.score": ["trajectories", "demos"],
    "measures.novelty": ["trajectories", "demos", "rng"],
    "measures.diversity": ["trajectories", "rng"],
    "load_agent": [],
}
"""What outside programs call, and the arguments that they name."""


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there_once_and_has_a_docstring(package):
    module = importlib.import_module(package)

    assert len(set(module.__all__)) == len(module.__all__)
    for name in module.__all__:
        value = getattr(module, name)
        if inspect.isclass(value) or inspect.isroutine(value):
            assert inspect.getdoc(value), f"{package}.{name} has no docstring"
        assert name in dir(module)


@pytest.mark.parametrize("package", PACKAGES)
def test_nothing_that_a_package_brings_in_is_left_out_of_its_list(package):
    """A name imported from the project into a package's page is meant for its readers; errors are listed at the top."""
    module = importlib.import_module(package)
    source = Path(module.__file__).read_text(encoding="utf-8")
    brought = set()
    for names in re.findall(
        r"^from creative_nao(?!\.errors)[\w.]* import (?:\(([^)]*)\)|([^\n#(]*))", source, re.MULTILINE
    ):
        brought |= {name.strip() for name in "".join(names).split(",") if name.strip()}
    brought -= {"opengl", *(() if package == "creative_nao.envs" else ("register_environments",))}

    assert brought <= set(module.__all__)


@pytest.mark.parametrize(("path", "arguments"), TOP_LEVEL.items())
def test_the_stable_names_take_the_stable_arguments(path, arguments):
    value = cn
    for part in path.split("."):
        value = getattr(value, part)

    assert set(arguments) <= set(inspect.signature(value).parameters)


def test_results_have_the_stable_fields(demonstrations, tiny_memory):
    for field in ("names", "trajectories", "dt_s", "joints"):
        assert hasattr(demonstrations, field)
    for field in ("pb", "demonstrations", "closed_loop_ratio", "loss_history"):
        assert hasattr(tiny_memory, field)
    chart = cn.pb_map(tiny_memory, resolution=3)
    for field in ("trajectories", "outcome", "nearest", "distance"):
        assert len(getattr(chart, field)) in (3, 9)
    scores = cn.measures.score(chart.trajectories.reshape(-1, *chart.trajectories.shape[-2:]), demonstrations)
    assert [scores.outcome.shape, scores.novelty.shape, scores.nearest.shape] == [(9,)] * 3


def test_every_error_of_the_project_is_one_that_users_can_catch_at_once():
    errors = [
        value
        for module in modules()
        for value in vars(module).values()
        if inspect.isclass(value)
        and issubclass(value, Exception)
        and value.__module__.startswith("creative_nao")
        and not issubclass(value, Warning)
    ]

    assert len(errors) > 6
    assert all(issubclass(error, cn.CreativeNaoError) for error in errors)


def test_the_list_of_public_names_is_current():
    written = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")

    assert written == PAGE["api_page"](), "run `python docs/make_pages.py api`"


def modules():
    for info in pkgutil.walk_packages(cn.__path__, "creative_nao."):
        if not info.name.endswith("__main__"):
            try:
                yield importlib.import_module(info.name)
            except cn.MissingDependencyError:  # a part that needs an extra
                continue


def test_the_examples_of_all_docstrings_say_what_happens(capsys):
    attempted, failed = 0, []
    for module in modules():
        result = doctest.testmod(module)
        attempted += result.attempted
        if result.failed:
            failed.append(module.__name__)

    assert failed == [], capsys.readouterr().out
    assert attempted > 40


def python(*words):
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, cwd=ROOT, check=False)


def test_the_import_loads_nothing_heavy():
    code = (
        "import creative_nao, sys; print([n for n in ('torch', 'mujoco', 'numba', 'matplotlib') if n in sys.modules])"
    )

    assert python("-c", code).stdout.strip() == "[]"


def test_the_import_adds_little_to_that_of_gymnasium():
    """Processor time, the best of several: a busy machine does not count. benchmarks/import_time.py tells the whole."""
    code = (
        "import time, gymnasium.envs.registration; start = time.process_time(); import creative_nao; "
        "print(time.process_time() - start)"
    )

    assert min(float(python("-c", code).stdout) for _ in range(5)) < 0.05


def test_usual_work_warns_of_nothing(tmp_path):
    code = f"""
import creative_nao as cn, gymnasium
memory = cn.load_memory("half/0")
memory.infer_pb(memory.generate([[0.3, -0.1]])[0], n_restarts=2)
cn.pb_map(memory, resolution=4).plot({str(tmp_path / "map.png")!r})
for name in ("CreativeNao/BoxingMental-v0", "CreativeNao/BoxingModulation-v0", "CreativeNao/Boxing-v0"):
    env = gymnasium.make(name)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
"""
    result = python("-W", "error", "-c", code)

    assert result.returncode == 0, result.stderr
    assert result.stderr == ""


def test_a_name_that_is_not_there_is_an_attribute_error():
    for package in PACKAGES:
        module = importlib.import_module(package)
        lazy, own = f"No {package} attribute ", f"module '{package}' has no attribute '"
        with pytest.raises(AttributeError, match=f"^({lazy}|{own})nothing_of_this_name'?$"):
            module.nothing_of_this_name  # noqa: B018 - the access is the test
