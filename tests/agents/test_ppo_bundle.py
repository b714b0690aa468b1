"""PPO learns in seconds, is decided by its seed, and comes out of its bundle bit for bit."""

import pickle

import numpy as np
import pytest

from creative_nao.agents import BundleHeader, PPOSettings, as_agent, load_agent, make_agent, save_bundle, train_ppo
from creative_nao.agents.bundle import KIND
from creative_nao.arrays import load_tensors, save_tensors
from creative_nao.errors import FileFormatError, NotFoundError, SettingsError

ENV = "fake_boxing:Fake/BoxingMental-v0"
TINY = PPOSettings(n_timesteps=240, n_envs=2, n_steps=60, batch_size=60, n_epochs=2, hidden=(8,))


def train(seed=0, settings=TINY, **kwargs):
    return train_ppo(ENV, settings=settings, seed=seed, env_kwargs={"memory": "fake/0"}, **kwargs)


def header(policy, settings=TINY):
    return BundleHeader("ppo", settings, ENV, "fake/0", 0, 240, policy.observation_space, policy.action_space)


@pytest.fixture(scope="module")
def policy():
    return train()[0]


@pytest.fixture
def bundle(policy, tmp_path):
    return save_bundle(tmp_path / "agent.safetensors", header(policy), policy)


def observations(n=50):
    return np.random.default_rng(0).uniform(-1.0, 1.0, (n, 4)).astype(np.float32)


def test_ppo_learns_in_seconds():
    """A fixed target: after 4,800 actions, the last tenth of the episodes earns far more than the first."""
    settings = PPOSettings(n_timesteps=4_800, n_envs=4, n_steps=60, batch_size=120, hidden=(32,))
    _, curve = train_ppo("fake_boxing:Fake/Target-v0", settings=settings, seed=0)
    tenth = len(curve.reward) // 10
    assert np.mean(curve.reward[-tenth:]) > np.mean(curve.reward[:tenth]) + 5.0


def test_the_same_seed_gives_the_same_policy(policy):
    predictions = [p.predict(observations(), deterministic=True)[0] for p in (policy, train(0)[0], train(1)[0])]
    assert np.array_equal(predictions[0], predictions[1])
    assert not np.array_equal(predictions[0], predictions[2])


def test_progress_counts_generated_actions():
    seen = []
    _, curve = train(progress=lambda done, planned: seen.append((done, planned)))
    assert seen == [(120, 240), (240, 240)]
    assert curve.n_actions == (60, 60, 120, 120, 180, 180, 240, 240)


def test_timesteps_round_up_to_whole_rollouts():
    assert PPOSettings(n_timesteps=241, n_envs=2, n_steps=60, batch_size=60).n_generated == 360


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"n_envs": 0}, "`n_envs` should be at least 1, but is 0"),
        ({"gamma": 1.5}, "`gamma` should be at most 1, but is 1.5"),
        ({"learning_rate": 0.0}, "`learning_rate` should be above 0, but is 0.0"),
        ({"batch_size": 7}, "`batch_size` should divide n_envs"),
        ({"hidden": ()}, "`hidden` should be a list of at least 1 entr"),
    ],
)
def test_a_setting_out_of_range_is_named(values, text):
    with pytest.raises(SettingsError, match=text):
        PPOSettings(**values)


def test_a_bundle_predicts_the_same_bits(policy, bundle):
    loaded = load_agent(bundle)
    batch = observations()
    likeliest = loaded.predict(batch, deterministic=True)[0]
    assert np.array_equal(likeliest, policy.predict(batch, deterministic=True)[0])
    one = loaded.predict(batch[0], deterministic=True)[0]
    assert np.array_equal(one, policy.predict(batch[0], deterministic=True)[0])
    assert not np.array_equal(likeliest, loaded.predict(batch + 0.1, deterministic=True)[0])


@pytest.mark.parametrize("name", ["ppo/BoxingMental-v0", "sac/BoxingMental-v0"])
def test_a_shipped_agent_acts_as_it_was_judged_and_says_how(name):
    """Without being told: drawn actions where its score was played with drawn ones, also as an agent."""
    import torch

    trained = load_agent(name)
    seen = np.zeros((64, *trained.header.observation_space.shape), np.float32)
    judged = trained.header.deterministic
    torch.manual_seed(0)
    default = trained.predict(seen)[0]
    torch.manual_seed(0)
    assert np.array_equal(default, trained.predict(seen, deterministic=judged)[0])
    torch.manual_seed(0)
    assert not np.array_equal(default, trained.predict(seen, deterministic=not judged)[0])
    agent = as_agent(trained)
    assert agent.deterministic == judged
    assert ("drawn" in repr(agent)) is not judged
    assert as_agent(trained, deterministic=not judged).deterministic is not judged


