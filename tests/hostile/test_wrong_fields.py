"""A field of the wrong kind, size or number is refused by the name of the file and of the field, before it costs."""

import io
import json
import resource
import time
import zipfile

import numpy as np
import pytest
from safetensors.numpy import load, save
from victims import ARCHIVES, ENV, EPISODES, TENSORS

from creative_nao.errors import CreativeNaoError, FileFormatError, SettingsError

HUGE = 10**30


def refuse(victim, path, *parts):
    """Refused within a second and 20 MB by a message with the file's name and these parts."""
    grown, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    with pytest.raises(CreativeNaoError) as caught:
        victim.load(path)
    assert time.process_time() - start < 1.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - grown < 20_000, "kilobytes"
    for part in (path.name, *parts):
        assert part in str(caught.value)


def with_tensors(victim, path, change_header=None, change_arrays=None):
    """Write a safetensors file again with its header or its arrays changed; its frame stays whole."""
    content = victim.path.read_bytes()
    length = int.from_bytes(content[:8], "little")
    header = json.loads(json.loads(content[8 : 8 + length])["__metadata__"]["creative_nao"])
    header.pop("sha256", None), header.pop("arrays_sha256", None)
    arrays = load(content)
    if change_header is not None:
        change_header(header)
    if change_arrays is not None:
        change_arrays(arrays)
    path.write_bytes(save(arrays, {"creative_nao": json.dumps(header)}))
    return path


def with_archive(victim, path, change_header=None, change_arrays=None):
    """Write an NPZ file again with its header or its arrays changed."""
    with np.load(victim.path) as found:
        arrays = dict(found)
    if change_header is not None:
        header = json.loads(arrays["header"].tobytes())
        change_header(header)
        arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    if change_arrays is not None:
        change_arrays(arrays)
    np.savez(path, **arrays)
    return path


def put(**values):
    """Change fields of a header; ``a__b`` is the field b of the object a; `...` takes a field away."""

    def change(header):
        for name, value in values.items():
            *outer, last = name.split("__")
            inner = header
            for part in outer:
                inner = inner[part]
            if value is ...:
                del inner[last]
            else:
                inner[last] = value

    return change


