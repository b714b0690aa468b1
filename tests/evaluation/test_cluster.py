"""A cluster of two workers on this machine: the same results as here, also when one of them is killed in the middle."""

import os
import signal
import subprocess
import sys
import time

import pytest

from creative_nao.errors import MissingDependencyError, NotFoundError, SettingsError
from creative_nao.evaluation import runner
from creative_nao.evaluation.jobs import plan, read_result
from creative_nao.evaluation.runner import DaskExecutor, JobError, LocalExecutor, do_job

QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


@pytest.fixture(scope="module")
def two_workers(in_workers, tmp_path_factory):
    """The address of a scheduler and the processes of its two workers."""
    pytest.importorskip("distributed")
    where = tmp_path_factory.mktemp("cluster")
    told = where / "scheduler.json"

    def start(program, *options):
        command = [sys.executable, "-m", f"distributed.cli.{program}", "--scheduler-file", str(told), "--no-dashboard"]
        return subprocess.Popen([*command, *options], cwd=where, **QUIET)

    scheduler = start("dask_scheduler", "--host", "127.0.0.1", "--port", "0")
    local = ["--nthreads", "1", "--no-nanny", "--host", "127.0.0.1", "--local-directory", str(where)]
    workers = [start("dask_worker", *local) for _ in range(2)]
    try:
        yield _address(told), workers
    finally:
        for process in (*workers, scheduler):
            process.terminate()
        for process in (*workers, scheduler):
            process.wait(20)


def _address(told):
    import json

    from distributed import Client

    deadline = time.monotonic() + 60.0
    while not told.exists() or not told.read_text():
        assert time.monotonic() < deadline
        time.sleep(0.1)
    address = json.loads(told.read_text())["address"]
    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
    return address


@pytest.fixture(scope="module")
def jobs(make_suite):
    """Trainings and judgings, some of which need others and their files."""
    return plan(make_suite(agents=("random", "ppo"), n_seeds=3, seeds_per_job=1), base_seed=5)


def timeless(results):
    """Results without what no run repeats."""
    if isinstance(results, dict):
        return {key: timeless(value) for key, value in results.items() if key != "seconds"}
    return [timeless(value) for value in results] if isinstance(results, list) else results


@pytest.mark.slow
def test_a_worker_killed_in_the_middle_costs_time_and_nothing_else(two_workers, jobs, tmp_path, monkeypatch):
    address, workers = two_workers
    seen = []

    def kill_one(progress):
        seen.append(progress)
        if 1 <= progress.n_done < progress.n_total - 2 and workers[0].poll() is None:
            os.kill(workers[0].pid, signal.SIGKILL)

    far, near = tmp_path / "far", tmp_path / "near"
    results = DaskExecutor(address).run(jobs, far, kill_one)
    assert workers[0].poll() == -signal.SIGKILL
    assert (seen[-1].n_done, seen[-1].n_total) == (len(jobs), len(jobs))

    assert timeless(results) == timeless(LocalExecutor(2).run(jobs, near, lambda _: None))
    for job in jobs:
        for file in job.writes:
            if file.endswith(".safetensors"):  # a map's ZIP carries the time
                assert (far / file).read_bytes() == (near / file).read_bytes()

    def refuse(*_):
        raise AssertionError("a finished job was done again")

    monkeypatch.setattr(runner, "do_job", refuse)
    assert DaskExecutor(address).run(jobs, far, lambda _: None) == results


@pytest.mark.slow
def test_a_mistake_is_told_and_the_rest_is_finished(two_workers, jobs, tmp_path):
    good = next(job for job in jobs if job.name == "play-random-fake-0-0-0")
    bad = type(good)(**{**vars(good), "name": "bad", "spec": {**good.spec, "agent": "randon"}})
    with pytest.raises(JobError, match=r"job `bad` failed: no agent `randon` \(did you mean `random`\?\)"):
        DaskExecutor(two_workers[0]).run([bad, good], tmp_path, lambda _: None)
    assert read_result(good, tmp_path) is not None


@pytest.mark.slow
def test_a_worker_with_another_version_is_refused(two_workers, jobs, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "__version__", "9.9")
    with pytest.raises(
        SettingsError, match=r"worker tcp://127.0.0.1:\d+ should have creative-nao 9.9, as here, but has"
    ):
        DaskExecutor(two_workers[0]).run(jobs, tmp_path, lambda _: None)


def test_a_worker_does_a_job_in_an_empty_folder_and_hands_its_files_back(jobs, in_workers):
    import dataclasses

    job = next(job for job in jobs if job.kind == "chart")
    done = do_job(dataclasses.asdict(job), {})
    assert set(done["files"]) == set(job.writes)
    assert len(done["result"]["oracle_rewards"]) == 30


def test_no_scheduler_is_said(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(runner, "CONNECT_S", 0.5)
    with pytest.raises(
        NotFoundError, match=r"no Dask scheduler at `tcp://127.0.0.1:1` .*start one with `dask scheduler`"
    ):
        DaskExecutor("tcp://127.0.0.1:1").run([], tmp_path, lambda _: None)


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingDependencyError, match=r'pip install "creative-nao\[cluster\]"'):
        DaskExecutor("tcp://127.0.0.1:1").run([], tmp_path, lambda _: None)
