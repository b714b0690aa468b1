"""Make the golden numbers of this machine's versions and processor again: `python tests/determinism/make_golden.py`.

Adds or replaces the entry of this machine in tests/reference/golden.json and keeps the others. To be run when a result
is meant to change; the commit says why.
"""

import json

from golden import FILE, compute, key

from creative_nao import storage


def main() -> None:
    kept = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    kept[key()] = compute()
    storage.write_text(FILE, json.dumps(kept, sort_keys=True, separators=(",", ":"), allow_nan=False) + "\n")
    print(f"{key()}: {FILE.name} holds {len(kept)} entries")  # noqa: T201 - a program


if __name__ == "__main__":
    main()
