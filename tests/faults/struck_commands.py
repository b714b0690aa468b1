"""The commands under test, each as small as it can be and still write everything that it writes."""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

RUN_FOLDER = "out"
"""The run folder of every command, in its working directory."""
START = [sys.executable, "-m", "creative_nao"]
IN_SMALL_BLOCKS = """
import sys
from creative_nao.cli import main
from creative_nao.envs import physical_map
physical_map.BLOCK = 3
sys.exit(main())
"""
KEEP_FAVOURITES = """
import sys
from pathlib import Path
from creative_nao.cli import dispatch
from creative_nao.explorer.favourites import Favourite, Session

def keep(words):
    _, path, memory, *pb = words
    session = Session(Path(path))
    for place in range(8):
        wanted = Favourite(memory, ((place / 8, float(pb[0]) if pb else 0.0),))
        if wanted not in session.favourites(memory):
            session.add(wanted)
    return 0

dispatch._run = keep  # the way in and out of every command around it
sys.exit(dispatch.main())
"""
PPO = {
    "n_timesteps": 90, "n_envs": 1, "n_steps": 30, "batch_size": 30, "n_epochs": 1, "policy_kwargs": {"net_arch": [4]}
}  # fmt: skip
SUITE = """
about = "Two agents in the mind."
agents = ["random", "supervised"]
envs = ["CreativeNao/BoxingMental-v0"]
memories = ["half/0"]
n_seeds = 1
n_actions = 4
resolution = 12
"""


@dataclass(frozen=True)
class Command:
    """A command under test.

    Attributes:
        words: What is typed.
        files: What it promises to write into the run folder.
        interval: How the names end of the files of which each keeps another piece of work.
        at_work: Pieces of work in the air at a time.
        resume: Returns the words that go on, from what is in the run folder.
        cache: Where the explorer keeps maps, in the working directory.
        start: What the words are handed to.
        prepare: Puts into the working directory what the command reads.
    """

    words: tuple[str, ...]
    files: tuple[str, ...]
    interval: str | None = None
    at_work: int = 1
    resume: Callable[[Path], tuple[str, ...]] = lambda folder: ()
    cache: str = "cache"
    start: tuple[str, ...] = tuple(START)
    prepare: Callable[[Path], object] = field(default=lambda folder: None)


def _if_there(name: str) -> Callable[[Path], tuple[str, ...]]:
    return lambda folder: ("--resume",) if (folder / name).exists() else ()


def _always(_: Path) -> tuple[str, ...]:
    return ("--resume",)


def _write_ppo(folder: Path) -> None:
    (folder / "ppo.yml").write_text(json.dumps({"CreativeNao/BoxingMental-v0": PPO}), encoding="utf-8")


def _write_suite(folder: Path) -> None:
    (folder / "tiny.toml").write_text(SUITE, encoding="utf-8")


ACTIONS = ("left_jab", "right_straight", "left_hook", "right_hook", "left_uppercut", "right_uppercut")
TRAIN = (
    "train", "--n-epochs", "400", "--checkpoint-interval", "100",
    "--network.layer-sizes", "8", "4", "--network.time-constants", "2", "5",
)  # fmt: skip
AGENT = (
    "agent", "train", "ppo", "--conf-file", "ppo.yml", "--memory", "half/0", "--validation-memory", "half/10",
    "--score-seeds", "1", "--evaluation-interval", "30", "--checkpoint-interval", "30", "--out", "out",
)  # fmt: skip
COMMANDS = {
    "teach": Command(
        ("teach", "--out", "out"), (*(f"{name}.csv" for name in ACTIONS), "record.json")
    ),
    "train": Command(
        (*TRAIN, "--out", "out/m.safetensors"), ("m.safetensors",),
        interval=".checkpoint", resume=_always,
    ),
    "train, two networks": Command(
        (*TRAIN, "--seed", "1", "2", "--n-workers", "1", "--out", "out"),
        ("half-1.safetensors", "half-2.safetensors", "training.json"), interval=".checkpoint", resume=_always,
    ),
    "map": Command(
        ("map", "half/0", "--resolution", "12", "--out", "out/map.npz"), ("map.npz", "map.png")
    ),
    "map --physical": Command(
        ("map", "half/0", "--physical", "--resolution", "3", "--n-threads", "1", "--out", "out/map.npz"),
        ("map.npz", "map.png"), interval=".part.npz", resume=_if_there("map.part.npz"),
        start=(sys.executable, "-c", IN_SMALL_BLOCKS),
    ),
    "agent train": Command(
        AGENT,
        ("agent.safetensors", "checkpoint.safetensors", "episodes.csv", "evaluations.csv", "progress.csv", "run.json"),
        interval="checkpoint.safetensors", resume=_always, prepare=_write_ppo,
    ),
    "evaluate": Command(
        ("evaluate", "tiny.toml", "--n-workers", "1", "--out", "out"),
        (
            "results.json", "episodes.csv", "table.md", "run.json", "report.html", "maps/half-0.npz",
            "figures/reward.png", "figures/reward.svg",
        ),
        interval=".result.json", resume=_if_there("run.json"), prepare=_write_suite,
    ),
    "explore --html": Command(
        ("explore", "half/0", "--html", "out/page.html", "--resolution", "12"),
        ("page.html",),
    ),
    "explore, favourites": Command(
        ("explore", "out/session.json", "a" * 24), ("session.json",),
        start=(sys.executable, "-c", KEEP_FAVOURITES),
    ),
}  # fmt: skip


def explorer(port: int) -> Command:
    """Return the server of the explorer; what it writes by itself is the map that it keeps."""
    words = ("explore", "half/0", "--no-open", "--port", str(port), "--resolution", "12")
    return Command((*words, "--session", "out/session.json"), ("session.json",), cache="out/cache")
