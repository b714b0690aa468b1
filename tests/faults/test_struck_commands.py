"""Whatever strikes a command at whatever moment: nothing is lost but the current interval, and nothing is torn.

With `pytest -m "slow or not slow" tests/faults --write-faults docs/faults.json` all cases are tried and recorded.
"""

import shutil

import pytest
from striking import (
    CASES,
    SIGNALS,
    TWO,
    case_name,
    check_code,
    check_equal,
    draw,
    end,
    go_on,
    last_line,
    run,
    start,
)  # fmt: skip
from struck_commands import COMMANDS, RUN_FOLDER
from whole_files import contents, remains

QUICK = {
    ("train", "kill -9", 0), ("explore, favourites", "SIGTERM", 0), ("explore, favourites", "full disk", 0),
    ("explore, favourites", "read-only folder", 0), ("explore, favourites", TWO, 0),
}  # fmt: skip
"""Cases of the everyday run: one resume, and the command that writes oftenest; SIGINT is in tests/cli."""


PARAMETERS = [
    pytest.param(*case, id=case_name(*case), marks=() if case in QUICK else (pytest.mark.slow,)) for case in CASES
]


@pytest.mark.parametrize(("name", "fault", "number"), PARAMETERS)
def test_a_struck_command_loses_nothing_but_the_current_interval(name, fault, number, tmp_path, undisturbed, tried):
    command, out = COMMANDS[name], tmp_path / RUN_FOLDER
    plain, whole = undisturbed(name)
    moment, delay_s = draw(name, fault, number, plain.n_touches)
    tried |= {"command": name, "fault": fault, "touch": moment, "of": plain.n_touches, "delay_s": delay_s}
    if fault == TWO:
        tried |= two_at_once(name, tmp_path, whole)
        return

    struck = run(command, tmp_path, fault=fault, moment=moment, delay_s=delay_s)
    if struck.code == 0 and delay_s:  # it was over before the delay was
        shutil.rmtree(out)
        struck, delay_s = run(command, tmp_path, fault=fault, moment=moment, name="again"), 0.0
    tried |= {"exit_code": struck.code, "said": last_line(struck.said).replace(f"{tmp_path}/", ""), "delay_s": delay_s}
    assert struck.struck
    check_code(fault, struck.code)
    assert bool(tried["said"]) == (struck.code not in (0, -9)), struck
    if fault not in ("kill -9", "read-only folder"):  # these leave no chance to tidy up; the next run does
        assert remains(out) == [] if out.exists() else True
    if out.exists():
        contents(out)  # raises when a file is torn

    if fault == "folder removed" and struck.code and not (out / "run.json").exists():
        shutil.rmtree(out, ignore_errors=True)  # what the fault took is gone; what came after is no run
    resumed = go_on(command, tmp_path, struck)
    assert resumed.code == 0, resumed
    check_equal(command, tmp_path, whole)
    if command.interval and fault != "folder removed":
        done = struck.kept(command.interval) + resumed.kept(command.interval)
        # One for the interval that was lost, and one for the state that a stopped command keeps.
        assert done <= plain.kept(command.interval) + command.at_work + 1


def two_at_once(name, folder, whole):
    """Start a command twice at the same time: both finish, or one is told that the place is taken."""
    command, shared = COMMANDS[name], name == "explore, favourites"  # there, each adds something of its own
    started = [
        start(command, folder, name=f"run{number}", more=(str(number),) if shared else ()) for number in range(2)
    ]
    ended = [end(one) for one in started]
    codes = sorted(one.code for one in ended)
    assert codes in ([0, 0], [0, 2]), ended
    said = [last_line(one.said).replace(f"{folder}/", "") for one in ended]
    for one, line in zip(ended, said, strict=True):
        assert bool(line) == (one.code == 2), ended
    if shared:
        kept = contents(folder / RUN_FOLDER)["session.json"]["favourites"]
        assert len({tuple(one["points"][0]) for one in kept}) == len(kept) == 16
    else:
        check_equal(command, folder, whole)
    return {"exit_code": codes[1], "said": max(said, key=len), "touch": None, "of": None}


@pytest.mark.slow
@pytest.mark.parametrize("fault", SIGNALS[1:])
def test_a_command_stopped_while_it_loads_says_so_in_one_line(fault, tmp_path):
    struck = run(COMMANDS["train"], tmp_path, fault=fault, moment=0)

    assert struck.struck
    assert struck.code == 130
    assert last_line(struck.said) == "creative-nao: stopped"
