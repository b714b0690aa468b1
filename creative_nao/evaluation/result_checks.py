"""Are the parts of a result file what they should be? It may be a stranger's: every figure is looked at before use."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from creative_nao.errors import CreativeNaoError, FileFormatError
from creative_nao.fields import Fields

MAX_ROWS = 100_000
_LONGEST_TEXT = 20_000


def check_rows(found: Fields, measured: tuple[str, ...]) -> None:
    """Check the rows of a result file, as far as they have the fields of a suite's.

    Args:
        found: The file.
        measured: Fields that hold a mean with an interval, or null.

    Raises:
        FileFormatError: Naming the row and the field.
    """
    found.text("suite")
    for row in found.objects("rows", MAX_ROWS):
        for name in row.values:
            if name in ("agent", "env", "memory"):
                row.text(name, longest=4_000)
            elif name in ("n_seeds", "n_actions"):
                row.whole(name, least=1)
            elif name in measured:
                _interval(row, name)
            elif name == "reward_per_seed":
                rewards = row.object(name)
                for seed in rewards.values:
                    if not seed.isdecimal() or len(seed) > 19:
                        raise FileFormatError(f"{rewards.where} should be named by seeds, but has `{seed[:40]}`")
                    rewards.number(seed)


def check_summary(found: Fields) -> None:
    """Check summary, record and baseline of a result file that is published.

    Raises:
        FileFormatError: Naming the entry and the field.
    """
    for entry in found.objects("summary", MAX_ROWS):
        for name in ("agent", "env"):
            entry.text(name, longest=4_000)
        for name in ("n_memories", "n_seeds"):
            entry.whole(name, least=1)
        entry.whole("n_actions_training", least=0)
        for name in ("reward_iqm", "reward", "oracle_share"):
            _interval(entry, name)
        if entry.any("reward_iqm") is None:
            raise entry.refuse("reward_iqm", "a mean with an interval")
        if entry.any("versus") is not None:
            versus = entry.object("versus")
            _interval(versus, "probability_of_improvement")
            versus.whole("n_memories_ahead", least=0)
    if found.any("baseline") is not None:
        found.text("baseline")
    record = found.object("record")
    record.text("command", _LONGEST_TEXT)
    versions = record.object("versions")
    for name in ("creative-nao", *versions.values):
        versions.text(name)
    suite = record.object("settings").object("suite")
    suite.whole("n_actions", least=1)
    if "about" in suite:
        suite.text("about", _LONGEST_TEXT)


@contextlib.contextmanager
def naming(what: str) -> Iterator[None]:
    """Turn what goes wrong over the parts of a file that are looked at in passing into an error that names the file.

    Args:
        what: Beginning of the message.

    Raises:
        FileFormatError: In place of the errors of Python over a missing part or one of another kind.
    """
    try:
        yield
    except CreativeNaoError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        raise FileFormatError(
            f"{what}: a part is missing or of another kind ({type(error).__name__}: {error})"
        ) from error


def _interval(found: Fields, name: str) -> None:
    if found.any(name) is None:
        return
    inner = found.object(name)
    inner.number("mean")
    if inner.any("low") is None and inner.any("high") is None:
        return
    inner.number("high", least=inner.number("low"))
