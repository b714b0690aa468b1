"""Many copies of an environment at once: generated together, scored and performed in threads.

The same trajectories, bit for bit, as separate copies of the same seeds in Gymnasium's Sync or Async vector
environments.

Also here:
- The terms of many copies in Gymnasium's vector format: arrays over all copies, and who has a term.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from creative_nao.envs.episode_batch import Episodes, Scored, Weighed
from creative_nao.envs.executors import FRAME_DT_S, Bodies, Crew, Mind, Performed, SharedScene, check_arms
from creative_nao.envs.memory_set import MemoryLike
from creative_nao.envs.repertoire_env import EPISODE_ACTIONS, caption_of, check_n_actions, checked_pb
from creative_nao.envs.state import EnvState, generator_from, generator_state
from creative_nao.envs.viewing import Screen
from creative_nao.errors import SettingsError
from creative_nao.measures import Criteria
from creative_nao.robot import PhysicalLimits


def vector_terms(n: int, robots: np.ndarray, terms: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return terms of some copies as arrays over all n, each with its mask ``_name``; others hold 0 or None.

    Args:
        n: Number of copies.
        robots: Which copies have the terms, shape (m,), rising.
        terms: Arrays over them, (m, ...), by name.
    """
    infos: dict[str, Any] = {}
    if not len(robots):
        return infos
    for name, values in terms.items():
        if len(robots) == n:
            whole = values
        else:
            whole = (
                np.full(n, None, object) if values.dtype == object else np.zeros((n, *values.shape[1:]), values.dtype)
            )
            whole[robots] = values
        mask = np.zeros(n, bool)
        mask[robots] = True
        infos[name], infos[f"_{name}"] = whole, mask
    return infos


def objects(values: list[Any]) -> np.ndarray:
    """Return values of any kind as an array of objects, (m,)."""
    out = np.empty(len(values), object)
    out[:] = values
    return out


def rows(terms: dict[str, np.ndarray], places: np.ndarray) -> dict[str, np.ndarray]:
    """Return the terms of some of the copies only."""
    return {name: values[places] for name, values in terms.items()}


class RepertoireVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Base of the vector environments.

    Args:
        num_envs: Number of copies.
        memory: As of the single environment; over a part of the bank every copy draws its own.
        n_actions: Actions in an episode.
        render_mode: `rgb_array`, `rgb_array_list`, `depth_array` or None; `render` returns one result a copy.
        criteria: Where the lines between outcomes are drawn.
        overlay: Whether colour frames carry a caption.
        autoreset_mode: What happens when an episode has ended: `NEXT_STEP` (the next step begins a new one, as
            Gymnasium does by default), `SAME_STEP` (the new one begins at once, the old one's end is in `final_obs` and
            `final_info`) or `DISABLED` (`reset(options={"reset_mask": mask})` begins it).
        n_threads: Threads; None for one a processor core.

    Raises:
        NotFoundError: If there is no such memory.
        SettingsError: If a setting is out of range.
    """

    _unfolding = False
    _kind = ""
    """Name of the single environment, whose states fit."""

    def __init__(
        self,
        num_envs: int = 1,
        memory: MemoryLike = "half/0",
        n_actions: int = EPISODE_ACTIONS,
        render_mode: str | None = None,
        criteria: Criteria | None = None,
        overlay: bool = False,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        n_threads: int | None = None,
    ) -> None:
        check_n_actions(n_actions)
        if num_envs < 1:
            raise SettingsError(f"`num_envs` should be at least 1, but is {num_envs}")
        if render_mode == "human":
            raise SettingsError('`render_mode` "human" opens one window: use it with a single environment')
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError as error:
            known = ", ".join(mode.value for mode in AutoresetMode)
            raise SettingsError(f"`autoreset_mode` should be one of {known}, but is {autoreset_mode!r}") from error
        self.num_envs, self.n_actions, self.render_mode = num_envs, n_actions, render_mode
        self._shared = SharedScene()
        self._screen = Screen(self._shared, render_mode, overlay, num_envs)
        self.metadata = {
            "render_modes": ["rgb_array", "rgb_array_list", "depth_array"],
            "render_fps": round(1 / FRAME_DT_S),
            "autoreset_mode": self.autoreset_mode,
        }
        self._crew = Crew(n_threads)
        self._episodes = Episodes(memory, num_envs, criteria, self._unfolding)
        self.criteria = self._episodes.criteria
        self.single_observation_space = self._episodes.observation_space
        self.single_action_space = Box(-1.0, 1.0, (self._episodes.bank.first.n_pb,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._performer: Mind | Bodies = Mind(self._shared)
        self._physics: list[np.ndarray | None] = [None] * num_envs
        self._random: list[np.random.Generator | None] = [None] * num_envs
        self._ended = np.zeros(num_envs, bool)

    @property
    def memories(self) -> tuple[Any, ...]:
        """The memory of each copy's episode."""
        return tuple(facts.memory for facts in self._episodes.facts)

    def _rng(self, robot: int) -> np.random.Generator:
        found = self._random[robot]
        if found is None:
            found = self._random[robot] = seeding.np_random()[0]
        return found

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin episodes with empty repertoires.

        Args:
            seed: One seed a copy; an int for that, the next, and so on.
            options: ``{"memory": name}`` takes this memory in every copy; ``{"reset_mask": mask}`` of bool, shape
                (num_envs,), begins only these episodes anew.

        Returns:
            The observations and, as `info`, the names of the memories.

        Raises:
            SettingsError: If the seeds or the mask do not fit.
            NotFoundError: If there is no such memory in this environment.
        """
        seeds = (
            [None if seed is None else seed + k for k in range(self.num_envs)] if not isinstance(seed, list) else seed
        )
        if len(seeds) != self.num_envs:
            raise SettingsError(f"`seed` should hold {self.num_envs} seeds, one a copy, but holds {len(seeds)}")
        chosen = dict(options or {})
        mask = np.asarray(chosen.pop("reset_mask", np.ones(self.num_envs, bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise SettingsError(
                f'options["reset_mask"] should be {self.num_envs} bools, at least one of them true, but is {mask!r:.80}'
            )
        robots = np.flatnonzero(mask)
        for robot in robots:
            if seeds[robot] is not None:
                self._random[robot] = seeding.np_random(seeds[robot])[0]
        self._begin(robots, chosen.get("memory"))
        self._ended[robots] = False
        return self._episodes.observer.vectors(), vector_terms(self.num_envs, robots, self._names(robots))

    def _begin(self, robots: np.ndarray, wanted: str | None = None) -> None:
        for robot in robots:
            self._episodes.begin(robot, wanted, lambda robot=robot: self._rng(robot))
            self._screen.clear(robot)
            self._physics[robot] = None  # the settled guard

    def _names(self, robots: np.ndarray) -> dict[str, np.ndarray]:
        return {"memory": objects([self._episodes.facts[robot].name for robot in robots])}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Let every copy act.

        Args:
            actions: PB vectors, (num_envs, n_pb); values beyond [-1, 1] are clipped. Those of copies whose episode has
                ended are ignored with `NEXT_STEP`, where they begin a new one.

        Returns:
            Observations, rewards, terminations (never), truncations and `infos`, arrays over the copies.

        Raises:
            ShapeError: If the actions do not have that shape or are not finite.
            SettingsError: If an episode has ended and was not begun anew with `DISABLED`.
        """
        pb = checked_pb(actions, self.action_space.shape)
        beginning = np.flatnonzero(self._ended)
        if len(beginning) and self.autoreset_mode is not AutoresetMode.NEXT_STEP:
            raise SettingsError(
                f"the episodes of copies {beginning.tolist()} have ended; begin them anew with "
                'reset(options={"reset_mask": mask}), since `autoreset_mode` is disabled'
            )
        self._begin(beginning)
        robots = np.flatnonzero(~self._ended)
        rewards, truncated = np.zeros(self.num_envs), np.zeros(self.num_envs, bool)
        infos = vector_terms(self.num_envs, beginning, self._names(beginning))
        if len(robots):
            earned, terms, finished = self._act(robots, pb[robots])
            rewards[robots] = earned
            truncated[robots] = self._episodes.n_actions[robots] >= self.n_actions
            infos = self._end(robots, truncated, terms, finished, infos)
        self._ended = truncated & (self.autoreset_mode is not AutoresetMode.SAME_STEP)
        return self._episodes.observer.vectors(), rewards, np.zeros(self.num_envs, bool), truncated, infos

    def _end(
        self,
        robots: np.ndarray,
        truncated: np.ndarray,
        terms: dict[str, np.ndarray],
        finished: dict[str, np.ndarray],
        infos: dict[str, Any],
    ) -> dict[str, Any]:
        """Put the terms of a step together; with `SAME_STEP`, begin the episodes that have ended."""
        over = np.flatnonzero(truncated[robots])
        scored = finished.pop("robots")
        if self.autoreset_mode is not AutoresetMode.SAME_STEP or not len(over):
            infos |= vector_terms(self.num_envs, robots, terms) | vector_terms(self.num_envs, scored, finished)
            return self._with_measures(infos, robots[over])
        on = np.flatnonzero(~truncated[robots])
        still, done = np.flatnonzero(~truncated[scored]), np.flatnonzero(truncated[scored])
        infos |= vector_terms(self.num_envs, robots[on], rows(terms, on))
        infos |= vector_terms(self.num_envs, scored[still], rows(finished, still))
        last = vector_terms(self.num_envs, robots[over], rows(terms, over))
        last |= vector_terms(self.num_envs, scored[done], rows(finished, done))
        final = objects([self._episodes.observer.vector(robot) for robot in robots[over]])
        infos |= vector_terms(self.num_envs, robots[over], {"final_obs": final})
        infos["final_info"], infos["_final_info"] = self._with_measures(last, robots[over]), truncated.copy()
        self._begin(robots[over])
        return infos | vector_terms(self.num_envs, robots[over], self._names(robots[over]))

    def _with_measures(self, infos: dict[str, Any], over: np.ndarray) -> dict[str, Any]:
        for robot in over:
            measures = self._episodes.knowledge.measures(robot, int(self._episodes.n_actions[robot]))
            infos = self._add_info(infos, {"episode_measures": measures}, int(robot))
        return infos

    def _act(
        self, robots: np.ndarray, pb: np.ndarray
    ) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Let copies act; return rewards, the terms of all of them and those of copies that finished a movement."""
        if isinstance(self._performer, Bodies) or self._screen.wanted:
            generated, weighed = self._generate(robots, pb), None
        else:
            generated, weighed = self._imagine(robots, pb)
        scored, terms = self._finish(robots, pb[:, None], generated, weighed)
        done = self._episodes.n_actions[robots]
        self._episodes.observer.put(robots, "step", np.minimum(done / self.n_actions, 1.0))
        return scored.reward, {"pb": pb, "step": done}, {"robots": robots, **terms}

    def _by_memory(self, robots: np.ndarray) -> np.ndarray:
        # Copies of one memory are generated together, so they go to the same thread as far as possible.
        return np.argsort([id(self._episodes.facts[robot]) for robot in robots], kind="stable")

    def _generate(self, robots: np.ndarray, pb: np.ndarray) -> np.ndarray:
        generated, _ = self._episodes.room(len(robots))

        def work(piece: np.ndarray) -> None:
            generated[piece] = self._episodes.generate(robots[piece], pb[piece])

        self._crew.share(work, self._by_memory(robots))
        return generated

    def _imagine(self, robots: np.ndarray, pb: np.ndarray) -> tuple[np.ndarray, Weighed]:
        """Generate and weigh at once: what is only imagined need not wait until all have generated."""
        generated, weighed = self._episodes.room(len(robots))

        def work(piece: np.ndarray) -> None:
            mine = self._episodes.generate(robots[piece], pb[piece])
            generated[piece] = mine
            self._put(weighed, piece, robots, mine, mine)

        self._crew.share(work, self._by_memory(robots))
        return generated, weighed

    def _put(
        self, weighed: Weighed, piece: np.ndarray, robots: np.ndarray, generated: np.ndarray, trajectories: np.ndarray
    ) -> None:
        for array, values in zip(weighed, self._episodes.weigh(robots[piece], generated, trajectories), strict=True):
            array[piece] = values

    def _weigh(self, robots: np.ndarray, generated: np.ndarray, performed: list[Performed] | None) -> Weighed:
        trajectories = generated if performed is None else np.stack([one.trajectory for one in performed])
        _, weighed = self._episodes.room(len(robots))
        self._crew.share(
            lambda piece: self._put(weighed, piece, robots, generated[piece], trajectories[piece]),
            np.arange(len(robots)),
        )
        return weighed

    def _finish(
        self, robots: np.ndarray, pb: np.ndarray, generated: np.ndarray, weighed: Weighed | None = None
    ) -> tuple[Scored, dict[str, np.ndarray]]:
        """Have the movements of copies performed and scored; pb: (m, n, n_pb)."""
        performed = self._perform(robots, generated)
        if weighed is None:
            weighed = self._weigh(robots, generated, performed)
        scored = self._episodes.score(robots, pb, generated, performed, weighed)
        terms = self._terms(scored)
        if performed is not None:
            for name in performed[0].figures:
                values = [one.figures[name] for one in performed]
                terms[name] = np.stack(values) if isinstance(values[0], np.ndarray) else np.array(values)
            for place, robot in enumerate(robots):
                self._screen.remember(
                    robot, performed[place], caption_of({name: array[place] for name, array in terms.items()})
                )
        return scored, terms

    def _perform(self, robots: np.ndarray, generated: np.ndarray) -> list[Performed] | None:
        taught = [self._episodes.facts[robot].demonstrations for robot in robots]
        dt_s, joints = [one.dt_s for one in taught], taught[0].joints
        if isinstance(self._performer, Bodies):
            performed, ends = self._performer.perform(generated, dt_s, joints, self._screen.wanted)
            for robot, end in zip(robots, ends, strict=True):
                self._physics[robot] = end
            return performed
        if not self._screen.wanted:
            return None
        return [self._performer.perform(one, dt, joints, True) for one, dt in zip(generated, dt_s, strict=True)]

    def _terms(self, scored: Scored) -> dict[str, np.ndarray]:
        names = [self._episodes.facts[robot].demonstrations.names for robot in scored.robots]
        return {
            "outcome": scored.outcome_names,
            "appropriate": scored.appropriate,
            "nearest": scored.nearest,
            "nearest_name": objects([of[k] for of, k in zip(names, scored.nearest, strict=True)]),
            "distance": scored.distance,
            "known_distance": scored.known_distance,
            "reward_novelty": scored.reward.copy(),
            "repertoire_size": self._episodes.knowledge.sizes[scored.robots] - self._episodes.knowledge.n_basic,
            "trajectory": scored.trajectories,
        }

    def render(self) -> tuple[Any, ...] | None:
        """Show what each copy performed since the last call, as the single environment's `render` does."""
        return None if self.render_mode is None else tuple(self._screen.show(k) for k in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and free what drawing took."""
        # Gymnasium may close a vector whose arguments were refused, before there was anything to close.
        for part in ("_crew", "_screen"):
            if hasattr(self, part):
                getattr(self, part).close()

    def get_state(self) -> tuple[EnvState, ...]:
        """Return the exact state of each copy; a single environment of the same kind takes it, too."""
        return tuple(self._state(robot) for robot in range(self.num_envs))

    def _state(self, robot: int) -> EnvState:
        values, arrays = self._episodes.state(robot)
        values["random"] = generator_state(self._random[robot])
        if isinstance(self._performer, Bodies):
            end = self._physics[robot]
            arrays["physics"] = (self._performer.guard() if end is None else end).copy()
        return EnvState(self._kind, values, arrays)

    def set_state(self, states: tuple[EnvState, ...] | list[EnvState]) -> None:
        """Put each copy into a state, of `get_state` here or of a single environment made alike.

        Raises:
            SettingsError: If they are not one a copy, of another environment, or a part of one does not fit.
            NotFoundError: If a memory is none of this environment's.
        """
        if len(states) != self.num_envs:
            raise SettingsError(f"`states` should hold {self.num_envs} states, one a copy, but holds {len(states)}")
        for robot, state in enumerate(states):
            self._restore(robot, state)

    def _restore(self, robot: int, state: EnvState) -> None:
        state.check(self._state(robot))
        self._episodes.restore(robot, state.values, state.arrays)
        self._random[robot] = generator_from(state.values["random"])
        self._screen.clear(robot)
        if isinstance(self._performer, Bodies):
            self._physics[robot] = state.arrays["physics"]
        over = self._episodes.n_actions[robot] >= self.n_actions
        self._ended[robot] = over and self.autoreset_mode is not AutoresetMode.SAME_STEP


class BoxingMentalVectorEnv(RepertoireVectorEnv):
    """Many copies of `CreativeNao/BoxingMental-v0`; see `BoxingMentalEnv` and `RepertoireVectorEnv`."""

    _kind = "BoxingMentalEnv"


class BoxingVectorEnv(RepertoireVectorEnv):
    """Many copies of `CreativeNao/Boxing-v0`, performed in threads; see `BoxingEnv` and `RepertoireVectorEnv`.

    Args:
        limits: From where on a performance counts as failed.
        arguments: Those of `RepertoireVectorEnv`.
    """

    _kind = "BoxingEnv"

    def __init__(self, num_envs: int = 1, *, limits: PhysicalLimits | None = None, **arguments: Any) -> None:
        super().__init__(num_envs, **arguments)
        check_arms(self._episodes.bank.first.demonstrations.joints)
        self._performer = Bodies(self._crew, self._shared, PhysicalLimits() if limits is None else limits)
