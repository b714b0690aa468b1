"""Agents by name: ours, trained ones, and the user's own as functions, policies or `package.module:factory`."""

from __future__ import annotations

import importlib
import os
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from creative_nao.agents import black_box, quality_diversity, rehearsal, surrogate
from creative_nao.agents.base import Agent, Context, PolicyAgent, as_track
from creative_nao.agents.bundle import find_bundle, load_bundle, shipped_agents
from creative_nao.agents.learned_map.agent import LearnedMapAgent
from creative_nao.agents.settings import ALGORITHMS
from creative_nao.envs import Track
from creative_nao.errors import NotFoundError, SettingsError, nearest_name
from creative_nao.runtime import search_current_folder
from creative_nao.schema import Index, checked

UNTRAINED: dict[str, Callable[[], Agent]] = {
    agent.name: agent
    for agent in (
        black_box.SupervisedAgent,
        black_box.ReplayAgent,
        black_box.RandomAgent,
        black_box.SobolAgent,
        black_box.CmaEsAgent,
        quality_diversity.CmaMeAgent,
        quality_diversity.MapElitesAgent,
        quality_diversity.NoveltySearchAgent,
        black_box.BayesianAgent,
        black_box.LatticeAgent,
        black_box.SpreadAgent,
        black_box.SpreadPointsAgent,
        surrogate.SurrogateAgent,
        rehearsal.ImagineAgent,
        rehearsal.PlanAgent,
        rehearsal.PlanModulatedAgent,
        rehearsal.PlanWithSenseAgent,
        rehearsal.PlanWithBodyAgent,
        rehearsal.ImagineWithBodyAgent,
        black_box.OracleAgent,
    )
}
"""Agents that need no training."""
TRAINED = tuple(ALGORITHMS)
"""Agents that are trained first and come out of a bundle."""
NAMES: tuple[str, ...] = (*UNTRAINED, *TRAINED)


class FunctionAgent(Agent):
    """Plays a plain function as an agent.

    Args:
        function: Takes the observation and returns a PB vector, shape (n_pb,), inside the action space. It receives
            nothing else; what it draws at random it has to seed itself.
        name: Under which results list it.
        track: What its observations tell.

    Example:
        >>> agent = FunctionAgent(lambda observation: -observation[:2], name="opposite")
    """

    name: ClassVar[str] = "function"

    def __init__(self, function: Callable[[np.ndarray], Any], *, name: str | None = None, track: str = Track.OUTCOMES):
        self.function = checked(Callable, function, "function")
        self.track = as_track(track, "`track`")
        if name is not None:
            self.name = name  # pyright: ignore[reportAttributeAccessIssue]

    def choose(self, observation: np.ndarray) -> np.ndarray:
        """Return what the function says, shape (n_pb,)."""
        return self.function(observation)


def as_agent(
    entered: Any, *, name: str | None = None, deterministic: bool | None = None, track: str | None = None
) -> Agent:
    """Return anything that can choose PB vectors as an agent.

    Args:
        entered: An `Agent`, an object with the `predict` of Stable-Baselines3, or a function from observations to PB
            vectors.
        name: Under which results list it; None keeps its own.
        deterministic: Of a policy: its most likely actions, or drawn ones. None plays a trained agent the way it was
            judged, any other policy by its most likely actions; `repr` says which.
        track: Of a policy or function: what its observations tell; None: as `PolicyAgent` says, of functions outcomes.

    Raises:
        SettingsError: If it is none of them.
    """
    if isinstance(entered, Agent):
        if name is not None:
            entered.name = name  # pyright: ignore[reportAttributeAccessIssue]
        return entered
    if callable(getattr(entered, "predict", None)):
        return PolicyAgent(entered, deterministic=deterministic, name=name, track=track)
    if callable(entered) and not isinstance(entered, type):
        return FunctionAgent(entered, name=name, track=Track.OUTCOMES if track is None else track)
    raise SettingsError(
        f"an agent should be an `Agent`, an object with `predict` or a function from observations to PB vectors, "
        f"but is {entered!r}"
    )


