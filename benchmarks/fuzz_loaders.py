"""Feed every loader broken files for a while: it has to read each or refuse it by name, in bounded time and memory.

    python benchmarks/fuzz_loaders.py --minutes 20 --seed 0

Seeds are the good files of `tests/hostile/victims.py` and the corpus in `tests/hostile/corpus`;
`tests/hostile/mutations.py` breaks them. An input that is refused for a reason not heard before joins the seeds, and
so does now and then one that is read: words take the place of measured coverage. A finding is any error other than a
`CreativeNaoError`, one that does not name the file, a warning, a result that cannot be used, more than 5 s of the
processor, more than 200 MB. Each kind of finding is written once into the corpus, where
`tests/hostile/test_corpus.py` tries it for ever.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

try:
    import resource
except ImportError:  # not on Windows
    resource = None

HERE = Path(__file__).resolve().parents[1] / "tests" / "hostile"
sys.path.insert(0, str(HERE))

from mutations import mutate  # noqa: E402
from victims import KINDS, Victim, make_victims  # noqa: E402

from creative_nao.errors import CreativeNaoError  # noqa: E402

CORPUS = HERE / "corpus"
LONGEST_S = 5.0
LARGEST_MB = 200.0
MOST_SEEDS = 400


class TooLong(BaseException):
    """A loader takes longer than `LONGEST_S`."""


def main() -> int:
    """Fuzz, print a table, and return 1 if there is a finding."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=20.0, help="how long")
    parser.add_argument("--seed", type=int, default=0, help="decides every input")
    parser.add_argument("--kinds", default=",".join(KINDS), help="only these kinds of file, with commas between")
    parser.add_argument("--corpus", type=Path, default=CORPUS, help="where findings are written")
    chosen = parser.parse_args()
    warnings.simplefilter("error")
    if resource is None or not (
        hasattr(signal, "setitimer") and hasattr(signal, "SIGPROF") and hasattr(signal, "ITIMER_PROF")
    ):
        parser.error("this system has no timer of processor time; run it on Linux or macOS")
    signal.signal(signal.SIGPROF, _too_long)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        victims = make_victims(Path(folder) / "good")
        kinds = chosen.kinds.split(",")
        campaign = Campaign({kind: victims[kind] for kind in kinds}, Path(folder), chosen.corpus, chosen.seed)
        campaign.run(60.0 * chosen.minutes)
    campaign.report()
    return 1 if campaign.findings else 0