HEADERS = [
    ("memory", "network", {"network": ...}),
    ("memory", "network", {"network": []}),
    ("memory", "layer_sizes", {"network__layer_sizes": [10**9]}),
    ("memory", "layer_sizes", {"network__layer_sizes": [1] * 1000}),
    ("memory", "layer_sizes", {"network__layer_sizes": [True]}),
    ("memory", "layer_sizes", {"network__layer_sizes": [3.0]}),
    ("memory", "layer_sizes", {"network__layer_sizes": [-3]}),
    ("memory", "layer_sizes", {"network__layer_sizes": "333"}),
    ("memory", "parameter/w_in", {"network__layer_sizes": [4]}),
    ("memory", "n_softmax_units", {"network__n_softmax_units": 10**9}),
    ("memory", "n_pb", {"network__n_pb": HUGE}),
    ("memory", "parameter/w_pb", {"network__n_pb": 3}),
    ("memory", "time_constants", {"network__time_constants": ["2"]}),
    ("memory", "time_constants", {"network__time_constants": [1e300]}),
    ("memory", "sigma", {"network__sigma": True}),
    ("memory", "sigma", {"network__sigma": 1e-300}),
    ("memory", "sigma_unit", {"network__sigma_unit": []}),
    ("memory", "surplus", {"network__surplus": 1}),
    ("memory", "n_epochs", {"training__n_epochs": 0}),
    ("memory", "seed", {"training__seed": True}),
    ("memory", "closed_loop_ratio", {"training__closed_loop_ratio": "0.5"}),
    ("memory", "format_version", {"format_version": True}),
    ("memory", "format_version", {"format_version": 2}),
    ("memory", "joints", {"joints": "RElbowYaw"}),
    ("memory", "joints", {"joints": ["a\nb"]}),
    ("memory", "actions", {"actions": ["rise", "rise"]}),
    ("memory", "actions", {"actions": ["x" * 300, "fall"]}),
    ("memory", "parameter/rho", {"actions": ["rise", "fall", "more"]}),
    ("memory", "dt_s", {"dt_s": -0.1}),
    ("memory", "dt_s", {"dt_s": 1e300}),
    ("memory", "dt_s", {"dt_s": "0.1"}),
    ("memory", "best_loss", {"best_loss": None}),
    ("memory", "best_epoch", {"best_epoch": -1}),
    ("memory", "loss_every", {"loss_every": 0}),
    ("memory", "record", {"record": [["a", 1]]}),
    ("checkpoint", "layer_sizes", {"network__layer_sizes": [10**9]}),
    ("checkpoint", "seed", {"training__seed": False}),
    ("checkpoint", "network", {"network": None}),
    ("checkpoint", "best_epoch", {"best_epoch": 5}),
    ("checkpoint", "best_epoch", {"best_epoch": True}),
    ("checkpoint", "best_loss", {"best_loss": "small"}),
    ("checkpoint", "demonstrations", {"demonstrations": ...}),
    ("bundle", "hidden", {"settings__hidden": [10**9]}),
    ("bundle", "hidden", {"settings__hidden": [4000] * 16}),
    ("bundle", "no weights have that size", {"settings__hidden": [4000]}),
    ("bundle", "hidden", {"settings__hidden": [True]}),
    ("bundle", "n_steps", {"settings__n_steps": 10**18}),
    ("bundle", "n_envs", {"settings__n_envs": True}),
    ("bundle", "n_envs", {"settings__n_envs": 10**9}),
    ("bundle", "batch_size", {"settings__batch_size": 0.5}),
    ("bundle", "learning_rate", {"settings__learning_rate": "fast"}),
    ("bundle", "log_std_init", {"settings__log_std_init": 1e300}),
    ("bundle", "observation_space", {"observation_space__shape": [10**9]}),
    ("bundle", "observation_space", {"observation_space__shape": [1, 2]}),
    ("bundle", "observation_space", {"observation_space__dtype": "object"}),
    ("bundle", "observation_space", {"observation_space__low": [2.0, 2.0]}),
    ("bundle", "observation_space", {"observation_space__high": [1e300, 1.0]}),
    ("bundle", "action_space", {"action_space": "Box"}),
    ("bundle", "seed", {"seed": True}),
    ("bundle", "seed", {"seed": -1}),
    ("bundle", "versions", {"versions": [1]}),
    ("bundle", "score", {"score": {"env": ENV, "deterministic": True, "episodes": []}}),
    ("bundle", "score", {"score": {"env": ENV, "deterministic": 1, "episodes": [{"memory": "a", "seed": 0}]}}),
    ("zoo_bundle", "net_arch", {"settings__policy_kwargs": {"net_arch": [10**9]}}),
    ("zoo_bundle", "net_arch", {"settings__policy_kwargs": {"net_arch": [1] * 1000}}),
    ("zoo_bundle", "weights", {"settings__policy_kwargs": {"net_arch": {"pi": [3], "qf": [4000] * 8}}}),
    ("zoo_bundle", "no weights have that size", {"settings__policy_kwargs": {"net_arch": [1000]}}),
    ("zoo_bundle", "n_critics", {"settings__policy_kwargs": {"net_arch": [3], "n_critics": 10**6}}),
    ("zoo_bundle", "optimizer_class", {"settings__policy_kwargs": {"optimizer_class": "os.system"}}),
    ("zoo_bundle", "features_extractor_class", {"settings__policy_kwargs": {"features_extractor_class": "x"}}),
    ("zoo_bundle", "buffer_size", {"settings__buffer_size": 10**12}),
    ("zoo_bundle", "no learning agent `sarsa`", {"algorithm": "sarsa"}),
    ("state", "of", {"of": 3}),
    ("state", "values", {"values": [1]}),
    ("agent_checkpoint", "plan", {"plan": [1]}),
    ("agent_checkpoint", "seed", {"plan__seed": 1}),
    ("agent_checkpoint", "state", {"state": ...}),
    ("agent_checkpoint", "format_version", {"format_version": 1.0}),
    ("map", "resolution", {"resolution": 10**9}),
    ("map", "resolution", {"resolution": True}),
    ("map", "resolution", {"resolution": -2}),
    ("map", "outcome", {"resolution": 3}),
    ("map", "names", {"names": "rise"}),
    ("map", "learned_pb", {"names": ["rise", "fall"]}),
    ("map", "record", {"record": [["a", 1]]}),
    ("map", "settings", {"record": {"settings": 3}}),
    ("physical", "resolution", {"resolution": 4001}),
    ("physical", "n_done", {"n_done": -1}),
    ("physical", "n_done", {"n_done": 5}),
    ("physical", "outcomes", {"outcomes": ["learned", "flying"]}),
    ("physical", "wall_s", {"wall_s": "1"}),
    ("physical", "cpu_s", {"cpu_s": -1.0}),
    ("unfinished", "n_done", {"n_done": HUGE}),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "part", "changes"), HEADERS)
