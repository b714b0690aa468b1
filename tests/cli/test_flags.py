"""What a command's help says of its flags."""

import dataclasses
import importlib
import shlex
from pathlib import Path

import pytest

from creative_nao.cli import main
from creative_nao.cli.dispatch import COMMANDS, _parse, field_texts, with_default
from creative_nao.cli.train import TrainSettings, _command
from creative_nao.model import NetworkSettings


def settings_of(name):
    """Return the dataclass of a command's settings."""
    module, settings, _ = COMMANDS[name]
    return getattr(importlib.import_module(f"creative_nao.cli.{module}"), settings)


def without_spaces(text):
    return "".join(text.split())


@pytest.mark.parametrize("name", COMMANDS)
def test_every_flag_has_a_whole_text_and_one_default(name, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "120")
    settings = settings_of(name)
    assert main([*name.split(), "--help"]) == 0
    text = without_spaces(capsys.readouterr().out.replace("│", ""))  # the box breaks lines, between commas too
    assert "default:None" not in text
    assert "{None}" not in text
    texts = field_texts(settings)
    for field in dataclasses.fields(settings):
        assert without_spaces(with_default(texts[field.name], field.default)[0]) in text, field.name


def test_a_value_without_a_flag_is_called_by_its_name(capsys):
    main(["map", "--help"])
    assert "[MEMORY]" in capsys.readouterr().out


def test_the_defaults_that_a_text_tells_stand_where_the_others_do():
    assert with_default("Folder; default: the shipped ones.", None) == ("Folder.", "(default: the shipped ones)")
    assert with_default("Folder; default: the shipped ones.", "mine") == ("Folder; default: the shipped ones.", None)


def test_the_command_that_a_memory_records_trains_it_again():
    out, network = Path("m.safetensors"), NetworkSettings(layer_sizes=(30, 12), time_constants=(2.0, 6.0), n_pb=3)
    wanted = TrainSettings(out, seed=(4,), schedule="annealed", anneal_epochs=70, learning_rate=0.01, network=network)
    assert _parse(TrainSettings, "train", shlex.split(_command(wanted))[2:]) == wanted
    assert _command(TrainSettings(out)) == (
        "creative-nao train --closed-loop-ratio 0.5 --n-epochs 100000 --seed 0 --out m.safetensors"
    )
