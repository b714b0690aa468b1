"""The wheel and the source archive: complete, small, and at work without network or a place to write."""

import email
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from pathlib import Path, PurePosixPath

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "creative_nao"
WHEEL_BUDGET_MB, ARCHIVE_BUDGET_MB = 8.0, 14.0
LEFTOVERS = {"__pycache__", ".pytest_cache", ".ruff_cache", ".hypothesis", "dist", "build", "site", "runs", ".git"}
GENERATED = {".pyc", ".nbi", ".nbc"}

ASSETS = {
    "memories": (48, "creative_nao/model/pretrained/*.safetensors.xz"),
    "agent bundles": (6, "creative_nao/agents/pretrained/*.safetensors"),
    "hyperparameters": (6, "creative_nao/agents/hyperparams/*.yml"),
    "demonstrations": (6, "creative_nao/demonstrations/data/*.csv"),
    "suites": (5, "creative_nao/evaluation/suite_files/*.toml"),
    "claims of the paper": (1, "creative_nao/evaluation/paper/claims.toml"),
    "page templates": (4, "creative_nao/evaluation/templates/*.jinja"),
    "models of robot, bag, ring and scene": (4, "creative_nao/robot/*.xml"),
    "sources of the robot's figures": (1, "creative_nao/robot/nao_sources.csv"),
    "explorer files": (11, "creative_nao/explorer/static/*"),
    "mark of typed packages": (1, "creative_nao/py.typed"),
}
"""What a wheel must bring along beside its modules: at least so many files of this pattern."""

