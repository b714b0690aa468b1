"""Arguments of environments: a wrong kind is one of our errors when it is handed over, and JSON gives them back."""

import dataclasses
import inspect
import json
from importlib.util import find_spec
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeAwareObservation

from creative_nao.envs import ENVIRONMENTS, EnvState, SB3VecEnv, load
from creative_nao.envs.boxing_envs import RandomisedRobot, VariationRanges
from creative_nao.errors import CreativeNaoError, SettingsError, ShapeError
from creative_nao.measures import Criteria
from creative_nao.model import load_memory
from creative_nao.robot import PhysicalLimits

BOXING, MENTAL, MODULATION = (f"CreativeNao/{name}-v0" for name in ("Boxing", "BoxingMental", "BoxingModulation"))
WRONG = {
    "n_actions": [2.5, float("nan"), "3", True, None, [3], np.array([3]), 0, -1, np.inf, 1j, np.ma.masked],
    "memory": [3, None, {}, ["half/0"], b"half/0", np.zeros(2), "half/0\0", "", object(), Criteria()],
    "criteria": [3, "paper", [], {"learned": 7.0}, {"learned_threshold": "7"}, {"learned_threshold": np.nan}],
    "overlay": [1, "yes", None, np.zeros(2), {}],
    "render_mode": [3, "ansi", True],
}
WRONG_OF_THE_BODY = [3, "none", {"fell": 1.0}, {"joint_limit_rad": -1.0}, {"joint_limit_rad": [0.1]}]


def made(name, **arguments):
    """Make the single environment and the vector environment, as their classes do; the last error is raised."""
    creator = gym.envs.registration.load_env_creator
    spec = gym.spec(name)
    for kind in (spec.entry_point, spec.vector_entry_point):
        with pytest.raises(CreativeNaoError) as told:
            creator(kind)(**arguments)
        assert "\n" not in str(told.value)
    raise told.value


@pytest.mark.parametrize(("argument", "value"), [(name, value) for name, values in WRONG.items() for value in values])
def test_an_argument_of_a_wrong_kind_is_one_of_our_errors_at_make(argument, value):
    with pytest.raises(CreativeNaoError, match=f"`{argument}`|no memory|no such memory|learned"):
        made(MENTAL, **{argument: value})


@pytest.mark.parametrize("value", WRONG_OF_THE_BODY)
def test_limits_of_a_wrong_kind_are_one_of_our_errors_at_make(value):
    for name in (BOXING, MODULATION):
        with pytest.raises(SettingsError, match=r"`limits`|fell"):
            made(name, limits=value)
    with pytest.raises(SettingsError, match="`physics` should be true or false"):
        made(MODULATION, physics=1)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_every_argument_of_every_environment_is_checked(name, attempt):
    attempt("arguments of environments", "an object, NaN, a list, a dictionary or bytes for each", "our error at make")
    spec = gym.spec(name)
    for place in (spec.entry_point, spec.vector_entry_point):
        kind = gym.envs.registration.load_env_creator(place)
        signatures = [inspect.signature(one.__init__) for one in kind.__mro__ if "__init__" in vars(one)]
        taken = {one.name for signature in signatures for one in signature.parameters.values() if one.kind in (1, 3)}
        for argument in taken - {"self"}:
            for value in (object(), float("nan"), [object()], {"x": object()}, b"x"):
                with pytest.raises((CreativeNaoError, TypeError)) as told:
                    kind(**{**spec.kwargs, argument: value})
                assert told.type is not TypeError or "unexpected keyword argument" in str(told.value)


