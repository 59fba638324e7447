"""Output files of a command: no duplicates, and independent of each other's failures."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence

from irrsplat.app.common.terminal import doing, wrote
from irrsplat.core.errors import InputError, IrrsplatError


def missing(error: ModuleNotFoundError) -> str:
    """Return the message for a missing Python module."""
    return f"this needs the Python module '{error.name}', which is missing; irrsplat doctor lists what is there"


def twins(outputs: Sequence[str], others: Iterable[tuple[str, str | None]]) -> list[str]:
    """Return an error for each file that two outputs share. outputs: of -o; others: flags and their files, None for absent
    ones.
    """
    flags_of: dict[str, list[tuple[str, str]]] = {}
    given = [("-o", output) for output in outputs] + [(flag, path) for flag, path in others if path is not None]
    for flag, path in given:
        flags_of.setdefault(os.path.realpath(path), []).append((flag, path))
    uses = [" and ".join(f"{flag} {path}" for flag, path in same) for same in flags_of.values() if len(same) > 1]
    return [f"{use} are one file; give each a name of its own" for use in uses]


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

    def raise_failures(self) -> None:
        """Raise an error with every failed file, if any."""
        errors = list(self.failures.values())
        if len(errors) == 1:
            raise errors[0]
        if errors:
            raise (InputError if all(isinstance(e, InputError) for e in errors) else IrrsplatError)("; ".join(map(str, errors)))
