"""Shader text: reads GLSL files, expands each include once, and turns a compiler's message into file and line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from irrsplat.core import glsl
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.paths import folder

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
_UNIFORM = re.compile(r"^\s*uniform\s+(\w+)\s+(\w+)\s*(\[[^\]]*\])?\s*;", re.MULTILINE)
_PLACE = re.compile(r"\b(\d+)[:(](\d+)\)?")  # Mesa: 2:17(5), NVIDIA: 2(17), Apple and Intel: 2:17


class ShaderError(IrrsplatError):
    """A shader that does not compile; the message starts with ``file:line:``."""


@dataclass(frozen=True)
class Source:
    """Expanded GLSL: `text` for the compiler, the place (file, line) of each of its lines, `uniforms` name → GLSL type."""

    name: str
    text: str
    places: tuple[tuple[str, int], ...]
    uniforms: dict[str, str]


def load(name: str, defines: Mapping[str, object] | None = None, root: Path | None = None) -> Source:
    """The shader file `name` (relative to `root`, default the bundled shaders) with includes and `defines` in place.

    `#include "lib/x.glsl"` is replaced by that file's text the first time and by nothing afterwards; what "generated/x.glsl" is
    replaced by is made from Python (core/glsl.py). Where each line came from is kept here, not in #line directives: Mesa forgets
    their file numbers. Raises ShaderError for a missing file.
    """
    root = root or folder("shaders")
    seen: set[str] = set()
    text = ["#version 330 core", *(f"#define {key} {value}" for key, value in (defines or {}).items())]
    places = [(name, 0)] * len(text)

    def expand(name: str, included: str) -> None:
        if name in seen:
            return
        seen.add(name)
        try:
            content = glsl.INCLUDES[name] if name in glsl.INCLUDES else (root / name).read_text(encoding="utf-8")
        except OSError as error:
            raise ShaderError(f"{included}cannot read '{name}': {error.strerror}") from error
        for number, line in enumerate(content.splitlines(), start=1):
            include = _INCLUDE.match(line)
            if include:
                expand(include[1], f"{name}:{number}: ")
            else:
                text.append(line)
                places.append((name, number))

    expand(name, "")
    whole = "\n".join(text) + "\n"
    return Source(name, whole, tuple(places), _uniforms(whole, defines or {}))


def _uniforms(text: str, defines: Mapping[str, object]) -> dict[str, str]:
    """The uniforms that `text` declares, name → type; a block `#if NAME` whose define is 0 declares none."""
    bare = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)
    kept, live = [], [True]
    for line in bare.splitlines():
        word, _, condition = line.strip().partition(" ")
        if word.startswith("#if"):
            live.append(live[-1] and (word != "#if" or bool(defines.get(condition.strip(), True))))
        elif word == "#else":
            live[-1] = live[-2] and not live[-1]
        elif word == "#endif":
            live.pop()
        elif live[-1]:
            kept.append(line)
    return {name: kind for kind, name, _ in _UNIFORM.findall("\n".join(kept))}


def explain(log: str, source: Source) -> str:
    """The compiler's `log` on one line, its first place turned into ``file:line``."""
    lines = [line.strip() for line in log.splitlines() if line.strip(" =-\t")]
    complaint = next((line for line in lines if _PLACE.search(line)), lines[-1] if lines else "unknown error")
    place = _PLACE.search(complaint)
    if place and 0 < int(place[2]) <= len(source.places):
        file, line = source.places[int(place[2]) - 1]
        message = re.sub(r"^[\s:()\d]*(error\s*(\w\d+)?:)?\s*", "", complaint[place.end() :], flags=re.IGNORECASE) or complaint
        return f"{file}:{line}: {message}"
    return f"{source.name}: {complaint}"
