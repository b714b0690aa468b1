"""The shipped hyperparameter files train with RL Zoo itself, in an environment of its own."""

import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest
import yaml

from creative_nao.agents.settings import FOLDER

ENV = "CreativeNao/BoxingMental-v0"
ZOO_NAMES = {"recurrent_ppo": "ppo_lstm"}


@pytest.fixture(scope="module")
def zoo_python(tmp_path_factory):
    """A Python with RL Zoo beside all that is installed here: RL Zoo asks for an older pillow, so it gets its own."""
    folder = tmp_path_factory.mktemp("zoo")
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    asked = "import sysconfig; print(sysconfig.get_path('purelib'))"
    inner = subprocess.run([python, "-c", asked], check=True, capture_output=True, text=True).stdout.strip()
    outer = sysconfig.get_path("purelib")
    (Path(inner) / "outer.pth").write_text(f"import site; site.addsitedir({outer!r})\n")
    subprocess.run([python, "-m", "pip", "install", "--quiet", "rl_zoo3>=2.9,<3"], check=True)
    return python


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", "recurrent_ppo", "tqc", "crossq"])
def test_rl_zoo_trains_from_the_shipped_file(algorithm, zoo_python, tmp_path):
    entries = yaml.safe_load((FOLDER / f"{algorithm}.yml").read_text())
    entries[ENV]["n_timesteps"] = 1920  # everything else is as shipped
    conf_file = tmp_path / "short.yml"
    conf_file.write_text(yaml.safe_dump(entries))
    zoo_name = ZOO_NAMES.get(algorithm, algorithm)
    words = ["--algo", zoo_name, "--env", ENV, "--gym-packages", "creative_nao", "--conf-file", str(conf_file)]
    words += ["-f", str(tmp_path / "logs"), "--eval-freq", "-1", "--save-freq", "-1"]
    done = subprocess.run([zoo_python, "-m", "rl_zoo3.train", *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert list((tmp_path / "logs" / zoo_name).glob(f"*/{ENV.replace('/', '-')}.zip"))
