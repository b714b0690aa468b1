"""The shipped hyperparameter files train with RL Zoo itself, where it is installed."""

import subprocess
import sys

import pytest
import yaml

from creative_nao.agents.hyperparameters import FOLDER

ENV = "CreativeNao/BoxingMental-v0"


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_rl_zoo_trains_from_the_shipped_file(algorithm, tmp_path):
    pytest.importorskip("rl_zoo3", reason="RL Zoo is installed apart: its dependencies ask for an older pillow")
    entries = yaml.safe_load((FOLDER / f"{algorithm}.yml").read_text())
    entries[ENV]["n_timesteps"] = 1920  # everything else is as shipped
    conf_file = tmp_path / "short.yml"
    conf_file.write_text(yaml.safe_dump(entries))
    words = ["--algo", algorithm, "--env", ENV, "--gym-packages", "creative_nao", "--conf-file", str(conf_file)]
    words += ["-f", str(tmp_path / "logs"), "--eval-freq", "-1", "--save-freq", "-1"]
    subprocess.run([sys.executable, "-m", "rl_zoo3.train", *words], check=True, capture_output=True)
    assert list((tmp_path / "logs" / algorithm).glob(f"*/{ENV.replace('/', '-')}.zip"))
