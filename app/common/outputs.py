"""The files that a command writes: none twice, and where one cannot be written, the others are all the same."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence

from irrsplat.app.common.terminal import doing, wrote
from irrsplat.core.errors import InputError, IrrsplatError


def missing(error: ModuleNotFoundError) -> str:
    """What is said where a Python module is not there."""
    return f"this needs the Python module '{error.name}', which is missing; irrsplat doctor lists what is there"


def twins(outputs: Sequence[str], others: Iterable[tuple[str, str | None]]) -> list[str]:
    """What is wrong where two of the files that are to be written are one, a line for each such file. outputs: of -o; others:
    flags and their files, None where a flag is not given."""
    flags_of: dict[str, list[tuple[str, str]]] = {}
    given = [("-o", output) for output in outputs] + [(flag, path) for flag, path in others if path is not None]
    for flag, path in given:
        flags_of.setdefault(os.path.realpath(path), []).append((flag, path))
    uses = [" and ".join(f"{flag} {path}" for flag, path in same) for same in flags_of.values() if len(same) > 1]
    return [f"{use} are one file; give each a name of its own" for use in uses]


class Outputs:
    """Writes files one after the other and keeps what went wrong, so that each stands alone; `tell` says it in the end."""

    def __init__(self) -> None:
        self.failures: dict[str, IrrsplatError] = {}

    def write(self, path: str, write: Callable[[], object], name: str = "", tells: bool = True) -> bool:
        """Let `write` make the file `path`; whether it did. An output that failed once is not tried again. name: of the output,
        where that is not the file: the pattern of a path's frames. tells: whether it is said once the file is there."""
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

    def tell(self) -> None:
        """Raises an error that names every file that could not be written; nothing where there is none."""
        errors = list(self.failures.values())
        if len(errors) == 1:
            raise errors[0]
        if errors:
            raise (InputError if all(isinstance(e, InputError) for e in errors) else IrrsplatError)("; ".join(map(str, errors)))
