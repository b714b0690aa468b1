"""What jobs cost in seconds of a core, and what a campaign of many would: `python benchmarks/campaign.py`.

CPU time is measured, not time on the wall, so that other work on the machine changes little.
"""

import dataclasses
import os
import tempfile
from pathlib import Path

from creative_nao.evaluation.jobs import Job, plan
from creative_nao.evaluation.runner import LocalExecutor
from creative_nao.evaluation.suites import Suite, find_suite

N_JOBS = 100_000
MENTAL, PHYSICAL = "CreativeNao/BoxingMental-v0", "CreativeNao/Boxing-v0"
REPEATS = 1


def seconds(job: Job) -> float:
    """Return the seconds of a core that a job takes: the least of `REPEATS` times."""
    found = []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as folder:
            before = os.times()
            LocalExecutor(1).run([job], Path(folder))
            after = os.times()
        found.append(sum(after[2:4]) - sum(before[2:4]))  # of children: the job's process
    return min(found)


def first(suite: Suite, kind: str) -> Job:
    """Return the first job of a kind."""
    return next(job for job in plan(suite, base_seed=0) if job.kind == kind)


def per_episode(suite: Suite, env: str, n_more: int) -> tuple[float, float]:
    """Return what a process costs before its first episode, and each episode, from a job of one and a longer one."""
    few, many = (
        dataclasses.replace(
            suite,
            agents=("random",),
            envs=(env,),
            memories=("half/12",),
            n_seeds=n,
            seeds_per_job=n,
            memories_per_job=1,
        )
        for n in (1, 1 + n_more)
    )
    one, more = seconds(first(few, "play")), seconds(first(many, "play"))
    episode = (more - one) / n_more
    return one - episode, episode


def main() -> None:
    search, transfer = find_suite("search"), find_suite("transfer")
    start, mental = per_episode(search, MENTAL, 60)
    _, physical = per_episode(search, PHYSICAL, 3)
    chart = seconds(first(dataclasses.replace(search, memories=("half/12",)), "chart")) - start
    assert transfer.taught is not None
    teach = seconds(first(transfer, "teach")) - start
    print(f"start of a process                    {start:8.2f} s")
    print(f"episode of 30 actions, mental         {mental:8.3f} s")
    print(f"episode of 30 actions, physical       {physical:8.2f} s")
    print(f"map of 200 x 200 and its oracle       {chart:8.2f} s")
    print(f"training a memory, {transfer.taught.n_epochs:,} epochs     {teach:8.2f} s")
    for title, episode in (("mental", mental), ("physical", physical)):
        for group in (1, 10, 100):
            hours = (N_JOBS * episode + N_JOBS / group * start) / 3600.0
            print(f"{N_JOBS:,} episodes, {title}, {group} a process: {hours:.1f} core hours")


if __name__ == "__main__":
    main()
