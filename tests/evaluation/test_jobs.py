"""Jobs: planned from data, done once, tried again when killed, stopped by Ctrl-C, and gone with their runner."""

import dataclasses
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from creative_nao.errors import NotFoundError, SettingsError
from creative_nao.evaluation.jobs import Job, plan, read_result, read_spec, write_result, write_spec
from creative_nao.evaluation.runner import JobError, LocalExecutor
from creative_nao.evaluation.suites import SUITE_NAMES, find_suite

SUITES = {name: find_suite(name) for name in SUITE_NAMES}


def play_job(seeds=(0,), agent="random", name=None, **changes):
    spec = {
        "agent": agent,
        "envs": ["fake_boxing:Fake/BoxingMental-v0"],
        "memories": [{"name": "fake/0", "file": None}],
        "seeds": list(seeds),
        "base_seed": 0,
        "n_actions": 30,
        "bundles": [],
        "made_by": [],
    }
    return Job(
        name=name or f"play-{agent}-" + "-".join(map(str, seeds)), kind="play", title="judge", spec={**spec, **changes}
    )


def endless_job():
    """Judges for minutes."""
    return play_job(seeds=range(20_000), name="endless")


def test_an_unknown_suite_brings_the_nearest():
    with pytest.raises(NotFoundError, match=r"no suite `quik` \(did you mean `quick`\?\); there are: quick"):
        find_suite("quik")


@pytest.mark.parametrize("suite", SUITES.values(), ids=SUITES)
def test_every_suite_s_jobs_stand_after_those_they_need(suite):
    seen = set()
    for job in plan(suite, base_seed=0):
        assert set(job.needs) <= seen
        assert job.name not in seen
        seen.add(job.name)


@pytest.mark.parametrize("suite", SUITES.values(), ids=SUITES)
def test_every_agent_is_judged_once_per_seed_and_environment(suite):
    jobs = [job for job in plan(suite, base_seed=0) if job.kind == "play"]
    judged = [
        (job.spec["agent"], memory["name"], env, seed)
        for job in jobs
        for memory in job.spec["memories"]
        for env in job.spec["envs"]
        for seed in job.spec["seeds"]
    ]
    assert len(judged) == len(set(judged))
    assert len(judged) == len(suite.agents) * len(suite.memories) * len(suite.envs) * suite.n_seeds


def test_a_suite_with_nothing_to_do_is_refused(make_suite):
    with pytest.raises(SettingsError, match="`n_seeds` should be at least 1, but is 0"):
        make_suite(n_seeds=0)


def test_jobs_survive_their_files(tmp_path):
    job = play_job()
    assert read_spec(write_spec(job, tmp_path)) == job


def test_a_result_counts_only_for_its_own_spec(tmp_path):
    job = play_job()
    assert read_result(job, tmp_path) is None
    write_result(job, tmp_path, {"episodes": []})
    assert read_result(job, tmp_path) == {"episodes": []}
    assert read_result(play_job(base_seed=1), tmp_path) is None
    job.file(tmp_path, ".result.json").write_text("{torn")
    assert read_result(job, tmp_path) is None


def test_a_finished_job_is_not_done_again(tmp_path, in_workers):
    job = play_job()
    write_result(job, tmp_path, {"episodes": "done before"})
    assert LocalExecutor(1).run([job], tmp_path) == {job.name: {"episodes": "done before"}}
    assert not job.file(tmp_path, ".log").exists()  # no process was started


def test_progress_ends_with_all_done(tmp_path, in_workers):
    seen = []
    LocalExecutor(1).run([play_job()], tmp_path, on_progress=seen.append)
    assert seen[0].running == ("judge",)
    assert (seen[-1].n_done, seen[-1].n_total, seen[-1].share, seen[-1].running) == (1, 1, 1.0, ())
    assert all(progress.seconds_left >= 0.0 for progress in seen)


DEADLY = {"envs": ["fake_boxing:Fake/Deadly-v0"]}


def test_a_killed_worker_s_job_is_tried_again(tmp_path, in_workers, monkeypatch):
    mark = tmp_path / "died"
    monkeypatch.setenv("FAKE_DEATH_MARK", str(mark))
    job = play_job(**DEADLY)
    results = LocalExecutor(1).run([job], tmp_path)
    assert mark.exists()
    assert len(results[job.name]["episodes"]) == 1


def test_a_job_that_is_killed_every_time_is_named_and_the_others_are_finished(tmp_path, in_workers):
    doomed, other = play_job(seeds=(0,), **DEADLY), play_job(seeds=(1,))
    with pytest.raises(JobError, match=rf"job `{doomed.name}` failed: 2 attempts, killed by signal 9, .*add --resume"):
        LocalExecutor(1, n_attempts=2).run([doomed, other], tmp_path)
    assert read_result(other, tmp_path) is not None


def test_a_user_s_mistake_is_told_in_the_job_s_own_words_and_not_tried_again(tmp_path, in_workers):
    job = play_job(agent="randon")
    with pytest.raises(JobError, match=r"job `play-randon-0` failed: no agent `randon` \(did you mean `random`\?\)"):
        LocalExecutor(1).run([job], tmp_path)
    assert job.file(tmp_path, ".log").read_text().count("no agent") == 1


def test_ctrl_c_stops_the_workers_and_keeps_what_is_finished(tmp_path, in_workers):
    first, second = play_job(seeds=(0,)), endless_job()
    second = dataclasses.replace(second, seconds=1.0)  # the shorter is expected to be, the later it starts

    def interrupt(progress):
        if progress.n_done == 1 and second.file(tmp_path, ".progress").exists():
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        LocalExecutor(1).run([first, second], tmp_path, on_progress=interrupt)
    time.sleep(1.0)  # a worker still alive would report again
    assert not second.file(tmp_path, ".progress").exists()
    assert [read_result(job, tmp_path) is not None for job in (first, second)] == [True, False]
    assert not list(tmp_path.glob("jobs/.*"))  # nothing half-written


def test_workers_leave_when_their_runner_is_killed(tmp_path, in_workers):
    """A runner killed without warning leaves no worker behind."""
    spec = write_spec(endless_job(), tmp_path)
    runner = """
import os, subprocess, sys, time
from creative_nao.runtime import python_command
command = python_command("creative_nao.evaluation.job_handlers", *sys.argv[1:])
print(subprocess.Popen(command, env={**os.environ, "CREATIVE_NAO_RUNNER": str(os.getpid())}).pid, flush=True)
time.sleep(60)
"""
    command = [sys.executable, "-c", runner, str(spec), str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        worker = int(process.stdout.readline())
        time.sleep(1.0)
        process.kill()
    deadline = time.monotonic() + 8.0
    while time.monotonic() < deadline and _alive(worker):
        time.sleep(0.1)
    assert not _alive(worker)


def _alive(number):
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{number}/stat")  # a process nobody collected yet is still listed
    return not (state.exists() and ") Z " in state.read_text())


def test_no_workers_is_a_mistake(tmp_path):
    with pytest.raises(SettingsError, match="`n_workers` should be at least 1, but is 0"):
        LocalExecutor(0).run([], tmp_path)