def test_a_bundle_says_what_made_it(bundle):
    found = load_agent(bundle).header
    assert (found.agent, found.env, found.memory, found.seed) == ("ppo", ENV, "fake/0", 0)
    assert found.settings == TINY
    assert found.action_space.shape == (2,)
    assert "torch" in found.versions


def test_two_bundles_of_one_policy_are_equal_files(policy, tmp_path):
    one, two = (save_bundle(tmp_path / name, header(policy), policy) for name in ("a", "b"))
    assert one.read_bytes() == two.read_bytes()


def test_a_stochastic_policy_draws_from_the_episode_s_own_generator(policy, tmp_path, make_context):
    import dataclasses

    settings = dataclasses.replace(TINY, deterministic=False)
    agent = make_agent("ppo", save_bundle(tmp_path / "agent", header(policy, settings), policy))
    chosen = []
    for seed in (1, 1, 2):
        agent.begin(make_context(seed=seed))
        chosen.append(agent.ask(observations(1)[0]))
    assert np.array_equal(chosen[0], chosen[1])
    assert not np.array_equal(chosen[0], chosen[2])


def test_a_missing_bundle_says_where(tmp_path):
    with pytest.raises(NotFoundError, match=r"no agent bundle file at .*nowhere"):
        load_agent(tmp_path / "nowhere")


def rewrite(bundle, change_header=None, change_weights=None):
    """Write the bundle again with its header or its weights changed."""
    described, weights = load_tensors(bundle, kind=KIND)
    if change_header:
        change_header(described)
    if change_weights:
        change_weights(weights)
    save_tensors(bundle, kind=KIND, header=described, tensors=weights)


FIRST = "mlp_extractor.policy_net.0.weight"


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda h: h.pop("settings"), "header: `settings` is missing"),
        (lambda h: h["settings"].update(gamma=2.0), "header: `settings`: `gamma` should be at most 1"),
        (lambda h: h["settings"].update(gama=0.9), r"header: `settings`: no key `gama` \(did you mean `gamma`\?\)"),
        (lambda h: h["settings"].update(hidden="wide"), "header: `settings`: `hidden` should be a list"),
        (lambda h: h.update(format_version=99), "header: `format_version` should be 1, .* but is 99"),
        (
            lambda h: h["observation_space"].update(low=[0.0]),
            "header: `observation_space`: `low` and `high` should hold 4 numbers",
        ),
        (lambda h: h.update(seed="zero"), "header: `seed` should be a whole number, but is 'zero'"),
    ],
)
def test_a_damaged_header_names_the_part(bundle, change, text):
    rewrite(bundle, change_header=change)
    with pytest.raises(FileFormatError, match=text):
        load_agent(bundle)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda w: w.pop(FIRST), f"the array `{FIRST}` is missing"),
        (lambda w: w.update({FIRST: w[FIRST][:, :2]}), rf"the array `{FIRST}` should have shape \(8, 4\)"),
        (
            lambda w: w.update({FIRST: np.full_like(w[FIRST], np.nan)}),
            f"the array `{FIRST}` should hold finite numbers",
        ),
        (lambda w: w.update(spare=w[FIRST]), "the array `spare` belongs to no part"),
    ],
)
def test_damaged_weights_are_named(bundle, change, text):
    rewrite(bundle, change_weights=change)
    with pytest.raises(FileFormatError, match=text):
        load_agent(bundle)


def test_a_torn_bundle_is_called_torn(bundle):
    bundle.write_bytes(bundle.read_bytes()[:-100])
    with pytest.raises(FileFormatError, match=r"the array `.*` is torn"):
        load_agent(bundle)


def test_a_pickle_is_not_opened(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("unpickled",))

    path = tmp_path / "agent.pkl"
    path.write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(FileFormatError, match=r"agent\.pkl: no agent bundle file"):
        load_agent(path)


def test_a_bundle_of_another_agent_is_refused(policy, tmp_path):
    import dataclasses

    other = save_bundle(tmp_path / "agent", dataclasses.replace(header(policy), agent="sac"), policy)
    with pytest.raises(SettingsError, match=r"`bundle` should hold a `ppo` agent, but .* holds `sac`"):
        make_agent("ppo", other)