USES = """
import json

import gymnasium as gym
import numpy as np

import creative_nao as cn

env = gym.make("CreativeNao/BoxingMental-v0")
env.reset(seed=0)
_, reward, _, _, info = env.step(np.array([0.3, -0.2], dtype=np.float32))
agent = cn.load_agent("ppo/BoxingMental-v0")
trajectory = cn.load_memory("half/0").generate([[0.3, -0.2]])[0]
distance = cn.measures.dtw(trajectory, cn.load_demonstrations().trajectories[0])
env = gym.make("CreativeNao/Boxing-v0")
env.reset(seed=0)
measured = env.step(np.array([0.3, -0.2], dtype=np.float32))[4]["trajectory"]
print(json.dumps([cn.__file__, float(reward), float(distance), float(np.sum(trajectory)), float(np.sum(measured))]))
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Both packages, the wheel made from the source archive."""
    folder = tmp_path_factory.mktemp("dist")
    subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT], check=True, capture_output=True
    )
    (wheel,), (archive,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, archive


def files_of_the_package():
    """Return the files of creative_nao here, as a wheel names them."""
    return {
        path.relative_to(ROOT).as_posix()
        for path in PACKAGE.rglob("*")
        if path.is_file() and not LEFTOVERS & set(path.relative_to(ROOT).parts) and path.suffix not in GENERATED
    }


def names_in(package):
    """Return the files in a wheel or, without its top folder, in a source archive."""
    if package.suffix == ".whl":
        return set(zipfile.ZipFile(package).namelist())
    with tarfile.open(package) as archive:
        return {PurePosixPath(*PurePosixPath(one.name).parts[1:]).as_posix() for one in archive if one.isfile()}


def test_the_wheel_holds_the_package_and_nothing_else(built):
    names = names_in(built[0])
    told = {name for name in names if ".dist-info/" in name}

    assert names - told == files_of_the_package()
    assert {PurePosixPath(name).name for name in told} == {
        "METADATA", "WHEEL", "RECORD", "LICENSE", "entry_points.txt"
    }  # fmt: skip


@pytest.mark.parametrize("place", [0, 1], ids=["wheel", "source archive"])
@pytest.mark.parametrize("kind", ASSETS)
def test_every_kind_of_asset_is_in_both(kind, place, built):
    least, pattern = ASSETS[kind]
    assert sum(PurePosixPath(name).match(pattern) for name in names_in(built[place])) >= least


def test_the_source_archive_holds_what_its_tests_need_and_no_leftovers(built):
    names = names_in(built[1])

    assert files_of_the_package() <= names
    for name in ("LICENSE", "README.md", "SECURITY.md", "pyproject.toml", ".ci/run", ".ci/lowest.txt", "mkdocs.yml"):
        assert name in names
    for folder in ("tests", "docs", "examples", "benchmarks"):
        for path in (ROOT / folder).rglob("*.py"):
            assert path.relative_to(ROOT).as_posix() in names
    for name in names:
        assert not LEFTOVERS & set(PurePosixPath(name).parts), name
        assert PurePosixPath(name).suffix not in GENERATED | {".gif"}, name


def test_what_is_told_about_the_package_is_complete(built):
    with zipfile.ZipFile(built[0]) as wheel:
        (name,) = (name for name in wheel.namelist() if name.endswith("/METADATA"))
        told = email.message_from_bytes(wheel.read(name))

    assert told["License-Expression"] == "MIT"
    assert told.get_all("License-File") == ["LICENSE"]
    assert told["Description-Content-Type"] == "text/markdown"
    assert "Boxing-v0" in str(told.get_payload())


def test_neither_grows_beyond_its_budget(built):
    for package, budget_mb in zip(built, (WHEEL_BUDGET_MB, ARCHIVE_BUDGET_MB), strict=True):
        assert package.stat().st_size < budget_mb * 1e6, package.name


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """An environment with the wheel alone, installed without an index, beside the dependencies of this one."""
    folder = tmp_path_factory.mktemp("installed") / "venv"
    venv.create(folder, with_pip=True, symlinks=os.name == "posix")
    scripts = folder / ("Scripts" if os.name == "nt" else "bin")
    python = scripts / Path(sys.executable).name
    if not python.exists():
        python = scripts / "python"
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = Path(subprocess.run([python, "-c", ask], capture_output=True, text=True, check=True).stdout.strip())
    # A plain path: what is installed editable here stays invisible there.
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    subprocess.run(
        [python, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-compile", built[0]],
        check=True, capture_output=True,
    )  # fmt: skip
    return python, site


def apart():
    """Return the words that take network and the rights of an administrator from a command, where this system can."""
    words = []
    if shutil.which("unshare"):
        lone = ["unshare", "--net"] if os.geteuid() == 0 else ["unshare", "--map-root-user", "--net"]
        if subprocess.run([*lone, "true"], capture_output=True, check=False).returncode == 0:
            words += lone
    if shutil.which("setpriv"):
        words += ["setpriv", "--bounding-set", "-dac_override,-dac_read_search"]
    return words


@pytest.fixture
def closed(installed, tmp_path):
    """Run a command of the installed wheel where nothing can be written; yield the runner."""
    _, site = installed
    home = tmp_path / "home"
    home.mkdir()
    folders = [home, *(path for path in (site / "creative_nao").rglob("*") if path.is_dir()), site / "creative_nao"]
    kept = {"PATH": os.environ["PATH"], "HOME": str(home), "USERPROFILE": str(home), "XDG_CACHE_HOME": str(home)}
    environment = kept | {name: os.environ[name] for name in ("SYSTEMROOT", "MUJOCO_GL") if name in os.environ}
    for folder in folders:
        folder.chmod(0o555)

    def run(*words):
        return subprocess.run(
            [*apart(), *map(str, words)], cwd=home, env=environment, capture_output=True, text=True, check=False
        )

    yield run
    for folder in folders:
        folder.chmod(0o755)


def test_the_wheel_works_without_network_and_without_a_place_to_write(installed, closed):
    python, site = installed
    program = python.with_name("creative-nao" + (".exe" if os.name == "nt" else ""))

    assert closed(python, "-c", f"open({str(site / 'creative_nao' / 'stray')!r}, 'w')").returncode != 0
    told = closed(program, "--help")
    assert (told.returncode, "usage: creative-nao COMMAND" in told.stdout) == (0, True), told.stderr
    memories = closed(program, "memories", "--json")
    assert memories.returncode == 0, memories.stderr
    assert len(json.loads(memories.stdout)) == 48
    used = closed(python, "-c", USES)
    assert used.returncode == 0, used.stderr
    path, *figures = json.loads(used.stdout)
    assert Path(path).is_relative_to(site)
    here = subprocess.run([sys.executable, "-c", USES], capture_output=True, text=True, check=True, cwd=ROOT)
    assert figures == json.loads(here.stdout)[1:], "code compiled anew gives other bits than cached code"


def test_the_suite_of_the_wheel_runs_from_an_empty_folder(installed, tmp_path):
    """Without network, but with a place to write: the main command ends with its report."""
    python, _ = installed
    suite = tmp_path / "tiny.toml"
    suite.write_text(
        'about = "One agent."\nenvs = ["CreativeNao/BoxingMental-v0"]\nmemories = ["half/0"]\nagents = ["random"]\n'
        "n_seeds = 1\n", encoding="utf-8",
    )  # fmt: skip
    words = [*apart(), python.with_name("creative-nao"), "evaluate", suite, "--out", tmp_path / "run"]
    done = subprocess.run(list(map(str, words)), cwd=tmp_path, capture_output=True, text=True, check=False)

    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "report.html").is_file()