def test_a_wrong_field_of_a_header_is_named(kind, part, changes, victims, tmp_path):
    victim = victims[kind]
    write = with_archive if kind in ARCHIVES else with_tensors
    refuse(victim, write(victim, tmp_path / f"wrong-{victim.path.name}", put(**changes)), part)


CHANGES = {
    "missing": lambda arrays, name: arrays.pop(name),
    "surplus": lambda arrays, name: arrays.update(spare=arrays[name]),
    "a shape with one axis more": lambda arrays, name: arrays.update({name: arrays[name][None]}),
    "longer": lambda arrays, name: arrays.update({name: np.concatenate([arrays[name], arrays[name]])}),
    "whole numbers": lambda arrays, name: arrays.update({name: arrays[name].astype(np.int64)}),
    "truth values": lambda arrays, name: arrays.update({name: arrays[name].astype(bool)}),
    "NaN": lambda arrays, name: arrays.update({name: np.full_like(arrays[name], np.nan)}),
    "infinities": lambda arrays, name: arrays.update({name: np.full_like(arrays[name], -np.inf)}),
    "beyond float32": lambda arrays, name: arrays.update({name: np.full(arrays[name].shape, 1e300)}),
}
ARRAY = {
    "memory": "parameter/rho", "checkpoint": "vector", "bundle": "action_net.weight", "zoo_bundle": "actor.mu.weight",
    "state": "x", "agent_checkpoint": "record.episode_rewards", "map": "distance", "physical": "distance",
    "unfinished": "hits", "motion_npz": "angles", "truth": "distances", "body_sense": "w0",
}  # fmt: skip
MAY_BE = {
    *(("state", change) for change in CHANGES if change not in ("NaN", "infinities")),  # its environment checks it
    ("agent_checkpoint", "beyond float32"), ("motion_npz", "longer"), ("motion_npz", "whole numbers"),
}  # fmt: skip
NAMED = {("motion_npz", change): "RElbowYaw" for change in ("NaN", "infinities", "beyond float32")}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("kind", [*TENSORS, *ARCHIVES])
def test_a_wrong_array_is_named(kind, change, victims, tmp_path):
    victim, name = victims[kind], ARRAY[kind]
    write = with_archive if kind in ARCHIVES else with_tensors
    path = write(
        victim, tmp_path / f"wrong-{victim.path.name}", None, lambda arrays: CHANGES[change](arrays, name)
    )  # fmt: skip
    if (kind, change) in MAY_BE:
        victim.use(victim.load(path))
    else:
        refuse(victim, path, "spare" if change == "surplus" else NAMED.get((kind, change), name))


