"""The grammar: the commands that there are, and what reading a command line costs."""

from __future__ import annotations

import argparse
import subprocess
import sys

from irrsplat.app import grammar


def test_commands_are_listed_by_the_names_that_they_have() -> None:
    top = grammar.build()
    (commands,) = (action for action in top._actions if isinstance(action, argparse._SubParsersAction))
    assert list(commands.choices) == list(grammar.COMMANDS)


def test_reading_a_command_line_imports_no_library() -> None:
    """So that --help is there at once; a library that is missing is found by the command that needs it alone."""
    read = "import sys; before = set(sys.modules); from irrsplat.app import cli; cli.main(['render', '--help'])"
    roots = "{name.split('.')[0] for name in set(sys.modules) - before}"
    told = f"print(*{roots} - sys.stdlib_module_names - {{'irrsplat'}}, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", f"{read}; {told}"], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.startswith("usage: irrsplat render")
    assert done.stderr.split() == []
