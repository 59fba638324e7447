"""Output files of a command: no duplicates, and independent of each other's failures."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable

from irrsplat.app.common.terminal import doing, wrote
from irrsplat.core.errors import InputError, IrrsplatError


def missing(error: ModuleNotFoundError) -> str:
    """Return the message for a missing Python module."""
    return f"this needs the Python module '{error.name}', which is missing; irrsplat doctor lists what is there"


def check_distinct(outputs: Iterable[str], others: Iterable[tuple[str, str | None]]) -> None:
    """Raise InputError for a file of several outputs. outputs: of -o; others: flags and their files, None for absent ones."""
    uses: dict[str, list[str]] = {}
    for flag, path in (*(("-o", output) for output in outputs), *others):
        if path is not None:
            uses.setdefault(os.path.realpath(path), []).append(f"{flag} {path}")
    for same in uses.values():
        if len(same) > 1:
            raise InputError(f"{' and '.join(same)} are one file; give each a name of its own")


class Outputs:
    """Writer of independent files that collects failures; `raise_failures` raises them at the end."""

    def __init__(self) -> None:
        self.failures: dict[str, IrrsplatError] = {}

    def write(self, path: str, write: Callable[[], object], name: str = "", tells: bool = True) -> bool:
        """Call `write` to make the file `path`; return True for success. A failed output is not tried again.

        name: of an output other than the file: the pattern of a path's frames. tells: print a message for the written file.
        """
        if (name or path) in self.failures:
            return False
        if tells:
            doing(f"writing {path}")
        try:
            write()
        except IrrsplatError as error:
            self.failures[name or path] = error
        except ModuleNotFoundError as error:
            self.failures[name or path] = IrrsplatError(f"{path}: {missing(error)}")
        except MemoryError:
            self.failures[name or path] = IrrsplatError(f"{path}: cannot write: there is not enough memory")
        else:
            if tells:
                wrote(path)
            return True
        return False

    def write_json(self, path: str | None, value: object, indent: int = 2) -> None:
        """Write `value` as JSON to the file `path`; None: nowhere."""
        from irrsplat.core import files  # needs numpy, which --help does not import

        if path is not None:
            self.write(path, lambda: files.write_text(path, files.json_text(value, indent) + "\n"))

    def raise_failures(self) -> None:
        """Raise an error with every failed file, if any."""
        errors = list(self.failures.values())
        if len(errors) == 1:
            raise errors[0]
        if errors:
            raise (InputError if all(isinstance(e, InputError) for e in errors) else IrrsplatError)("; ".join(map(str, errors)))