SETTINGS = [
    ("toml", "n_seeds", "n_seeds = 1000000000000"),
    ("toml", "n_seeds", "n_seeds = true"),
    ("toml", "n_seeds", "n_seeds = -1"),
    ("toml", "n_actions", "n_actions = 1e3"),
    ("toml", "resolution", "resolution = 100000"),
    ("toml", "episodes", "n_seeds = 10000\n[taught]\nseeds = [" + ",".join(map(str, range(200))) + "]"),
    ("toml", "memories", "memories = 3"),
    ("toml", "memories", "memories = [[1]]"),
    ("toml", "envs", "envs = 5"),
    ("toml", "taught", "taught = 5"),
    ("toml", "seeds", "[taught]\nseeds = [1180591620717411303424]"),
    ("toml", "n_epochs", "[taught]\nseeds = [1]\nn_epochs = 1000000000000"),
    ("toml", "closed_loop_ratio", "[taught]\nseeds = [1]\nclosed_loop_ratio = nan"),
    ("toml", "ppo", "ppo = 'x'"),
    ("toml", "hidden", "[ppo]\nhidden = [1000000000]"),
    ("toml", "learning_rate", "[ppo]\nlearning_rate = inf"),
    ("toml", "n_envs", "[ppo]\nn_envs = 1000000000000"),
    ("toml", "name", "name = '../../up'"),
    ("toml", "name", "name = 1979-05-27"),
    ("toml", "seconds_per_action", "seconds_per_action = 'x'"),
    ("toml", "os:abort", "agents = ['os:abort']"),
    ("toml", "antigravity:X-v0", "envs = ['antigravity:X-v0']"),
    ("yaml", "n_timesteps", "n_timesteps: 1e300"),
    ("yaml", "n_timesteps", "n_timesteps: true"),
    ("yaml", "n_envs", "n_envs: 1000000000"),
    ("yaml", "n_envs", "n_envs: -1"),
    ("yaml", "n_steps", "n_steps: 1000000000000"),
    ("yaml", "n_steps", "n_steps: 1000000\n  n_envs: 4096"),
    ("yaml", "batch_size", "batch_size: .nan"),
    ("yaml", "gamma", "gamma: .inf"),
    ("yaml", "line 2: `9999", "learning_rate: " + "9" * 400),
    ("yaml", "net_arch", "policy_kwargs: {net_arch: [1000000000]}"),
    ("yaml", "policy_kwargs", "policy_kwargs: {optimizer_class: os.system}"),
    ("yaml", "policy_kwargs", 'policy_kwargs: "__import__(\'os\').getcwd()"'),
    ("yaml", "gamma", "gamma: 0.5\n  gamma: 0.6"),
    ("yaml", "n_epochs", "n_epochs: 1000000000"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "part", "text"), SETTINGS)
def test_a_setting_beyond_reason_is_named(kind, part, text, victims, tmp_path):
    path = tmp_path / victims[kind].path.name
    if kind == "yaml":
        path.write_text(f"{ENV}:\n  {text}\n")
    else:
        good = {"agents": '["random"]', "envs": f'["{ENV}"]', "memories": '["half/0"]'}
        rest = "".join(f"{name} = {value}\n" for name, value in good.items() if not text.startswith(f"{name} ="))
        path.write_text(rest + text + "\n")
    refuse(victims[kind], path, part)


DOCUMENTS = [
    ("session", "points", {"favourites": [{"memory": "a", "points": [["0.1", "0.2"]], "note": ""}]}),
    ("session", "points", {"favourites": [{"memory": "a", "points": [[True, False]], "note": ""}]}),
    ("session", "points", {"favourites": [{"memory": "a", "points": [[2, 0]], "note": ""}]}),
    ("session", "note", {"favourites": [{"memory": "a", "points": [[0, 0]], "note": "\ud800"}]}),
    ("session", "entry 1", {"favourites": [3]}),
    ("session", "format_version", {"format_version": True}),
    ("record", "versions", {"versions": {"numpy": 2}}),
    ("record", "command", {"command": None}),
    ("record", "suite", {"settings": {"suite": []}}),
    ("record", "seconds", {"seconds": "long"}),
    ("results", "rows", {"rows": {"a": 1}}),
    ("results", "entry 1", {"rows": [1]}),
    ("results", "n_seeds", {"rows": [{"n_seeds": -1}]}),
    ("results", "reward", {"rows": [{"reward": {"mean": "1"}}]}),
    ("results", "high", {"rows": [{"reward": {"mean": 1, "low": 1}}]}),
    ("results", "reward_per_seed", {"rows": [{"reward_per_seed": {"-1": 2.0}}]}),
    ("published", "suite", {"suite": "../../up"}),
    ("published", "summary", {"summary": 1}),
    ("published", "n_memories", {"summary": [{"agent": "a", "env": "b", "n_memories": 0}]}),
    ("job", "name", {"name": "../../up"}),
    ("job", "needs", {"needs": [1]}),
    ("job", "seconds", {"seconds": -1}),
    ("job", "more", {"more": 1}),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "part", "changes"), DOCUMENTS)
def test_a_wrong_field_of_a_document_is_named(kind, part, changes, victims, tmp_path):
    content = json.loads(victims[kind].path.read_text()) | changes
    content.pop("sha256")
    path = tmp_path / f"wrong-{victims[kind].path.name}"
    path.write_text(json.dumps(content))
    with pytest.raises(FileFormatError) as caught:
        victims[kind].load(path)
    assert part in str(caught.value)
    assert path.name in str(caught.value) or str(tmp_path) in str(caught.value)