class Campaign:
    """Victims, their seeds, and what was found."""

    def __init__(self, victims: dict[str, Victim], folder: Path, corpus: Path, seed: int) -> None:
        self.victims, self.corpus, self.seed = victims, corpus, seed
        self.rng = np.random.default_rng(seed)
        self.seeds = {kind: [victim.path.read_bytes()] for kind, victim in victims.items()}
        for path in sorted(CORPUS.glob("*/*")):
            if path.parent.name in self.seeds:
                self.seeds[path.parent.name].append(path.read_bytes())
        self.places = {kind: folder / kind / f"fuzzed-{victim.path.name}" for kind, victim in victims.items()}
        for place in self.places.values():
            place.parent.mkdir(parents=True, exist_ok=True)
        self.heard: set[tuple[str, str]] = set()
        self.findings: dict[tuple[str, ...], str] = {}
        self.counts: Counter[tuple[str, str]] = Counter()
        for victim in victims.values():
            victim.use(victim.load(victim.path))  # what is compiled at its first use shall not count as slow
        self.started, self.cpu = time.monotonic(), time.process_time()

    def run(self, seconds: float) -> None:
        """Break files until the time is over."""
        kinds = list(self.victims)
        told = time.monotonic()
        while time.monotonic() - self.started < seconds:
            kind = kinds[int(self.rng.integers(len(kinds)))]
            seeds = self.seeds[kind] if self.rng.random() < 0.5 else self.seeds[kind][:1]
            others = self.seeds[kinds[int(self.rng.integers(len(kinds)))]]
            self.try_one(kind, mutate(seeds[int(self.rng.integers(len(seeds)))], others, self.rng))
            if time.monotonic() - told > 60.0:
                told = time.monotonic()
                n = sum(self.counts.values())
                print(f"{(told - self.started) / 60:.0f} min: {n:,} inputs, {len(self.findings)} findings", flush=True)

    def try_one(self, kind: str, content: bytes) -> None:
        """Let a loader read one input."""
        victim, place = self.victims[kind], self.places[kind]
        place.write_bytes(content)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
        try:
            loaded = victim.load(place)
            what = "read"
            if loaded is not None:
                victim.use(loaded)
            elif not victim.lenient:
                self._found(kind, content, ("gives nothing",))
            if self.rng.random() < 0.05:
                self._keep(kind, content)
        except CreativeNaoError as error:
            what = "refused"
            self._listen(kind, content, str(error))
        except (Exception, TooLong) as error:
            what = "finding"
            self._found(kind, content, _signature(error))
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
        self.counts[kind, what] += 1
        grown_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3
        if grown_mb > LARGEST_MB:
            self._found(kind, content, ("memory",))

    def _listen(self, kind: str, content: bytes, message: str) -> None:
        if "fuzzed-" not in message and str(self.places[kind].parent) not in message:
            self._found(kind, content, ("does not name the file", _bare(message)))
        reason = (kind, _bare(message))
        if reason not in self.heard:
            self.heard.add(reason)
            self._keep(kind, content)

    def _keep(self, kind: str, content: bytes) -> None:
        if len(self.seeds[kind]) < MOST_SEEDS and len(content) < 20_000:
            self.seeds[kind].append(content)

    def _found(self, kind: str, content: bytes, signature: tuple[str, ...]) -> None:
        if (kind, *signature) in self.findings:
            return
        folder = self.corpus / kind
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{hashlib.sha256(content).hexdigest()[:12]}{self.victims[kind].path.suffix}"
        path.write_bytes(content)
        self.findings[kind, *signature] = path.name
        print(f"finding: {kind}: {' '.join(signature)[:400]} ({path.name})", flush=True)

    def report(self) -> None:
        """Print a row for every kind."""
        print(f"\nseed {self.seed}, {(time.monotonic() - self.started) / 60:.1f} minutes, "
              f"{(time.process_time() - self.cpu) / 60:.1f} of them on the processor")  # fmt: skip
        print("| kind | inputs | read | refused | reasons | findings |\n| --- | ---: | ---: | ---: | ---: | ---: |")
        for kind in self.victims:
            counts = [self.counts[kind, what] for what in ("read", "refused", "finding")]
            reasons = sum(one == kind for one, _ in self.heard)
            n_found = sum(found[0] == kind for found in self.findings)
            print(f"| {kind} | {sum(counts):,} | {counts[0]:,} | {counts[1]:,} | {reasons} | {n_found} |")
        print(f"all: {sum(self.counts.values()):,} inputs, {len(self.heard):,} reasons, {len(self.findings)} findings")
        print(json.dumps([[*found, name] for found, name in self.findings.items()], indent=1))


def _bare(message: str) -> str:
    """Return a message without what differs from file to file."""
    return re.sub(r"`[^`]*`|'[^']*'|\"[^\"]*\"|[-+]?\d[-+.\de]*", "#", message.split("fuzzed-", 1)[-1])[:120]


def _signature(error: BaseException) -> tuple[str, ...]:
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "fuzz_loaders" not in frame.filename]
    ours = [frame for frame in frames if "creative_nao" in frame.filename] or frames
    where = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}" if ours else "?"
    return type(error).__name__, where, _bare(str(error))


def _too_long(*_: Any) -> None:
    raise TooLong(f"longer than {LONGEST_S} s")


if __name__ == "__main__":
    sys.exit(main())
