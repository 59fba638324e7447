"""argparse variant that reports the first error of a command line in one line, with suggestions."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from gettext import gettext
from typing import Any, NoReturn

from irrsplat.core.errors import InputError, did_you_mean, nearest
from irrsplat.settings import removed


class Parser(argparse.ArgumentParser):
    """argparse without abbreviations and with all spellings of negative numbers; errors are InputError with the help page."""

    def __init__(self, **options: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=argparse.RawDescriptionHelpFormatter, **options)
        # argparse's own pattern takes -1e-3 and -inf for flags
        self._negative_number_matcher = re.compile(r"-\.?\d|-(inf|nan)", re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        """Raise InputError with this message, or with the missing arguments and their choices; main() prints it."""
        begin = gettext("the following arguments are required: %s").partition("%s")[0]
        if message.startswith(begin):
            names = message.removeprefix(begin).split(", ")
            message = "; ".join(self._missing(action) for action in self._actions if argparse._get_action_name(action) in names)
        raise InputError(f"{message}; see {self.prog} --help")

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Parse as argparse does, but refuse unknown flags first."""
        commands = any(action.nargs == argparse.PARSER for action in self._actions)
        for word in args or ():
            if word == "--" or (commands and not word.startswith("-")):
                break
            if self._like_a_flag(word) and not self._is_known(word):
                name = word.partition("=")[0]
                shown = [flag for flag, action in self._option_string_actions.items() if action.help != argparse.SUPPRESS]
                meant = nearest(name, shown)
                self.error(removed(name) or f"unknown flag {name}" + (f" (did you mean {meant}?)" if meant else ""))
        return super().parse_known_args(args, namespace)

    def _missing(self, action: argparse.Action) -> str:
        """Return the message for a missing `action`, with its choices."""
        if action.choices is None:
            return f"{argparse._get_action_name(action)} is missing"
        if action.nargs == argparse.PARSER:
            return f"a command is missing; the commands are {', '.join(action.choices)}"
        return f"{self._words(action)}, and none is given"

    def _words(self, action: argparse.Action) -> str:
        words = f"takes {'|'.join(str(name) for name in action.choices or ())}"
        return words if action.option_strings else f"{self.prog.split()[-1]} {words}"

    def _like_a_flag(self, word: str) -> bool:
        """True if argparse takes `word` for a flag rather than for a value."""
        return len(word) > 1 and word[0] == "-" and " " not in word and not self._negative_number_matcher.match(word)

    def _is_known(self, word: str) -> bool:
        """True if a flag, with or without an attached value, is known."""
        spellings = (word, word.partition("=")[0], word[:2] if word[1] != "-" else word)
        return any(flag in self._option_string_actions for flag in spellings)

    def _match_argument(self, action: argparse.Action, pattern: str) -> int:
        try:
            return super()._match_argument(action, pattern)
        except argparse.ArgumentError as error:
            if isinstance(action.nargs, int) and isinstance(action.metavar, tuple):
                raise argparse.ArgumentError(action, f"{error.message}, {' '.join(action.metavar)}") from None
            raise

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        names = [str(name) for name in action.choices]
        if action.nargs == argparse.PARSER:
            words = f"there is no command '{value}'{did_you_mean(str(value), names)}; the commands are {', '.join(names)}"
            raise argparse.ArgumentError(None, words)
        text = f"{self._words(action)}, not '{value}'{did_you_mean(str(value), names)}"
        raise argparse.ArgumentError(action if action.option_strings else None, text)
