"""Every subcommand and option of the program has a name in Python, or a reason for its absence."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
from pathlib import Path

import pytest

import spinney
import spinney.shards

PAGE = Path(__file__).parents[2] / "docs" / "options.md"


def rows(begin: str) -> list[list[str]]:
    lines = PAGE.read_text().splitlines()
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines if line.startswith(begin)]


def help_of(program: str, *words: str) -> str:
    # (Narrower pages break the lines of tables.)
    environment = os.environ | {"COLUMNS": "100"}
    command = [program, "help", *words]
    return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout


def commands(program: str) -> list[str]:
    """Returns the names of all subcommands, from the program's own list."""
    listed = help_of(program).split("\nOptions:")[0]
    names = [name for name in re.findall(r"^  ([a-z-]+) {2,}\S", listed, re.MULTILINE) if name != "help"]
    for task in ("edit", "shard"):
        own = re.findall(r"^  ([a-z-]+) {2,}\S", help_of(program, task).split("Commands:")[1].split("\n\n")[0], re.MULTILINE)
        names += [f"{task} {name}" for name in own if name != "help"]
    return sorted(names)


def named(text: str) -> list[str]:
    """Returns the names in a cell of the table: `build(crs=)`, `Dataset.read`; none if the cell
    gives a reason.
    """
    return re.findall(r"`([^`]+)`", text)


def check(name: str) -> None:
    path, _, argument = name.partition("(")
    found = spinney
    for part in path.split("."):
        found = getattr(found, part)
    if argument:
        parameters = inspect.signature(found).parameters
        assert argument.rstrip(")=") in parameters, name


def test_options_have_names(program: str) -> None:
    documented: dict[str, set[str]] = {}
    every = commands(program)
    for option, meaning, used, python in rows("| `--"):
        assert meaning and python, option
        documented[option.strip("`")] = set(every) if used == "all" else set(used.split(", "))
        names = named(python)
        assert names or " " in python, f"{option}: neither a name nor a reason"
        for name in names:
            check(name)
    found: dict[str, set[str]] = {}
    for command in every:
        # Options of a topic are on its page only.
        text = help_of(program, *command.split())
        table = text.partition("TOPIC`):\n")[2]
        for topic in re.findall(r"^  (\w+) ", table, re.MULTILINE):
            text += help_of(program, *command.split(), topic)
        for option in re.findall(r"^ {2,6}(?:-\w, )?(--[\w-]+)", text, re.MULTILINE):
            if option not in ("--help", "--version"):
                found.setdefault(option, set()).add(command)
    assert found.keys() == documented.keys()
    for option, commands_with_it in documented.items():
        # (`shard plan` refuses some options of `build`, which its help leaves out.)
        assert commands_with_it - found[option] <= {"shard plan"}, option
        assert found[option] <= commands_with_it, option


def test_commands_have_names(program: str) -> None:
    listed = rows("| `spinney ")
    assert [command.strip("`").removeprefix("spinney ") for command, _ in listed] == commands(program)
    for command, python in listed:
        names = named(python)
        assert names or " " in python, f"{command}: neither a name nor a reason"
        for name in names:
            check(name)


@pytest.mark.parametrize("name", ["nothing", "build(nothing=)"])
def test_the_check_can_fail(name: str) -> None:
    with pytest.raises((AttributeError, AssertionError)):
        check(name)
