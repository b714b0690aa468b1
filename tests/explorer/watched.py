"""The explorer in a process of its own that tells, line by line, which tabs it still holds."""

import gc
import json
import sys
import threading
import weakref
from pathlib import Path

from creative_nao.explorer import server
from creative_nao.explorer.physics_service import PhysicsService
from creative_nao.explorer.registry import MemoryRegistry
from creative_nao.explorer.state import Session
from creative_nao.model import load_memory


def main(port, folder, patience_s):
    server.RECONNECT_S = float(patience_s)
    born, registers = [], []
    admits, make = server.Tabs.admits, server.Tabs.__init__

    def remembered(self):
        make(self)
        registers.append(self)

    def watched(self, tab):
        born.append(weakref.ref(tab))
        return admits(self, tab)

    server.Tabs.__init__, server.Tabs.admits = remembered, watched

    def tell():
        for _ in sys.stdin:
            gc.collect()
            found = {"born": len(born), "kept": sum(map(len, registers)), "alive": sum(r() is not None for r in born)}
            found["learning"] = sum(thread.name == "trainer" for thread in threading.enumerate())
            sys.stdout.write(json.dumps(found) + "\n")
            sys.stdout.flush()

    threading.Thread(target=tell, daemon=True).start()
    app_state = server.AppState(
        MemoryRegistry([load_memory("half/0")], 30), PhysicsService(), Session(Path(folder) / "s.json")
    )
    server.serve(app_state, host="127.0.0.1", port=int(port), show=False)


if __name__ == "__main__":
    main(*sys.argv[1:])
