"""The command line: one file a command or group of commands, with its settings as a dataclass and a `run`."""

from creative_nao.cli.dispatch import main

__all__ = ["main"]
