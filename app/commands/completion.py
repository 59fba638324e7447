"""`irrsplat completion`: shell script for completion, and the completions: commands, flags, words, scenes and files."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any

from irrsplat.app.commands.shared import flags
from irrsplat.app.commands.shared.command import Command
from irrsplat.app.common.terminal import out
from irrsplat.settings import SETTINGS

SHELLS = ("bash", "zsh", "fish")
Completer = Callable[..., Iterable[str]]  # called with the typed `prefix` of a word, and `parsed_args`


def add(commands: Any) -> None:
    """Add the flags of `irrsplat completion`."""
    parser = commands.add_parser(
        "completion",
        help="print the script for Tab completion",
        description="Print the script for Tab completion of commands, flags, scenes, presets and cameras.",
        epilog='bash and zsh: eval "$(irrsplat completion bash)" in ~/.bashrc, or zsh in ~/.zshrc, after compinit.\n'
        "fish: irrsplat completion fish > ~/.config/fish/completions/irrsplat.fish",
    )
    parser.add_argument("shell", choices=SHELLS, help="the shell")


def run(args: argparse.Namespace) -> int:
    """Print the script for a shell."""
    out(script(args.shell))
    return 0


def script(shell: str) -> str:
    """Return the script that makes `shell`, one of SHELLS, request completions from irrsplat."""
    from argcomplete.shell_integration import shellcode

    return str(shellcode(["irrsplat"], shell=shell))


def answer(top: argparse.ArgumentParser) -> None:
    """Return completions of the grammar `top` to the shell and end the process; without a request, do nothing."""
    import argcomplete

    _complete(top)
    argcomplete.autocomplete(top, always_complete_options="long")


def _complete(top: argparse.ArgumentParser) -> None:
    """Set the completer of each argument of the grammar `top`."""
    from argcomplete.completers import FilesCompleter

    from irrsplat.image.frame import BUFFERS, ENDINGS
    from irrsplat.scene import FORMATS, bundled

    files: dict[str, Completer] = {
        "cache": FilesCompleter(),
        "compare": FilesCompleter(("json",)),
        "json": FilesCompleter(("json",)),
        "output": FilesCompleter([ending[1:] for ending in ENDINGS]),
        "path": FilesCompleter(("path",)),
        "file": FilesCompleter(),
        "files": FilesCompleter(),
        "stats": FilesCompleter(("json",)),
    }
    of_scenes = FilesCompleter([ending[1:] for ending in FORMATS])
    words: dict[str, Completer] = {
        "scene": lambda prefix, **_: (*bundled(), *of_scenes(prefix)),
        "buffers": lambda prefix, **_: _listed(prefix, BUFFERS),
        "camera": lambda parsed_args, **_: _cameras(parsed_args),
    }
    words |= files | {"scenes": words["scene"]}
    for action in _actions(top):
        name = action.dest.removeprefix("set_")
        if name != action.dest:
            words[action.dest] = _any_of(SETTINGS[name].words)
        if action.choices is None:
            action.completer = words.get(action.dest, _any_of(()))  # type: ignore[attr-defined]


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments of all commands."""
    for action in parser._actions:
        if isinstance(action.choices, dict):
            for command in action.choices.values():
                yield from _actions(command)
        else:
            yield action


def _any_of(words: tuple[str, ...]) -> Completer:
    return lambda **_: words


def _listed(prefix: str, names: Iterable[str]) -> list[str]:
    """Return continuations of a comma-separated list that starts with `prefix`."""
    before, comma, _ = prefix.rpartition(",")
    return [f"{before}{comma}{name}" for name in names if name not in before.split(",")]


def _cameras(args: argparse.Namespace) -> list[str]:
    """Return the camera names of the scene in `args`; none if it cannot be read."""
    from irrsplat.scene import load

    with suppress(Exception):  # scene errors are reported at loading, not at Tab
        return [camera.name for camera in load(args.scene or flags.DEFAULT_SCENE).cameras if camera.name]
    return []


COMMAND = Command(add, run)