def calls():
    """Every other public way into the environments, as functions of one value."""
    single, many = gym.make(MENTAL).unwrapped, gym.make_vec(MENTAL, 2).unwrapped
    single.reset()
    many.reset()
    state = single.get_state()
    return {
        "reset(seed)": lambda v: single.reset(seed=v),
        "reset(options)": lambda v: single.reset(options=v),
        "reset(memory)": lambda v: single.reset(options={"memory": v}),
        "step": single.step,
        "set_state": single.set_state,
        "vector reset(seed)": lambda v: many.reset(seed=v),
        "vector reset(options)": lambda v: many.reset(options=v),
        "vector reset(memory)": lambda v: many.reset(options={"memory": v}),
        "vector reset(mask)": lambda v: many.reset(options={"reset_mask": v}),
        "vector step": many.step,
        "vector set_state": many.set_state,
        "SB3VecEnv": SB3VecEnv,
        "SB3VecEnv(num_envs)": lambda v: SB3VecEnv(MENTAL, num_envs=v),
        "RandomisedRobot": RandomisedRobot,
        "VariationRanges(mass)": lambda v: VariationRanges(mass=v),
        "EnvState.load": EnvState.load,
        "EnvState.save": state.save,
        "EnvState(kind)": lambda v: EnvState(v, {}, {}),
        "load(task)": load,
        "load(seed)": lambda v: load(seed=v),
        "load(control_step_s)": lambda v: load(control_step_s=v),
        "load(time_limit_s)": lambda v: load(time_limit_s=v),
        "load(start_noise_rad)": lambda v: load(start_noise_rad=v),
    }


def test_every_other_way_into_the_environments_checks_what_it_gets(attempt):
    ways = calls()
    attempt("arguments of environments", "reset, step, states, SB3VecEnv, dm_control's task", "our error", n=len(ways))
    masked = np.ma.masked_array([1.0, 2.0], mask=[True, False])
    for way, call in ways.items():
        for value in (object(), float("nan"), [object()], {"x": object()}, b"x", masked, True, -1, np.array(["a"])):
            if way.startswith("load(") and find_spec("dm_control") is None:
                continue
            with pytest.raises(CreativeNaoError):
                pytest.fail(f"{way} took {value!r}: {call(value)!r}")


