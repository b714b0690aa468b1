"""`creative-nao agent body-sense`: perform movements in physics, and learn which of them the body refuses."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from creative_nao.agents.body_sense import MovementSettings, SenseSettings, perform_movements, train_sense
from creative_nao.agents.training import memories_of, refuse_test_memories
from creative_nao.cli.terminal import Display, changed_flags, print_result


@dataclasses.dataclass(frozen=True)
class BodySenseSettings:
    """Perform movements of memories in physics and learn from them which ones the body refuses.

    The folder --out gets body_sense.safetensors, the body sense of agents such as plan_with_sense, and in movements/ a
    file for each memory. Those that are there already are taken over: the same command goes on after Ctrl-C, and ends
    with the same bits.
    """

    out: Path
    """Folder to write."""
    memory: str = "train"
    """Memory, or part of the bank, to learn from; never a test memory. 250 movements of one take 14 s of a core."""
    validation_memory: str = "validation"
    """Memory, or part of the bank, on which the epoch to keep is chosen."""
    movements: MovementSettings = dataclasses.field(default_factory=MovementSettings)
    """Which movements are performed."""
    learning: SenseSettings = dataclasses.field(default_factory=SenseSettings)
    """How the network learns."""
    n_threads: int | None = None
    """Movements performed at the same time, without influence on the results; default: one a core."""
    json: bool = False
    """Print the figures as JSON."""


def run(settings: BodySenseSettings) -> int:
    """Perform, train, write the body sense and print how well it predicts."""
    refuse_test_memories(settings.memory, "--memory")
    refuse_test_memories(settings.validation_memory, "--validation-memory")
    memories, judged = memories_of(settings.memory), memories_of(settings.validation_memory)
    folder, command = settings.out / "movements", ["creative-nao agent body-sense"]
    command += changed_flags(settings, ("memory", "validation_memory"))
    command += changed_flags(settings.movements, group="movements.")
    command += changed_flags(settings.learning, group="learning.")
    names = [*judged, *(name for name in memories if name not in judged)]
    with Display({"performing": len(names), "learning": settings.learning.n_epochs}) as display:
        perform_movements(
            folder, names, settings.movements, n_threads=settings.n_threads,
            progress=lambda done: display.show("performing", done),
        )  # fmt: skip
        sense = train_sense(
            folder, memories, judged, settings.learning, settings.movements,
            command=" ".join([*command, f"--out {settings.out.name}"]),
            progress=lambda done, loss: display.show("learning", done, f"validation log loss {loss:.4f}"),
        )  # fmt: skip
    figures = {"out": str(sense.save(settings.out / "body_sense.safetensors")), **sense.header.validation}
    expected, auc = figures["n_expected"], figures["auc"]
    lines = [
        f"{figures['out']}: learned from {len(memories)} memories, epoch {figures['epoch']} kept",
        f"validation: {figures['n_refused']} of {figures['n_performed']} movements refused, {expected:.1f} expected; "
        f"refused ones ranked higher in {'-' if auc is None else f'{100 * auc:.1f}'} % of pairs",
    ]
    print_result(figures, lines, as_json=settings.json)
    return 0
