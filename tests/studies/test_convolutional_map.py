"""The convolutional form of the learned map: what it is told and tells, where it reads its grid, and the study."""

import json

import convolutional_map
import numpy as np
import pytest
import torch
from convolutional_map import ConvolutionalMap, FormsSettings, GridNetwork, MeanMap
from gymnasium.spaces import Box

from creative_nao.agents.learned_map.network import SCALES, AttentiveMap, expected
from creative_nao.agents.learned_map.truth import kept_truth, truth_file
from creative_nao.envs.observation import layout, observation_space, try_columns
from creative_nao.errors import SettingsError
from creative_nao.maps import pb_grid
from creative_nao.model import load_memory

SMALL = {"width": 8, "n_heads": 2, "n_asked": 16}


def made(n_pb=2, kind=ConvolutionalMap, **settings):
    torch.manual_seed(0)
    told = observation_space(layout(6, n_pb, n_rows=30), try_columns(6, n_pb))
    return kind(told, Box(-1.0, 1.0, (n_pb,), np.float32), **SMALL, **settings).eval()


def test_a_point_of_the_grid_reads_its_own_cell():
    resolution = 8
    pb = torch.from_numpy(pb_grid(resolution)).float()
    level = pb.T.reshape(1, 2, resolution, resolution)  # each cell holds its own place
    assert torch.allclose(GridNetwork.read([level], pb[None])[0], pb, atol=1e-6)
    between = torch.tensor([[[0.123, -0.77]]])
    assert torch.allclose(GridNetwork.read([level], between), between, atol=1e-6)


def test_kernels_are_normal_ones_of_every_width():
    far = torch.rand(1, 3, 4, generator=torch.Generator().manual_seed(0))
    for scale, kernel in zip(SCALES, ConvolutionalMap.kernels(far), strict=True):
        assert torch.allclose(kernel, torch.exp(far / (-2.0 * scale**2)), atol=1e-6)


@pytest.mark.parametrize("n_layers", [0, 1])
def test_it_has_the_interface_of_the_attentive_form(n_layers):
    policy, random = made(n_layers=n_layers, channels=4, resolution=8, told=2), np.random.default_rng(0)
    points, pb = random.uniform(-1, 1, (1, 6, 2)), random.uniform(-1, 1, (1, 5, 2))
    rows = np.zeros((1, 3, policy.columns[-1].stop))
    rows[0, 0, [0, 1, 2, 3]] = 1.0, 0.5, -0.5, 1.0
    known = [torch.from_numpy(one.astype(np.float32)) for one in (points, rows, rows[..., 0])]
    told = policy(*known, torch.from_numpy(pb.astype(np.float32)))
    assert told.shape == (1, 5, 3 + 6)
    fewer = policy(*(one[:, :n] for one, n in zip(known, (6, 1, 1), strict=True)), torch.from_numpy(pb).float())
    assert torch.allclose(told, fewer, atol=1e-5)  # empty rows tell nothing
    told.sum().backward()
    unread = [name for name, one in policy.named_parameters() if one.grad is None or not one.grad.any()]
    assert not [name for name in unread if name.startswith(("grid", "told", "enter", "mix"))]
    observation = np.zeros(policy.observation_space.shape, np.float32)
    assert policy.predict(observation)[0].shape == (2,)


def test_maps_together_expect_the_mean_reward():
    maps = made(kind=AttentiveMap), made(n_layers=0, channels=4, resolution=8, told=2)
    known = torch.zeros(1, 6, 2), torch.zeros(1, 0, maps[0].columns[-1].stop), torch.zeros(1, 0)
    pb = torch.rand(1, 4, 2, generator=torch.Generator().manual_seed(0))
    both = MeanMap(maps)
    usable, far, _ = expected(both.decode(both.encode(*known), pb))
    wanted = [expected(one(*known, pb)) for one in maps]
    assert torch.allclose(usable * far, sum(p * d for p, d, _ in wanted) / 2, atol=1e-5)
    assert torch.allclose(usable, sum(p for p, _, _ in wanted) / 2, atol=1e-5)


@pytest.mark.parametrize(("n_pb", "resolution"), [(4, 8), (2, 10)])
def test_what_has_no_grid_is_refused(n_pb, resolution):
    with pytest.raises(SettingsError, match="multiple of 4 cells"):
        made(n_pb, resolution=resolution)


@pytest.mark.slow
def test_the_study_runs_and_goes_on(tmp_path, monkeypatch):
    shipped = {"train": ("half/0",), "validation": ("open/10",)}
    monkeypatch.setattr(convolutional_map, "split_memories", shipped.__getitem__)
    monkeypatch.setattr(convolutional_map, "PLAYED_SEEDS", range(2))
    folders = tmp_path / "memories", tmp_path / "held-out"
    for folder, name, memory in zip(folders, ("half-100", "open-101"), ("half/1", "open/11"), strict=True):
        folder.mkdir()
        kept_truth(load_memory(memory), truth_file(folder, name), name)
    recipe = tmp_path / "tiny.yml"
    recipe.write_text(
        f"{convolutional_map.ENV}: {{batch_size: 2, n_queries: 4, policy_kwargs: {{width: 8, n_heads: 1}}}}"
    )
    settings = FormsSettings(
        tmp_path / "out", *folders, forms=("attentive", "convolutional", "attentive+convolutional"), timesteps=4,
        conf_file=recipe, docs=tmp_path / "docs",
    )  # fmt: skip
    result = convolutional_map.run(settings)
    assert [row["form"] for row in result["rows"]] == [*settings.forms]
    assert result["n_memories"] == 2
    assert [len(one) for row in result["rows"] for one in row["rewards"].values()] == 6 * [2]
    assert result["rows"][0]["milliseconds_a_step"] > 0.0
    monkeypatch.delattr(convolutional_map, "train_map")
    assert json.loads((tmp_path / "docs" / "convolutional_map.json").read_text())["rows"] == result["rows"]
    assert convolutional_map.run(settings)["rows"] == result["rows"]
    with pytest.raises(SettingsError, match="`forms`"):
        convolutional_map.run(FormsSettings(tmp_path, *folders, forms=("attentive+other",)))
