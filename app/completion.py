"""What a shell offers at Tab: commands, flags, words of settings, bundled scenes, presets, cameras, buffers and files."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress

from irrsplat.app import flags
from irrsplat.settings import SETTINGS

Completer = Callable[..., Iterable[str]]  # called with `prefix`, what is typed of a word, and `parsed_args`


def script(shell: str) -> str:
    """The script that makes `shell`, one of flags.SHELLS, ask irrsplat at Tab."""
    from argcomplete.shell_integration import shellcode

    return str(shellcode(["irrsplat"], shell=shell))


def answer() -> None:
    """Tell the shell that asks what the word at its cursor may be, and end the process; without a shell that asks, do nothing."""
    import argcomplete

    argcomplete.autocomplete(grammar(), always_complete_options="long")


def grammar() -> argparse.ArgumentParser:
    """The grammar of the command line, each argument with what it may be."""
    from argcomplete.completers import FilesCompleter

    from irrsplat.image.frame import BUFFERS, ENDINGS
    from irrsplat.scene import FORMATS, bundled

    top = flags.build()
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
    return top


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """The arguments of all commands."""
    for action in parser._actions:
        if isinstance(action.choices, dict):
            for command in action.choices.values():
                yield from _actions(command)
        else:
            yield action


def _any_of(words: tuple[str, ...]) -> Completer:
    return lambda **_: words


def _listed(prefix: str, names: Iterable[str]) -> list[str]:
    """What a list with commas that begins as `prefix` may go on with."""
    before, comma, _ = prefix.rpartition(",")
    return [f"{before}{comma}{name}" for name in names if name not in before.split(",")]


def _cameras(args: argparse.Namespace) -> list[str]:
    """The names of the cameras of the scene that `args` has; none where that cannot be read."""
    from irrsplat.scene import load

    with suppress(Exception):  # a scene that is wrong is told when it is opened, not at Tab
        return [camera.name for camera in load(args.scene or flags.DEFAULT_SCENE).cameras if camera.name]
    return []
