"""`creative-nao agent body-sense`: perform movements in physics, and learn which of them the body refuses."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from creative_nao.agents.body_sense import SenseSettings, perform_movements, train_sense
from creative_nao.agents.training import memories_of, refuse_test_memories
from creative_nao.cli.terminal import Display, changed_flags, print_result


@dataclasses.dataclass(frozen=True)
class BodySenseSettings:
    """Perform movements of memories in physics and learn from them which ones the body refuses.

    The folder --out gets body_sense.safetensors and in movements/ a file for each memory. Those there already are kept:
    the same command goes on after Ctrl-C, and ends with the same bits.
    """

    out: Path
    """Folder to write."""
    memory: str = "train"
    """Memory, or part of the bank, to learn from; never a test memory."""
    validation_memory: str = "validation"
    """Memory, or part of the bank, on which the epoch to keep is chosen."""
    learning: SenseSettings = dataclasses.field(default_factory=SenseSettings)
    """Which movements, and how the network learns."""
    n_threads: int | None = None
    """Movements performed at the same time, without influence on the results; default: one a core."""
    json: bool = False
    """Print the figures as JSON."""


def run(settings: BodySenseSettings) -> int:
    """Perform, train, write the body sense and print how well it predicts."""
    refuse_test_memories(settings.memory, "--memory")
    refuse_test_memories(settings.validation_memory, "--validation-memory")
    memories, judged, learning = (
        memories_of(settings.memory),
        memories_of(settings.validation_memory),
        settings.learning,
    )
    folder, names = settings.out / "movements", tuple(dict.fromkeys((*judged, *memories)))
    flags = changed_flags(settings, ("memory", "validation_memory")) + changed_flags(learning, group="learning.")
    command = " ".join(["creative-nao agent body-sense", *flags, f"--out {settings.out.name}"])
    with Display({"performing": len(names), "learning": learning.n_epochs}) as display:
        perform_movements(
            folder, names, learning, n_threads=settings.n_threads, progress=lambda n: display.show("performing", n)
        )
        sense = train_sense(
            folder, memories, judged, learning, command=command,
            progress=lambda n, loss: display.show("learning", n, f"validation log loss {loss:.4f}"),
        )  # fmt: skip
    figures = {"out": str(sense.save(settings.out / "body_sense.safetensors")), **sense.header.validation}
    print_result(figures, [f"{name}: {value}" for name, value in figures.items()], as_json=settings.json)
    return 0
