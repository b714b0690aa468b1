"""The pictures of what a learned map expects show what is true of the memory at every moment."""

import gymnasium as gym
import make_belief_images
import numpy as np
import pytest
from make_belief_images import ENV, MEMORY, SEED, moments
from PIL import Image

from creative_nao.maps import pb_grid


def test_every_moment_shows_what_the_environment_would_pay_now():
    seen = moments("random", n_cells=4, n_actions=3)
    assert [len(one.tries) for one in seen] == [0, 1, 2, 3]
    env = gym.make(ENV, memory=MEMORY, n_actions=3, n_imagined=64)
    env.reset(seed=SEED)
    earned = 0.0
    for moment in seen:
        now = env.unwrapped.imagine(pb_grid(4))
        np.testing.assert_array_equal(moment.usable.ravel(), now["appropriate"])
        np.testing.assert_allclose(moment.reward.ravel(), now["reward_novelty"], rtol=1e-6)
        assert moment.earned == pytest.approx(earned)
        if moment.next_pb is not None:
            earned += env.step(moment.next_pb)[1]
    assert seen[-1].next_pb is None
    assert seen[-1].chance is None  # it expects nothing
    env.close()


@pytest.mark.slow
def test_the_pictures_of_the_belief_and_of_the_race_have_every_try(monkeypatch, tmp_path):
    monkeypatch.setattr(make_belief_images, "IMAGES", tmp_path)
    monkeypatch.setattr(make_belief_images, "N_CELLS", 9)
    make_belief_images.belief()
    make_belief_images.race()
    for name, n_frames in (("belief.png", 1), ("belief.gif", 31), ("race.gif", 31)):
        with Image.open(tmp_path / name) as picture:
            assert getattr(picture, "n_frames", 1) == n_frames