def test_numbers_of_numpy_are_taken_for_numbers():
    with gym.make(MENTAL, n_actions=np.int64(2)) as env:
        assert (env.unwrapped.n_actions, env.spec.max_episode_steps) == (2, 2)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        (MENTAL, {"criteria": dataclasses.replace(Criteria(), learned_threshold=0.5), "n_actions": 3}),
        (BOXING, {"limits": PhysicalLimits(tracking_error_rad=0.0)}),
        (MODULATION, {"criteria": Criteria(speed_factor=0.0), "physics": False, "memory": "train"}),
        (MENTAL, {"memory": Path("mine.safetensors")}),
    ],
)
def test_an_environment_described_as_json_is_made_again(name, arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    load_memory("half/3").save("mine.safetensors")
    told = gym.make(name, **arguments).spec.to_json()
    played = []
    for env in (gym.make(name, **arguments), gym.make(EnvSpec.from_json(told))):
        assert (env.unwrapped.criteria, env.unwrapped.limits) == (
            arguments.get("criteria", Criteria()), arguments.get("limits", PhysicalLimits()),
        )  # fmt: skip
        assert env.spec.to_json() == told
        env.reset(seed=0)
        played.append([env.step([0.1, 0.2])[1:] for _ in range(env.unwrapped.n_decisions)])
        env.close()
    assert [step[0] for step in played[0]] == [step[0] for step in played[1]]
    assert played[0][-1][3]["outcome"] == played[1][-1][3]["outcome"]


def test_an_equal_spec_comes_back_from_json():
    for name in ENVIRONMENTS:
        spec = gym.make(name).spec
        again = EnvSpec.from_json(spec.to_json())
        assert spec == again == gym.make(again).spec
        assert json.loads(gym.spec(name).to_json())["max_episode_steps"] == spec.max_episode_steps


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_a_memory_that_is_an_object_is_not_written_as_json(make):
    env = make(MENTAL, memory=load_memory("half/0"))
    with pytest.raises(SettingsError, match=r"`memory` should be a name, a file or other JSON, .* but is a Memory"):
        env.spec.to_json()


@pytest.mark.parametrize(("name", "n_steps"), [(BOXING, 30), (MENTAL, 30), (MODULATION, 300)])
def test_the_spec_tells_the_length_of_an_episode(name, n_steps):
    assert gym.spec(name).max_episode_steps == n_steps
    for env in (gym.make(name), gym.make_vec(name, 2), gym.make(gym.make(name).spec)):
        assert env.spec.max_episode_steps == n_steps
    for env in (gym.make(name, n_actions=7), gym.make_vec(name, 2, n_actions=7)):
        assert env.spec.max_episode_steps == n_steps / 30 * 7
    assert TimeAwareObservation(gym.make(name, n_actions=2)).max_timesteps == n_steps / 15
    assert gym.make(name, max_episode_steps=4).spec.max_episode_steps == 4


def ends(env, n_steps):
    env.reset(seed=0)
    return [k for k in range(1, n_steps + 1) if env.step(np.zeros(2, np.float32))[3]]


def test_the_number_of_actions_alone_sets_the_length_unless_a_time_limit_is_asked_for():
    with gym.make(MENTAL, n_actions=34) as env:
        assert ends(env, 34) == [34]
    with gym.make(MENTAL, max_episode_steps=3) as env:
        assert ends(env, 3) == [3]
    assert gym.make_vec(MENTAL, 1, n_actions=34).spec.max_episode_steps == 34
    with pytest.raises(SettingsError, match="`max_episode_steps` should be 30, as `n_actions` sets it, but is 3"):
        gym.make_vec(MENTAL, 2, max_episode_steps=3)
    SB3VecEnv(MENTAL, num_envs=2, n_actions=31).close()


def test_steps_that_are_taken_back_do_not_count():
    with gym.make(MENTAL, n_actions=3) as env:
        env.reset(seed=0)
        begin = env.unwrapped.get_state()
        env.step(np.zeros(2, np.float32))
        env.step(np.zeros(2, np.float32))
        env.unwrapped.set_state(begin)
        assert [env.step(np.zeros(2, np.float32))[3] for _ in range(3)] == [False, False, True]


@pytest.mark.parametrize("name", [MENTAL, MODULATION])
def test_an_episode_that_has_ended_goes_on_only_after_a_reset(name):
    with gym.make(name, n_actions=1) as env:
        assert ends(env, n := env.unwrapped.n_decisions) == [n]
        ended = env.unwrapped.get_state()
        with pytest.raises(SettingsError, match="the episode has ended after 1 movements; begin another with `reset`"):
            env.step(np.zeros(2, np.float32))
        env.reset()
        env.step(np.zeros(2, np.float32))
        env.unwrapped.set_state(ended)
        with pytest.raises(SettingsError, match="has ended"):
            env.step(np.zeros(2, np.float32))


def test_an_unknown_option_of_reset_is_named():
    wrong = {"memories": "half/2"}
    for env in (gym.make(MENTAL, memory="train"), gym.make_vec(MENTAL, 2, memory="train")):
        with pytest.raises(SettingsError, match=r"no option `memories` \(did you mean `memory`\?\); there are memory"):
            env.reset(seed=0, options=wrong)
        for options in (3, "half/2", [("memory", "half/2")], {3: 4}):
            with pytest.raises(SettingsError, match="`options`"):
                env.reset(options=options)
    with pytest.raises(SettingsError, match="`seed` should be"):
        gym.make(MENTAL).reset(seed=1.5)


def test_a_masked_action_is_refused():
    env = gym.make(MENTAL).unwrapped
    env.reset()
    with pytest.raises(ShapeError, match="`action` should be a finite PB vector"):
        env.step(np.ma.masked_array([0.1, 0.2], mask=[False, True]))
