"""Episodes written for Minari: its own tools read them, and playing the actions again earns the same rewards."""

import numpy as np
import pytest

from creative_nao.agents import make_agent
from creative_nao.agents.record import FOLDER, record_dataset
from creative_nao.errors import NotFoundError, SettingsError

MENTAL, DATASET = "CreativeNao/BoxingMental-v0", "creative_nao/BoxingMental/test-v0"


@pytest.mark.slow
def test_minari_reads_the_dataset_and_its_environment_pays_the_same_again(tmp_path, monkeypatch):
    import minari

    path = record_dataset(make_agent("random@2"), MENTAL, "validation", [0, 1], tmp_path, DATASET)
    assert path == tmp_path / DATASET
    monkeypatch.setenv(FOLDER, str(tmp_path))
    assert list(minari.list_local_datasets()) == [DATASET]
    dataset = minari.load_dataset(DATASET)
    assert (dataset.total_episodes, dataset.total_steps) == (12, 360)
    env = dataset.recover_environment()
    for episode in dataset.iterate_episodes([0, 11]):
        seed = int(dataset.storage.get_episode_metadata([episode.id]).__iter__().__next__()["seed"])
        options = {"memory": "open/10" if episode.id == 0 else "closed/11"}
        observation, _ = env.reset(seed=seed, options=options)
        assert np.array_equal(observation, episode.observations[0])
        for step, action in enumerate(episode.actions):
            observation, reward, terminated, truncated, _ = env.step(action)
            assert reward == episode.rewards[step]
            assert (terminated, truncated) == (episode.terminations[step], episode.truncations[step])
            assert np.array_equal(observation, episode.observations[step + 1])
    with pytest.raises(SettingsError, match=f"there is a dataset `{DATASET}`"):
        record_dataset(make_agent("random"), MENTAL, "half/10", [0], tmp_path, DATASET)


def test_names_that_minari_does_not_take_are_refused_in_one_line(tmp_path):
    with pytest.raises(SettingsError, match="`dataset_id` should be a name as"):
        record_dataset(make_agent("random"), MENTAL, "half/10", [0], tmp_path, "../outside")
    with pytest.raises(NotFoundError, match="BoxingMental"):
        record_dataset(make_agent("random"), "CreativeNao/BoxingMentl-v0", "half/10", [0], tmp_path, DATASET)