TABLES = [
    ("episodes", "pb_1", "agent,pb_2\nrandom,0.5\n"),
    ("episodes", "pb_1", EPISODES.replace(",", ";")),
    ("episodes", "line 2: should have 9 cells", EPISODES.replace(",0\n", "\n", 1)),
    ("episodes", "line 2: pb_1", EPISODES.replace("0.25", "half")),
    ("episodes", "line 2: pb_1", EPISODES.replace("0.25", '"0,25"')),
    ("episodes", "line 3: pb_2", EPISODES.replace("0.5,unlearned", "\0,unlearned")),
    ("episodes", "line 3: pb_2", EPISODES.replace("0.5,unlearned", "nan,unlearned")),
    ("episodes", "line 3: outcome", EPISODES.replace("unlearned", "taught")),
    ("episodes", "line 3: step should be 2", EPISODES.replace("0,2,0.5", "0,3,0.5")),
    ("episodes", "line 2: seed", EPISODES.replace("half/0,0,1", "half/0,-1,1")),
    ("episodes", "pb_1", EPISODES.replace("pb_2", "pb_1")),
    ("episodes", "line", EPISODES + "9" * 200_000 + "\n"),
    ("training_log", "n_decisions", "n_decisions,loss\nmany,1\n"),
    ("csv", "line 3", "time_s,RElbowYaw\n0,0\n1e-9,0\n"),
    ("csv", "line 3: has the time 1e+300", "time_s,RElbowYaw\n0,0\n1e300,0\n"),
    ("csv", "cells", "time_s,RElbowYaw\n" + "," * 1_200_001),
    ("motion_csv", "angle 1e+300", "time_s,RElbowYaw\n0,0\n1,1e300\n"),
    ("motion_csv", "time", "time_s,RElbowYaw\n-1e300,0\n1e300,0\n"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "part", "text"), TABLES)
def test_a_wrong_cell_is_named(kind, part, text, victims, tmp_path):
    path = tmp_path / f"wrong-{victims[kind].path.name}"
    path.write_text(text)
    with pytest.raises(FileFormatError) as caught:
        victims[kind].load(path)
    assert part in str(caught.value)
    assert path.name in str(caught.value) or str(tmp_path) in str(caught.value)


def test_a_line_of_a_million_lists_takes_no_longer_than_its_length(victims, tmp_path):
    path = tmp_path / "long.yaml"
    start = time.process_time()
    for text in ("a: [" + "[1]," * 300_000 + "]", "a: " + "1" * 1_000_000 + "x", "a: " + " " * 1_000_000 + "x"):
        path.write_text(f"joint_names: [RElbowYaw]\n{text}\n")
        with pytest.raises(FileFormatError):
            victims["motion_ros"].load(path)
    assert time.process_time() - start < 5.0


def test_an_array_twice_in_an_archive_is_refused(victims, tmp_path):
    path = tmp_path / "twice.npz"
    path.write_bytes(victims["map"].path.read_bytes())
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr("distance.npy", b"x")
    refuse(victims["map"], path, "`distance` is in it twice")


def test_an_action_cannot_be_written_outside_its_folder(tmp_path):
    from creative_nao.demonstrations import Demonstrations, save_demonstrations

    wave = np.linspace(0.1, 0.5, 4)[:, None]
    for name in ("../up", "a/b", "a\\b", ".hidden", "C:x"):
        demos = Demonstrations((name,), [wave], 0.1, ("RElbowYaw",))
        with pytest.raises(SettingsError, match="should be a plain name"):
            save_demonstrations(tmp_path / "taught", demos)
    assert not list(tmp_path.iterdir())


def test_big_endian_arrays_are_read_as_the_same_numbers(victims, tmp_path):
    content = io.BytesIO()
    with np.load(victims["map"].path) as found:
        np.savez(content, **{**found, "distance": found["distance"].astype(">f8")})
    path = tmp_path / "big.npz"
    path.write_bytes(content.getvalue())
    assert victims["map"].load(path).distance.tolist() == [1.0] * 4
    assert victims["map"].load(path).distance.dtype.isnative
