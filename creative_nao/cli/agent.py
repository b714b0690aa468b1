"""`creative-nao agent train | run | tune`: agents that learn to explore a memory."""

from __future__ import annotations

from typing import Annotated

import tyro

from creative_nao.cli import agent_run, agent_train, agent_tune
from creative_nao.cli.agent_run import RunAgentSettings
from creative_nao.cli.agent_train import TrainAgentSettings
from creative_nao.cli.agent_tune import TuneAgentSettings

AgentSettings = (
    Annotated[TrainAgentSettings, tyro.conf.subcommand("train")]
    | Annotated[RunAgentSettings, tyro.conf.subcommand("run")]
    | Annotated[TuneAgentSettings, tyro.conf.subcommand("tune")]
)
"""What `creative-nao agent` takes: one of three commands with its options."""


def run(settings: TrainAgentSettings | RunAgentSettings | TuneAgentSettings) -> int:
    """Run the command chosen."""
    if isinstance(settings, TrainAgentSettings):
        return agent_train.run(settings)
    if isinstance(settings, RunAgentSettings):
        return agent_run.run(settings)
    return agent_tune.run(settings)
