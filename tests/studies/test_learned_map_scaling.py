"""The scaling study: the same episodes for all, what is finished is not done again, and a figure is drawn."""

import doctest
import json

import learned_map_scaling
import pytest
from learned_map_scaling import ScalingSettings

from creative_nao.agents.learned_map.truth import kept_truth, truth_file
from creative_nao.model import load_memory


def test_the_examples_hold():
    assert doctest.testmod(learned_map_scaling).failed == 0


@pytest.mark.slow
def test_the_study_runs_and_goes_on(tmp_path, monkeypatch, tiny_memory):
    shipped = {"train": ("half/0",), "validation": ("open/10",)}
    monkeypatch.setattr(learned_map_scaling, "split_memories", shipped.__getitem__)
    monkeypatch.setattr(learned_map_scaling, "PLAYED_SEEDS", range(1))
    folders = tmp_path / "memories", tmp_path / "held-out"
    for folder, name, memory in zip(folders, ("half-100", "open-101"), ("half/1", "open/11"), strict=True):
        load_memory(memory).save(folder / f"{name}.safetensors")
        kept_truth(load_memory(memory), truth_file(folder, name), name)
    recipe = tmp_path / "tiny.yml"
    recipe.write_text(
        f"{learned_map_scaling.ENV}: {{batch_size: 2, n_queries: 4, policy_kwargs: {{width: 8, n_heads: 1}}}}"
    )
    settings = ScalingSettings(
        tmp_path / "out",
        *folders,
        sizes=(1, 50),
        timesteps=4,
        conf_file=recipe,
        rules=("random",),
        docs=tmp_path / "docs",
    )
    result = learned_map_scaling.run(settings)
    assert [(row["agent"], row.get("n_memories")) for row in result["rows"]] == [
        ("random", None), ("learned_map", 1), ("learned_map", 2)
    ]  # fmt: skip
    assert [*result["rows"][0]["rewards"]] == ["open/10", "open-101"]
    assert (tmp_path / "docs" / "images" / "learned_map_scaling.svg").is_file()
    monkeypatch.delattr(learned_map_scaling, "train_map")
    assert json.loads((tmp_path / "docs" / "learned_map_scaling.json").read_text())["rows"] == result["rows"]
    assert learned_map_scaling.run(settings)["rows"] == result["rows"]
