"""`creative-nao agent train | run | tune`: what they write, print and refuse."""

import csv
import json
import signal
import subprocess
import sys
import time

import pytest
import yaml

from creative_nao.agents import load_agent
from creative_nao.agents.settings import read_hyperparameters
from creative_nao.arrays import load_tensors
from creative_nao.cli import main

ENV = "CreativeNao/BoxingMental-v0"
ENTRY = {
    "n_timesteps": 120,
    "n_envs": 2,
    "n_steps": 30,
    "batch_size": 30,
    "n_epochs": 2,
    "policy_kwargs": {"net_arch": [8]},
}


@pytest.fixture
def conf_file(tmp_path):
    path = tmp_path / "mine.yml"
    path.write_text(yaml.safe_dump({ENV: ENTRY}))
    return str(path)


@pytest.fixture
def trained(conf_file, tmp_path, capsys):
    out = tmp_path / "trained"
    words = ["--conf-file", conf_file, "--validation-memory", "half/10", "--score-seeds", "1", "--seed", "4"]
    assert main(["agent", "train", "ppo", *words, "--out", str(out), "--json"]) == 0
    return out, json.loads(capsys.readouterr().out)


def test_training_writes_a_bundle_that_tells_everything(trained):
    out, figures = trained
    header = load_agent(out / "agent.safetensors").header
    assert (header.agent, header.env, header.memory, header.seed) == ("ppo", ENV, "train", 4)
    assert header.score.mean == figures["validation_reward"]["mean"]
    assert header.command == (
        f"creative-nao agent train ppo --env {ENV} --seed 4 --timesteps 120 --conf-file mine.yml "
        "--validation-memory half/10 --score-seeds 1 --out trained"
    )
    assert json.loads((out / "run.json").read_text())["command"] == header.command
    assert len((out / "episodes.csv").read_text().splitlines()) == 1 + 4
    assert (out / "evaluations.csv").read_text().startswith("n_decisions,mean_reward,reward_0")
    assert "train/value_loss" in (out / "progress.csv").read_text().splitlines()[0]


def test_a_bundle_is_replayed_exactly_from_the_command_line(trained, capsys):
    bundle = str(trained[0] / "agent.safetensors")
    assert main(["agent", "run", bundle, "--replay"]) == 0
    assert "reproduced exactly" in capsys.readouterr().out
    header, arrays = load_tensors(bundle, kind="agent bundle")
    header["score"]["episodes"][0]["reward"] += 1.0
    from creative_nao.arrays import save_tensors

    save_tensors(bundle, kind="agent bundle", header=header, tensors=arrays)
    assert main(["agent", "run", bundle, "--replay"]) == 1
    assert "not reproduced" in capsys.readouterr().out


def test_an_agent_plays_named_memories(trained, capsys):
    bundle = str(trained[0] / "agent.safetensors")
    assert main(["agent", "run", bundle, "--memory", "closed/12", "--episodes", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [(one["memory"], one["seed"]) for one in found["episodes"]] == [("closed/12", 0), ("closed/12", 1)]
    assert main(["agent", "run", "random", "--memory", "closed/12"]) == 0
    assert "random in CreativeNao/BoxingMental-v0: mean reward" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["train", "pp0", "--out", "x"], "no learning agent `pp0` (did you mean `ppo`?)"),
        (["train", "ppo", "--env", "CreativeNao/Boxin-v0", "--out", "x"], "(did you mean `CreativeNao/Boxing-v0`?)"),
        (["train", "ppo", "--memory", "test", "--out", "x"], "should not be of the test part of the bank"),
        (
            ["train", "ppo", "--judged-seeds", "0", "--out", "x"],
            "`judged_seeds` should be a list of at least 1 entries",
        ),
        (["train", "ppo", "--judged-seeds", "101", "--out", "x"], "--judged-seeds should be at most 100, but is 101"),
        (["train", "ppo", "--timesteps", "0", "--out", "x"], "`n_timesteps` should be at least 1"),
        (["run", "randon"], "no agent `randon` (did you mean `random`?)"),
        (["run", "random", "--replay"], "--replay needs a trained agent"),
        (["run", "ppo"], "agent `ppo` is trained first"),
        (["tune", "ppo", "--judged-seeds", "0", "--out", "x"], "`n_judged_seeds` should be at least 1, but is 0"),
        (["tune", "ppo", "--trials", "0", "--out", "x"], "`n_trials` should be at least 1, but is 0"),
        (["fly"], "no command `agent fly`; there are train, memories, tune, run"),
    ],
)
def test_a_mistake_is_one_line(words, text, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["agent", *words]) == 2
    told = capsys.readouterr().err
    assert text in told
    assert told.count("\n") == 1


