"""Strikes the process under test. Python reads this file before anything else when its folder is in PYTHONPATH.

Every touch of the run folder (a file made, opened for writing, renamed or removed there) is counted and noted; at the
touch that `STRIKE` names, the fault happens: before the touch takes place, or a moment later.
"""

import contextlib
import datetime
import errno
import itertools
import json
import os
import shutil
import signal
import sys
import threading
import time

SIGNALS = {"kill -9": signal.SIGKILL, "SIGINT": signal.SIGINT, "SIGTERM": signal.SIGTERM}
JUMPS_S = {"clock jumps back": -86_400.0, "clock jumps ahead": 86_400.0}
EARLY = "creative_nao.cli.progress"
"""At moment 0 the strike comes when `train` loads this: before it does anything, and long before it is ready."""
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


class Striker:
    """Watches the touches of one folder; `plan` is what `STRIKE` holds."""

    def __init__(self, plan):
        self.folder, self.fault, self.moment = plan["folder"], plan["fault"], plan["moment"]
        self.delay_s, self.mark = plan["delay_s"], plan["mark"]
        self.count, self.busy = itertools.count(1), False
        self.log = os.open(plan["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self.worker = any("creative_nao.evaluation.job_handlers" in word for word in sys.orig_argv)
        self.refusing = False
        self.ahead_s = 0.0

    def __call__(self, event, arguments):
        if self.busy:
            return
        if event == "import" and self.moment == 0 and arguments[0] == EARLY:
            self.moment = -1
            self.strike()
        if event == "open":
            if not arguments[2] & WRITING or isinstance(arguments[0], int):
                return
            paths = arguments[:1]
        elif event == "os.rename":
            paths = arguments[:2]
        elif event in ("os.remove", "os.mkdir"):
            paths = arguments[:1]
        else:
            return
        path = os.path.abspath(os.fsdecode(paths[-1]))
        if path.startswith(self.folder):
            self.touched(event, path, paths[-1])

    def touched(self, event, path, given):
        with contextlib.suppress(OSError):
            os.write(self.log, f"{'worker' if self.worker else 'runner'} {event} {path}\n".encode())
        if self.worker:
            if os.path.exists(self.mark):
                self.strike_disk()
        elif next(self.count) == self.moment:
            self.strike()
        if self.refusing:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), given)

    def strike(self):
        with contextlib.suppress(OSError):
            os.close(os.open(self.mark, os.O_WRONLY | os.O_CREAT))
        if self.fault in SIGNALS:
            threading.Thread(target=self.send, daemon=True).start() if self.delay_s else self.send()
        elif self.fault == "folder removed":
            self.busy = True
            shutil.rmtree(self.folder, ignore_errors=True)
            self.busy = False
        elif self.fault in JUMPS_S:
            self.ahead_s = JUMPS_S[self.fault]
        else:
            self.strike_disk()

    def send(self):
        time.sleep(self.delay_s)
        os.kill(os.getpid(), SIGNALS[self.fault])

    def strike_disk(self):
        if self.fault == "full disk":
            import resource

            resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
        elif self.fault == "read-only folder":
            self.refusing = True


def shift_clocks(striker):
    """Let every clock of the day be `striker.ahead_s` ahead; the monotonic ones go on, as the system's do."""
    seconds, nanoseconds, true = time.time, time.time_ns, datetime.datetime

    class Shifted(true):
        @classmethod
        def now(cls, tz=None):
            return super().now(tz) + datetime.timedelta(seconds=striker.ahead_s)

    time.time = lambda: seconds() + striker.ahead_s
    time.time_ns = lambda: nanoseconds() + int(striker.ahead_s * 1e9)
    datetime.datetime = Shifted


if "STRIKE" in os.environ:
    striker = Striker(json.loads(os.environ["STRIKE"]))
    if striker.fault in JUMPS_S:
        shift_clocks(striker)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in what a shell starts in the background
        signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.addaudithook(striker)
