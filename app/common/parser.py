"""argparse variant that reports all errors of a command line in one line, with suggestions."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from gettext import gettext
from typing import Any, NoReturn

from irrsplat.core.errors import InputError, did_you_mean, nearest
from irrsplat.settings import removed


class Mistakes:
    """Errors of a command line, collected before they are reported.

    page: the relevant help, such as ``irrsplat render --help``, or "". arguments: names of invalid arguments, for which
    further checks are skipped.
    """

    def __init__(self) -> None:
        self.found: list[str] = []
        self.page = ""
        self.arguments: set[str] = set()

    def add(self, message: str, page: str = "") -> None:
        """Add an error, once, and its help page."""
        if message not in self.found:
            self.found.append(message)
        self.page = self.page or page

    @contextmanager
    def gathered(self) -> Iterator[None]:
        """Collect the InputError of the block."""
        try:
            yield
        except InputError as error:
            self.add(str(error))

    def raise_all(self) -> None:
        """Raise InputError, one line with all errors; do nothing without errors."""
        if not self.found:
            return
        several = len(self.found) > 1
        numbered = "; ".join(f"({i}) {message}" for i, message in enumerate(self.found, 1))
        text = f"{len(self.found)} mistakes: {numbered}" if several else self.found[0]
        raise InputError(f"{text}; see {self.page}" if self.page else text)


class Parser(argparse.ArgumentParser):
    """argparse without abbreviations and with all spellings of negative numbers.

    Errors go to `mistakes`, with a placeholder value, so that all arguments are checked. InputError is raised at once only
    if parsing cannot continue.
    """

    def __init__(self, mistakes: Mistakes | None = None, **options: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=argparse.RawDescriptionHelpFormatter, **options)
        self.mistakes = mistakes or Mistakes()
        self._incomplete: list[argparse.Action] = []  # arguments with too few values
        # argparse's own pattern takes -1e-3 and -inf for flags
        self._negative_number_matcher = re.compile(r"-\.?\d|-(inf|nan)", re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        """Raise InputError with all errors so far and this one; main() prints it."""
        begin = gettext("the following arguments are required: %s").partition("%s")[0]
        if message.startswith(begin):
            names = message.removeprefix(begin).split(", ")
            message = "; ".join(self._missing(action) for action in self._actions if argparse._get_action_name(action) in names)
        self._wrong(message)
        self.mistakes.raise_all()
        raise AssertionError("there is a mistake to tell")

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """Parse as argparse does, but report and skip unknown flags, and replace missing ones by placeholders."""
        return super().parse_known_args(self._without_unknown_flags(list(args or ())), namespace)

    def _missing(self, action: argparse.Action) -> str:
        """Return the message for a missing `action`, with its choices."""
        if action.choices is None:
            return f"{argparse._get_action_name(action)} is missing"
        if action.nargs == argparse.PARSER:
            return f"a command is missing; the commands are {', '.join(action.choices)}"
        return f"{self._words(action)}, and none is given"

    def _words(self, action: argparse.Action) -> str:
        """Return the accepted words of `action`."""
        words = f"takes {'|'.join(str(name) for name in action.choices or ())}"
        return words if action.option_strings else f"{self.prog.split()[-1]} {words}"

    def _wrong(self, message: str) -> None:
        self.mistakes.add(message, f"{self.prog} --help")

    def _without_unknown_flags(self, words: list[str]) -> list[str]:
        """Return `words` without unknown flags and their values; add placeholders for missing required flags.

        Each unknown flag is reported.
        """
        kept: list[str] = []
        given: set[str] = set()
        probably: set[str] = set()  # suggestions for unknown flags
        position = 0
        commands = any(action.nargs == argparse.PARSER for action in self._actions)
        while position < len(words):
            word = words[position]
            position += 1
            if word == "--" or (commands and not word.startswith("-")):
                kept += words[position - 1 :]
                break
            if not self._like_a_flag(word) or (known := self._known_flag(word)):
                kept.append(word)
                if self._like_a_flag(word):
                    given.add(known)
                continue
            name, _, value = word.partition("=")
            meant = nearest(name, [flag for flag in self._option_string_actions if self._advertised(flag)])
            self._wrong(removed(name) or f"unknown flag {name}" + (f" (did you mean {meant}?)" if meant else ""))
            if meant:
                probably.add(meant)
                self.mistakes.arguments.add(self._option_string_actions[meant].dest)
            count = 0 if value else len(words) if not meant else self._values_of(meant, words[position : position + 1])
            while count > 0 and position < len(words) and not self._like_a_flag(words[position]):
                position, count = position + 1, count - 1
        for action in self._actions:
            flags = action.option_strings
            if action.required and flags and not given.intersection(flags):
                kept = [flags[0], "", *kept]
                self.mistakes.arguments.add(action.dest)
                if not probably.intersection(flags):
                    self._wrong(f"{'/'.join(flags)} is missing")
        return kept

    def _like_a_flag(self, word: str) -> bool:
        """True if argparse takes `word` for a flag rather than for a value."""
        return len(word) > 1 and word[0] == "-" and " " not in word and not self._negative_number_matcher.match(word)

    def _known_flag(self, word: str) -> str:
        """Return the flag in `word`, with or without an attached value; "" if unknown."""
        for flag in (word, word.partition("=")[0], word[:2] if word[1] != "-" else word):
            if flag in self._option_string_actions:
                return flag
        return ""

    def _advertised(self, flag: str) -> bool:
        return self._option_string_actions[flag].help != argparse.SUPPRESS

    def _values_of(self, flag: str, following: list[str]) -> int:
        """Return the number of words after `flag` that are its values; `following` is the next word."""
        action = self._option_string_actions[flag]
        if action.metavar == "on|off":
            return int(any(word.lower() in ("on", "off") for word in following))
        return action.nargs if isinstance(action.nargs, int) else 1

    # ---- overrides of argparse methods that raise at the first error -------------------------------------------------

    def _match_argument(self, action: argparse.Action, arg_strings_pattern: str) -> int:
        try:
            return int(super()._match_argument(action, arg_strings_pattern))
        except argparse.ArgumentError as error:
            self._wrong(str(error))
            self._incomplete.append(action)
            self.mistakes.arguments.add(action.dest)
            return len(arg_strings_pattern) - len(arg_strings_pattern.lstrip("A"))

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        if action.nargs == argparse.PARSER:
            return super()._get_values(action, arg_strings)
        if action in self._incomplete:
            return None
        try:
            return super()._get_values(action, arg_strings)
        except argparse.ArgumentError as error:
            self._wrong(str(error))
            self.mistakes.arguments.add(action.dest)
            return None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        names = [str(name) for name in action.choices]
        if action.nargs == argparse.PARSER:
            words = f"there is no command '{value}'{did_you_mean(str(value), names)}; the commands are {', '.join(names)}"
            raise argparse.ArgumentError(None, words)
        text = f"{self._words(action)}, not '{value}'{did_you_mean(str(value), names)}"
        raise argparse.ArgumentError(action if action.option_strings else None, text)