class AgentPolicy:
    """Gives an agent the `predict` of Stable-Baselines3, for one observation or a batch of them.

    `predict` never hears of rewards, so only agents that do not learn within an episode can be entered.

    Args:
        make_agent: Makes one agent; a batch of n observations uses n of them.
        make_context: Makes the context of each episode.

    Raises:
        SettingsError: If the agent learns within an episode.
    """

    def __init__(self, make_agent: Callable[[], Agent], make_context: Callable[[], Context]):
        self._make_agent = checked(Callable, make_agent, "make_agent")
        self._make_context = checked(Callable, make_context, "make_context")
        agent = make_agent()
        if agent.learns_within_episode:
            raise SettingsError(
                f"agent `{agent.name}` learns from rewards within an episode, which `predict` never receives; "
                "use its `ask` and `tell`"
            )
        self._agents: list[Agent] = []
        self._left: list[int] = []

    def predict(
        self,
        observation: np.ndarray,
        state: Any = None,
        episode_start: np.ndarray | bool | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Return actions for observations.

        Args:
            observation: Shape (n_values,) or (n, n_values).
            state: Handed back unchanged; agents keep their own.
            episode_start: Shape (n,); where True, that agent begins a new episode. So it does when its budget is spent.
            deterministic: Ignored: an agent decides by itself what it draws.

        Returns:
            Actions of shape (2,) or (n, 2), and `state`.
        """
        observation = np.asarray(observation)
        batch = observation[None] if observation.ndim == 1 else observation
        if len(self._agents) != len(batch):
            self._agents, self._left = [self._make_agent() for _ in batch], [0] * len(batch)
        starts = np.broadcast_to(False if episode_start is None else episode_start, (len(batch),))
        actions = []
        for place, (agent, row) in enumerate(zip(self._agents, batch, strict=True)):
            if starts[place] or self._left[place] == 0:
                context = self._make_context()
                agent.begin(context)
                self._left[place] = context.n_actions
            actions.append(agent.ask(row))
            self._left[place] -= 1
            agent.tell(actions[-1], row, float("nan"), {})
        return (actions[0] if observation.ndim == 1 else np.stack(actions)), state


def is_entry_point(name: str) -> bool:
    """Return whether a name has the form `package.module:factory`."""
    module, colon, factory = name.partition(":")
    return bool(colon) and all(part.isidentifier() for part in (*module.split("."), *factory.split(".")))


def load_entry_point(name: str) -> Agent:
    """Import a module, call its factory and return the agent, listed in results under the name typed.

    The factory takes no arguments and returns an `Agent`, anything with the `predict` of Stable-Baselines3, or a
    function from observations to PB vectors; a subclass of `Agent` is such a factory. What it returns may have an
    attribute `n_actions_training`, the actions generated in its training. The current directory is searched after the
    installed packages.

    Args:
        name: As `package.module:factory`.

    Raises:
        NotFoundError: If there is no such module or factory; the message offers the nearest name.
        SettingsError: If the name has another form, what it names is no factory of an agent, or the user's code fails.
    """
    if not isinstance(name, str) or not is_entry_point(name):
        raise SettingsError(f"an agent of your own is named `package.module:factory`, but this is `{name}`")
    module, _, path = name.partition(":")
    search_current_folder()  # an installed command does not search it, and there lies a script of one's own
    try:
        factory: Any = importlib.import_module(module)
    except Exception as error:
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if missing is not None and (module == missing or module.startswith(f"{missing}.")):
            raise NotFoundError(
                f"agent `{name}`: there is no module `{module}`; it should be installed, or lie in {os.getcwd()}"
            ) from error
        raise SettingsError(f"agent `{name}`: importing `{module}` fails: {_told(error)}") from error
    for part in path.split("."):
        if not hasattr(factory, part):
            known = [word for word in dir(factory) if not word.startswith("_")]
            raise NotFoundError(f"agent `{name}`: `{module}` has no `{part}`{nearest_name(part, known)}")
        factory = getattr(factory, part)
    if not callable(factory):
        raise SettingsError(f"agent `{name}` should name a function that makes an agent, but is {factory!r}")
    try:
        made = factory()
    except Exception as error:
        raise SettingsError(f"agent `{name}`: `{path}` fails: {_told(error)}") from error
    agent = as_agent(made, name=name)
    trained = getattr(made, "n_actions_training", 0)
    agent.n_actions_training = checked(Index, trained, f"n_actions_training` of agent `{name}")
    return agent


def _told(error: Exception) -> str:
    """Return what an error of the user's own code says and where, in one line."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({os.path.basename(where.filename)}, line {where.lineno})"


def split_name(name: str) -> tuple[str, int | None]:
    """Return an agent's name without the number of movements it looks at, and that number.

    Example:
        >>> split_name("spread@8"), split_name("spread")
        (('spread', 8), ('spread', None))
    """
    base, mark, number = name.rpartition("@")
    if not mark or not number.isdecimal() or len(number) > 6 or int(number) == 0 or os.path.isfile(name):
        return name, None
    return base, int(number)


def make_agent(name: str, bundle: str | Path | None = None) -> Agent:
    """Make an agent.

    Args:
        name: One of `NAMES`; or a trained agent by shipped name, such as ``ppo/BoxingMental-v0``, or path of a bundle;
            or ``package.module:factory``, the user's own code, which is imported and called (`load_entry_point`).
            With `@8` behind it the agent looks at eight movements for each one it performs (`rehearse`).
        bundle: With the name of a trained agent: shipped name or path of its bundle.

    Raises:
        NotFoundError: If no agent is called so, or the bundle does not exist.
        SettingsError: If a trained agent lacks its bundle, or a factory makes no agent.
        FileFormatError: If the bundle is damaged.
    """
    base, n_candidates = split_name(checked(str, name, "name"))
    if n_candidates is not None:
        agent = rehearsal.rehearse(make_agent(base, bundle), n_candidates)
        agent.name = name  # pyright: ignore[reportAttributeAccessIssue]
        return agent
    known = name in NAMES
    if bundle is None and not known:
        if is_entry_point(name):  # also where a file has this name: ./package.module:factory names the file
            return load_entry_point(name)
        if name in shipped_agents() or Path(name).is_file():
            bundle = name
        elif ":" in name:
            return load_entry_point(name)
        elif "/" in name:
            find_bundle(name)
    if not known and bundle != name:
        raise NotFoundError(f"no agent `{name}`{nearest_name(name, NAMES)}; there are: {', '.join(NAMES)}")
    if name in UNTRAINED:
        return UNTRAINED[name]()
    if bundle is None:
        raise SettingsError(f"agent `{name}` is trained first: `bundle` should be the path of its bundle, but is None")
    trained = load_bundle(bundle)
    if known and trained.header.agent != name:
        raise SettingsError(f"`bundle` should hold a `{name}` agent, but {bundle} holds `{trained.header.agent}`")
    if trained.header.agent == LearnedMapAgent.name:
        return LearnedMapAgent(trained)
    return PolicyAgent(trained, name=trained.header.agent)
