"""The ring as a dm_control environment."""

import numpy as np
import pytest

from creative_nao.demonstrations import load_demonstrations
from creative_nao.envs import TASKS, load
from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.joints import JOINTS, limits
from creative_nao.robot import Performer, Scene, arm_angles

pytest.importorskip("dm_control", reason="pip cannot install it on Python 3.13")
from absl.testing import absltest
from dm_control.rl import control
from dm_env import test_utils

from creative_nao.envs import boxing_task


@pytest.fixture(scope="module")
def env():
    return boxing_task.load(seed=0)


def rollout(env, targets):
    steps = [env.reset()]
    for target in targets:
        steps.append(env.step(target))
        if steps[-1].last():
            break
    return steps


def test_actions_are_the_eight_arm_joints(env):
    spec = env.action_spec()
    low, high = limits()
    assert spec.shape == (8,)
    assert tuple(spec.name.split("\t")) == JOINTS
    np.testing.assert_array_equal(spec.minimum, low)
    np.testing.assert_array_equal(spec.maximum, high)


def test_observations_are_those_of_the_page(env):
    observed = {name: value.shape for name, value in env.reset().observation.items()}
    page = boxing_task.BoxingTask.__doc__ or ""
    assert all(f"`{name}`" in page for name in observed)
    assert observed == {
        "nao/joint_positions": (8,),
        "nao/joint_velocities": (8,),
        "nao/touch": (4,),
        "bag/swing": (2,),
        "bag/swing_velocity": (2,),
    }
    assert {name: spec.shape for name, spec in env.observation_spec().items()} == observed


def test_standing_in_the_guard_lasts_the_whole_time_and_earns_nothing(env):
    steps = rollout(env, [arm_angles("Guard")] * 200)
    assert len(steps) - 1 == 150, "7.5 s in steps of 50 ms"
    assert steps[-1].discount == 1.0
    assert sum(step.reward for step in steps[1:]) == 0.0
    touch = steps[-1].observation["nao/touch"]
    assert touch[[0, 2]].tolist() == [0, 0], "fists"
    assert touch[[1, 3]].sum() == pytest.approx(5.36 * 9.81, rel=0.01), "feet carry the weight"


def test_a_punch_earns_the_impulse_on_the_bag(env):
    guard, straight = arm_angles("Guard"), arm_angles("Guard")
    straight[:4] = [0.0, -0.05, 0.5, 0.06]
    steps = rollout(env, [guard] * 5 + [straight] * 20)
    assert sum(step.reward for step in steps[1:]) > 0.1
    assert np.abs(steps[-1].observation["bag/swing"]).max() > 0.02


def test_equal_seeds_start_equally_and_others_do_not():
    def first(seed):
        return boxing_task.load(seed=seed, start_noise_rad=0.1).reset().observation["nao/joint_positions"]

    np.testing.assert_array_equal(first(3), first(3))
    assert not np.array_equal(first(3), first(4))
    assert np.abs(first(3) - arm_angles("Guard")).max() < 0.12


def test_the_same_actions_give_the_same_bits(env):
    targets = load_demonstrations().trajectories[0][:20]
    one, two = (rollout(env, targets)[-1].observation for _ in range(2))
    for name, value in one.items():
        assert np.array_equal(value, two[name]), name


def test_a_fall_ends_the_episode(env):
    env.reset()
    with env.physics.reset_context():
        start = env.task.scene.index.torso_qpos
        env.physics.data.qpos[start + 2 : start + 7] = [0.5, np.sqrt(0.5), 0, np.sqrt(0.5), 0]  # lying in the air
    step = env.step(arm_angles("Guard"))
    assert step.last()
    assert step.discount == 0.0


def test_the_performer_runs_on_the_model_of_the_environment(env):
    performer = Performer(env.task.scene)
    assert performer.scene.model is env.physics.model.ptr
    assert not performer.perform(np.repeat(arm_angles("Guard")[None], 5, axis=0), 0.15).fell