def test_a_left_over_checkpoint_is_not_overwritten(trained, conf_file, capsys):
    assert main(["agent", "train", "ppo", "--conf-file", conf_file, "--out", str(trained[0])]) == 2
    assert "is left from an earlier run; go on from it with --resume" in capsys.readouterr().err


def test_ctrl_c_keeps_a_checkpoint(conf_file, tmp_path):
    words = ["--conf-file", conf_file, "--memory", "half/0", "--timesteps", "1000000", "--checkpoint-interval", "480"]
    command = [sys.executable, "-m", "creative_nao", "agent", "train", "ppo", *words, "--out", str(tmp_path / "out")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    checkpoint = tmp_path / "out" / "checkpoint.safetensors"
    deadline = time.monotonic() + 120
    while not checkpoint.exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 130
    assert told.splitlines()[-1] == "creative-nao: stopped"
    assert load_tensors(checkpoint, kind="agent checkpoint")[0]["state"]["num_timesteps"] >= 480


def test_tuning_searches_resumes_and_writes_what_training_reads(conf_file, tmp_path, capsys):
    out = tmp_path / "tuned"
    words = ["agent", "tune", "ppo", "--conf-file", conf_file, "--timesteps", "60", "--out", str(out), "--json"]
    assert main([*words, "--trials", "1"]) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["first_reward"] == first["best_reward"]
    assert main([*words, "--trials", "2"]) == 2
    assert "go on from it with --resume" in capsys.readouterr().err
    assert main([*words, "--trials", "2", "--resume"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["n_trials"] == 2
    assert found["best_reward"] >= first["best_reward"]
    assert read_hyperparameters("ppo", ENV, out / "ppo.yml").n_timesteps == 120
    assert main([*words, "--trials", "2", "--resume", "--seed", "5"]) == 2
    assert "is a search with other settings" in capsys.readouterr().err
    assert main([*words, "--trials", "2", "--resume", "--judged-seeds", "4"]) == 2
    assert "is a search with other settings" in capsys.readouterr().err


def test_tensorboard_gets_what_the_csv_file_gets(conf_file, tmp_path):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    out = tmp_path / "logged"
    words = ["--conf-file", conf_file, "--validation-memory", "half/10", "--score-seeds", "1"]
    assert main(["agent", "train", "ppo", *words, "--out", str(out), "--tensorboard"]) == 0
    (file,) = (out / "tensorboard").iterdir()
    assert file.name.startswith("events.out.tfevents.")
    found = EventAccumulator(str(file)).Reload()
    assert {"rollout/ep_rew_mean", "train/value_loss", "validation/mean_reward"} <= set(found.Tags()["scalars"])
    rows = list(csv.DictReader((out / "progress.csv").read_text().splitlines()))
    losses = [(int(row["n_decisions"]), float(row["train/value_loss"])) for row in rows if row["train/value_loss"]]
    told = [(one.step, one.value) for one in found.Scalars("train/value_loss")]
    assert [step for step, _ in told] == [step for step, _ in losses]
    assert [value for _, value in told] == pytest.approx([value for _, value in losses], rel=1e-6)


def test_augmentation_asked_for_is_recorded(conf_file, tmp_path, capsys):
    out = tmp_path / "turned"
    words = ["--conf-file", conf_file, "--validation-memory", "half/10", "--score-seeds", "1", "--augment", "True"]
    assert main(["agent", "train", "ppo", *words, "--out", str(out), "--json"]) == 0
    header = load_agent(out / "agent.safetensors").header
    assert header.settings.augment
    assert " --augment True " in header.command
    assert main(["agent", "run", str(out / "agent.safetensors"), "--replay"]) == 0
    assert "reproduced exactly" in capsys.readouterr().out
