"""How the command line talks: commands in groups, each with examples, completion for the shell, and what comes next."""

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
from click.shell_completion import get_completion_class

from sinew.runner.errors import SinewError, one_line
from sinew.runner.printing import put
from sinew.tasks.registry import TASKS

PROGRAM, COMPLETION = "sinew", "_SINEW_COMPLETE"
SHELLS = ("bash", "zsh", "fish")

#: Commands as ``sinew --help`` lists them; whatever is in no group comes last.
GROUPS: Mapping[str, Sequence[str]] = {
    "Begin": ("demo", "init", "import", "cohort"),
    "Run a study": ("run", *TASKS, "simulate"),
    "Look": ("watch", "status", "report", "fields", "export"),
    "On a cluster": ("doctor", "submit", "cancel"),
    "Care": ("trust", "repair", "benchmark", "reproduce", "completion"),
}
EXAMPLES: Mapping[str, Sequence[str]] = {
    "init": ("sinew init bench/*.csv --out study --length-mm 20 --width-mm 5 --thickness-mm 1.5",),
    "import": ("sinew import bench/*.csv --out data/tails --tare",),
    "demo": ("sinew demo", "sinew demo --out /tmp/sinew-demo --workers 2"),
    "cohort": ("sinew cohort --out data/virtual --per-site 1",),
    "run": ("sinew run study.yaml", "sinew run study.yaml --data data/tails --out results/tails --workers 4"),
    **{name: task.examples or (f"sinew {name} study.yaml",) for name, task in TASKS.items()},
    "simulate": ("sinew simulate study.yaml --parameters rows.csv --out forces",),
    "watch": ("sinew watch results/demo", "sinew watch results/demo --json | jq .state"),
    "report": ("sinew report results/demo", "sinew report results/demo results/again --out both.html"),
    "export": (
        "sinew export results/demo --ro-crate",
        "sinew export results/demo --ro-crate --out demo.zip --license CC-BY-4.0",
    ),
    "status": ("sinew status results/demo", "sinew status results/demo --rows > rows.csv"),
    "doctor": ("sinew doctor study.yaml --profile my-site.yaml",),
    "submit": ("sinew submit study.yaml --profile my-site.yaml --dry-run",),
    "cancel": ("sinew cancel results/demo",),
    "trust": ("sinew trust study.yaml",),
    "repair": ("sinew repair results/demo",),
    "fields": ("sinew fields results/dogbone --row 3", "sinew fields results/dogbone --row 3 --row 7 --to paraview"),
    "completion": (
        'eval "$(sinew completion bash)"          # in ~/.bashrc',
        'eval "$(sinew completion zsh)"           # in ~/.zshrc, after compinit',
        "sinew completion fish > ~/.config/fish/completions/sinew.fish",
    ),
}


def examples(*lines: str) -> str:
    """Examples as click prints them below a help: line by line."""
    return "\n".join(("\b", "Examples:", *(f"  {line}" for line in lines)))


class Commands(click.Group):
    """The command ``sinew`` itself: its help lists commands by what they are for."""

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """As click's, in groups."""
        names = self.list_commands(context)
        grouped = {name for group in GROUPS.values() for name in group}
        groups = {**GROUPS, "Other": [name for name in names if name not in grouped]}
        width = max(map(len, names))
        for title, wanted in groups.items():
            there = [(name, self.commands[name]) for name in wanted if name in names]
            rows = [(name.ljust(width), command.get_short_help_str(formatter.width)) for name, command in there]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

    def add_command(self, command: click.Command, name: str | None = None) -> None:
        """As click's; the examples of a command go below its help."""
        own = EXAMPLES.get(name or command.name or "")
        if own and command.epilog is None:
            command.epilog = examples(*own)
        super().add_command(command, name)


def completion_script(group: click.Group, shell: str) -> str:
    """What a shell has to read to complete ``sinew``. Raises ``SinewError``."""
    kind = get_completion_class(shell)
    if kind is None:
        raise SinewError(f"completion: no shell {shell}; expected one of {', '.join(SHELLS)}")
    return kind(group, {}, PROGRAM, COMPLETION).source()


def command_line(*words: str | Path) -> str:
    """A command that a person can copy, in one line."""
    return one_line(shlex.join(["sinew", *map(str, words)]))


def say_next(*commands: str, as_json: bool = False) -> None:
    """The last line of a command: what to look at, or to do, next."""
    if as_json:
        put(json.dumps({"event": "next", "commands": list(commands)}))
    else:
        put(f"next: {'   or   '.join(commands)}")


def say(as_json: bool, words: str, /, **facts: Any) -> None:
    """A line of a command's outcome: ``words``, or ``facts`` as a JSON object."""
    put(json.dumps(facts) if as_json else words)