def test_composer_builds_the_same_physics_as_plain_mujoco_to_the_bit(env):
    """Every number of both compiled models is equal, and so is a punch."""
    ours, theirs = Scene().model, env.physics.model.ptr
    arrays = [name for name in dir(ours) if isinstance(getattr(ours, name), np.ndarray)]
    assert len(arrays) > 300
    for name in arrays:
        if not name.startswith(("name", "_sizes")):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    demos = load_demonstrations()
    one, two = (
        Performer(scene).perform(demos.trajectories[1], demos.dt_s, keep_frames=True)
        for scene in (Scene(), env.task.scene)
    )
    assert np.array_equal(one.frames, two.frames)
    assert one.hits == two.hits


def test_a_control_step_is_a_whole_number_of_physics_steps():
    with pytest.raises(SettingsError, match=r"whole number of physics steps of 0\.005 s, but is 0\.007"):
        boxing_task.load(control_step_s=0.007)


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"start_noise_rad": -1.0}, "`start_noise_rad` should be at least 0"), ({"time_limit_s": 0.0}, "`time_limit_s`")],
)
def test_settings_out_of_range_are_named(settings, message):
    with pytest.raises(SettingsError, match=message):
        boxing_task.load(**settings)


# In the manner in which dm_control tests the tasks of its own suite.


@pytest.fixture(scope="module", params=TASKS)
def task(request):
    return load(request.param, seed=1, start_noise_rad=0.05)


def at_random(env, seed, n_steps=40):
    """Play actions drawn evenly from the action spec, through the ends of episodes."""
    spec, rng = env.action_spec(), np.random.default_rng(seed)
    steps = [env.reset()]
    for _ in range(n_steps):
        steps.append(env.step(rng.uniform(spec.minimum, spec.maximum)))
    return steps


def test_the_action_spec_is_finite_and_in_order(task):
    spec = task.action_spec()
    assert spec.dtype == np.float64
    assert np.isfinite([spec.minimum, spec.maximum]).all()
    assert (spec.minimum < spec.maximum).all()


@pytest.mark.parametrize("end", ["minimum", "maximum"])
def test_actions_at_the_ends_of_the_range_are_survived(task, end):
    task.reset()
    for _ in range(20):
        step = task.step(np.asarray(getattr(task.action_spec(), end)))
        assert all(np.isfinite(value).all() for value in step.observation.values())


def test_every_time_step_keeps_to_the_specs(task):
    specs, reward_spec, discount_spec = task.observation_spec(), task.reward_spec(), task.discount_spec()
    for step in at_random(task, 0):
        assert step.observation.keys() == specs.keys()
        for name, spec in specs.items():
            spec.validate(step.observation[name])
            assert np.isfinite(step.observation[name]).all(), name
        if step.first():
            assert step.reward is None
            assert step.discount is None
        else:
            reward_spec.validate(np.asarray(step.reward))
            discount_spec.validate(np.asarray(step.discount))
            assert 0.0 <= step.reward < 100.0, "an impulse on the bag [N s]"
            assert step.discount == (0.0 if step.last() else 1.0), "so early, only a fall ends an episode"


def test_observations_are_the_callers_own(task):
    step = task.reset()
    kept = {name: np.array(value) for name, value in step.observation.items()}
    task.step(np.asarray(task.action_spec().maximum))
    for name, value in kept.items():
        assert np.array_equal(step.observation[name], value), name


@pytest.mark.parametrize("name", TASKS)
def test_equal_seeds_and_actions_give_equal_bits_and_other_seeds_do_not(name):
    one, same, other = (at_random(load(name, seed=seed, start_noise_rad=0.05), 5, 15) for seed in (2, 2, 3))
    for first, second in zip(one, same, strict=True):
        assert (first.reward, first.discount) == (second.reward, second.discount)
        assert all(np.array_equal(first.observation[key], second.observation[key]) for key in first.observation)
    assert not np.array_equal(one[0].observation["nao/joint_positions"], other[0].observation["nao/joint_positions"])


