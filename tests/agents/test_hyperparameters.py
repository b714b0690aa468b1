"""Hyperparameters in RL Zoo's format: read without executing anything, every key and range checked."""

import pytest

from creative_nao.agents.settings import (
    ALGORITHMS,
    check_entry,
    find_algorithm,
    parse_literal,
    read_hyperparameters,
)
from creative_nao.envs import ENVIRONMENTS
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError

MENTAL = "CreativeNao/BoxingMental-v0"


@pytest.mark.parametrize("env_id", [name for name in ENVIRONMENTS if name[-3:] == "-v0" and "Rehearsal" not in name])
@pytest.mark.parametrize("algorithm", [name for name, one in ALGORITHMS.items() if not one.supervised])
def test_every_algorithm_ships_an_entry_for_every_environment_of_the_first_release(algorithm, env_id):
    found = read_hyperparameters(algorithm, env_id)
    assert found.algorithm == algorithm
    assert found.env_kwargs == {"memory": "train"}
    assert check_entry(algorithm, found.as_zoo(), "again") == found


def test_the_name_of_rl_zoo_leads_to_recurrent_ppo():
    assert find_algorithm("ppo_lstm") is ALGORITHMS["recurrent_ppo"]


def test_a_wrong_algorithm_brings_the_nearest():
    with pytest.raises(NotFoundError, match=r"no learning agent `saac` \(did you mean `sac`\?\); there are ppo, sac"):
        find_algorithm("saac")


@pytest.mark.parametrize(
    ("algorithm", "entry", "text"),
    [
        ("ppo", {"learning_rat": 0.1}, r"no setting `learning_rat` \(did you mean `learning_rate`\?\) of PPO"),
        ("ppo", {"train_freq": 1}, r"no setting `train_freq`.* of PPO"),
        ("ppo", {"verbose": 1}, "no setting `verbose`"),
        ("ppo", {"gamma": 1.5}, "here: `gamma` should be at most 1, but is 1.5"),
        ("ppo", {"learning_rate": "lin_-1"}, "`learning_rate` should be above 0"),
        ("ppo", {"n_envs": 0}, "here: `n_envs` should be at least 1, but is 0"),
        ("ppo", {"n_envs": 2.5}, "`n_envs` should be a whole number, but is 2.5"),
        ("ppo", {"n_epochs": "many"}, "`n_epochs` should be a whole number, but is 'many'"),
        ("ppo", {"use_sde": 1}, "`use_sde` should be true or false, but is 1"),
        ("ppo", {"batch_size": 7}, r"`batch_size` should divide n_envs \* n_steps = 2048, but is 7"),
        ("ppo", {"normalize": True}, "`normalize` should be false, but is True: observations already lie"),
        (
            "ppo",
            {"policy": "CnnPolicy"},
            r"`policy` should be MlpPolicy or creative_nao.*\.TryPolicy, but is 'CnnPolicy'",
        ),
        ("ppo", {"policy_kwargs": {"net_arc": []}}, r"no setting `net_arc` \(did you mean `net_arch`\?\) of MlpPolicy"),
        ("ppo", {"policy_kwargs": "dict(activation_fn=nn.Relu)"}, r"no activation `nn.Relu` \(did you mean `ReLU`\?\)"),
        ("ppo", {"noise_type": "normal", "noise_std": 0.1}, "`noise_type` is for algorithms with a replay buffer"),
        ("td3", {"noise_type": "pink", "noise_std": 0.1}, '`noise_type` should be "normal" with a `noise_std`'),
        ("sac", {"ent_coef": "auto_x"}, "`ent_coef` should be a number, but is 'x'"),
        ("sac", [1], "should be a mapping of names to values"),
    ],
)
def test_a_wrong_entry_is_named(algorithm, entry, text):
    with pytest.raises(SettingsError, match=text):
        check_entry(algorithm, entry, "here")


def test_an_entry_of_rl_zoo_s_own_manner_is_read():
    entry = {
        "n_envs": 8,
        "n_timesteps": "1e6",  # YAML reads 1e6, without a point, as text
        "policy": "MlpPolicy",
        "batch_size": 256,
        "learning_rate": "lin_3e-4",
        "policy_kwargs": "dict(log_std_init=-2, activation_fn=nn.ReLU, net_arch=dict(pi=[256, 256], vf=[256, 256]))",
    }
    found = check_entry("ppo", entry, "zoo")
    assert found.n_timesteps == 1_000_000
    assert found.sb3_arguments()["learning_rate"](0.5) == 1.5e-4
    assert found.policy_kwargs["net_arch"] == {"pi": [256, 256], "vf": [256, 256]}
    assert found.sb3_policy_kwargs()["activation_fn"].__name__ == "ReLU"
    assert check_entry("ppo", found.as_zoo(), "again") == found


@pytest.mark.parametrize(
    "text", ["__import__('os').system('false')", "dict(a=open('x'))", "[x for x in (1, 2)]", "dict(a=1", "nn.Tanh()"]
)
def test_nothing_in_a_settings_file_is_executed(text):
    with pytest.raises(SettingsError, match=r"`policy_kwargs`"):
        parse_literal(text, "`policy_kwargs`")


def test_a_missing_entry_and_a_missing_file_are_named(tmp_path):
    with pytest.raises(NotFoundError, match=r"ppo.yml: no entry `CreativeNao/BoxingMetal-v0` \(did you mean"):
        read_hyperparameters("ppo", "CreativeNao/BoxingMetal-v0")
    with pytest.raises(NotFoundError, match=r"no hyperparameter file at .*none.yml"):
        read_hyperparameters("ppo", MENTAL, tmp_path / "none.yml")


@pytest.mark.parametrize("content", ["[1, 2]", "a: b: c", "!!python/object/apply:os.system ['false']", "1: {}"])
def test_a_file_that_is_no_mapping_is_refused(content, tmp_path):
    path = tmp_path / "ppo.yml"
    path.write_text(content)
    with pytest.raises(FileFormatError, match=r"ppo\.yml"):
        read_hyperparameters("ppo", MENTAL, path)
