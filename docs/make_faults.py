"""Write the table of faults into docs/reliability.md from what a test run recorded: `python docs/make_faults.py`.

The record is `docs/faults.json`; `tests/faults` writes it:

    pytest -m "slow or not slow" tests/faults --write-faults docs/faults.json
"""

import json
from collections import Counter
from pathlib import Path
from typing import Any

from creative_nao import storage

DOCS = Path(__file__).parent
PAGE, RECORD = DOCS / "reliability.md", DOCS / "faults.json"
BEGIN, END = "<!-- faults: written by docs/make_faults.py -->", "<!-- end of faults -->"


def fault_table(record: dict[str, Any]) -> str:
    """Return what was tried and survived as two Markdown tables: commands by faults, and how each fault is answered."""
    cases = record["cases"]
    commands = list(dict.fromkeys(case["command"] for case in cases))
    faults = list(dict.fromkeys(case["fault"] for case in cases))
    lines = [
        f"| survived of tried | {' | '.join(faults)} |",
        f"| --- |{' ---: |' * len(faults)}",
    ]
    for command in commands:
        cells = [_share([one for one in cases if (one["command"], one["fault"]) == (command, name)]) for name in faults]
        lines.append(f"| `{command}` | {' | '.join(cells)} |")
    lines += ["", "| fault | exit codes (how often) | what is said, for example |", "| --- | --- | --- |"]
    for name in faults:
        mine = [case for case in cases if case["fault"] == name]
        codes = Counter(case["exit_code"] for case in mine)
        told = ", ".join(f"{code} ({count})" for code, count in sorted(codes.items()))
        said = max((case["said"] for case in mine if case["exit_code"] > 0), key=len, default="")
        lines.append(f"| {name} | {told} | {f'`` {said} ``' if said else '-'} |")
    return "\n".join(lines)


def _share(cases: list[dict[str, Any]]) -> str:
    return f"{sum(case['survived'] for case in cases)} of {len(cases)}" if cases else "-"


def with_table(page: str, record: dict[str, Any]) -> str:
    """Return the page with its table written anew."""
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n{fault_table(record)}\n{END}{rest.split(END)[1]}"


if __name__ == "__main__":
    text = with_table(PAGE.read_text(encoding="utf-8"), json.loads(RECORD.read_text(encoding="utf-8")))
    storage.write_text(PAGE, text)