def test_a_task_that_is_not_there_is_told_with_the_nearest():
    with pytest.raises(NotFoundError, match=r"no task `boxin` \(did you mean `boxing`\?\); there are boxing"):
        load("boxin")


# dm_env's own tests of an environment, and those of dm_control's suite (suite_test.py), which knows its own tasks only.


class TestContractOfDmEnv(test_utils.EnvironmentTestMixin, absltest.TestCase):
    arguments: dict = {}  # noqa: RUF012 - read only

    def make_object_under_test(self):
        return load("boxing", seed=0, time_limit_s=1.0, **self.arguments)

    def make_action_sequence(self):
        rng, spec = np.random.default_rng(0), self.environment.action_spec()
        for _ in range(45):  # two episodes of 20 steps end on the way
            yield rng.uniform(spec.minimum, spec.maximum)


class TestContractOfDmEnvFlat(TestContractOfDmEnv):
    arguments = {"environment_kwargs": {"flat_observation": True}, "start_noise_rad": 0.05}  # noqa: RUF012


def test_the_first_step_of_a_fresh_environment_begins_an_episode(attempt):
    attempt("dm_control", "dm_env's EnvironmentTestMixin, dm_control's suite tests", "passed")
    env = boxing_task.load()
    assert env.step(env.action_spec().generate_value()).first()
    assert env.step(env.action_spec().generate_value()).mid()


def test_every_component_of_the_model_has_a_name_and_there_are_cameras(task):
    model = task.physics.model
    kinds = {"body": "nbody", "joint": "njnt", "geom": "ngeom", "site": "nsite", "camera": "ncam", "light": "nlight",
             "mesh": "nmesh", "texture": "ntex", "material": "nmat", "equality": "neq", "tendon": "ntendon",
             "actuator": "nu", "sensor": "nsensor"}  # fmt: skip
    for kind, size in kinds.items():
        assert all(model.id2name(number, kind) for number in range(getattr(model, size))), kind
    assert model.ncam >= 2


def test_environment_kwargs_reach_the_environment(attempt):
    attempt(
        "dm_control", "`environment_kwargs`: flat_observation, fixed_initial_state, unknown ones", "taken, or named"
    )
    flat = load("boxing", environment_kwargs={"flat_observation": True})
    plain = load("boxing")
    assert set(flat.observation_spec()) == set(flat.reset().observation) == {control.FLAT_OBSERVATION_KEY}
    together = np.concatenate(list(plain.reset().observation.values()))
    assert np.array_equal(flat.reset().observation[control.FLAT_OBSERVATION_KEY], together)
    fixed = load("boxing", start_noise_rad=0.1, environment_kwargs={"fixed_initial_state": True})
    first, second = (fixed.reset().observation["nao/joint_positions"] for _ in range(2))
    assert np.array_equal(first, second)
    with pytest.raises(SettingsError, match=r"no `flat_observations` \(did you mean `flat_observation`\?\)"):
        load("boxing", environment_kwargs={"flat_observations": True})
    with pytest.raises(SettingsError, match="`environment_kwargs`"):
        load("boxing", environment_kwargs=[1])


def test_nothing_observed_is_constant_and_episodes_begin_differently(task):
    observed = [step.observation for step in at_random(task, 0, 150)]
    for name in observed[0]:
        values = np.array([observation[name] for observation in observed])
        assert (values != values[0]).any(axis=0).all(), name
    first, second = task.reset().observation, task.reset().observation
    assert not all(np.array_equal(first[name], second[name]) for name in first)


def test_observations_of_consecutive_steps_share_no_memory(task):
    first = task.reset().observation
    second = task.step(np.asarray(task.action_spec().minimum)).observation
    assert not any(np.may_share_memory(first[name], second[name]) for name in first)
