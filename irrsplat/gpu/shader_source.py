"""Shader text: read GLSL files, expand each include once, and translate compiler messages into file and line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from irrsplat.core import glsl
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.paths import folder

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
_UNIFORM = re.compile(r"^\s*uniform\s+(\w+)\s+(\w+)\s*(\[[^\]]*\])?\s*;", re.MULTILINE)
_OUTPUT = re.compile(r"^\s*(flat\s+)?out\s+(\w+)\s+(\w+)\s*(?:\[(\w+)\])?\s*;", re.MULTILINE)
_PLACE = re.compile(r"\b(\d+)[:(](\d+)\)?")  # Mesa: 2:17(5), NVIDIA: 2(17), Apple and Intel: 2:17


class ShaderError(IrrsplatError):
    """A shader that does not compile; the message starts with ``file:line:``."""


@dataclass(frozen=True)
class Source:
    """Expanded GLSL: `text` for the compiler, `places` (file, line) of its lines, `uniforms` name → GLSL type."""

    name: str
    text: str
    places: tuple[tuple[str, int], ...]
    uniforms: dict[str, str]


def load(name: str, defines: Mapping[str, object] | None = None) -> Source:
    """Return the shader file `name` (relative to the folder of shaders) with includes and `defines` expanded.

    `#include "lib/x.glsl"` is replaced by the file's text once, and by nothing afterwards; "generated/x.glsl" is written in
    Python (core/glsl.py). Includes in blocks that the compiler skips are left out. Places of lines are kept here, not in #line
    directives, because Mesa drops their file numbers. Files are read once. Raises ShaderError for a missing file.
    """
    values = tuple((key, value, str(value)) for key, value in (defines or {}).items())  # 1 and True differ as text
    return _expanded(name, values, folder("shaders"))


@lru_cache(500)  # some 15 MB
def _expanded(name: str, values: tuple[tuple[str, object, str], ...], root: Path) -> Source:
    """Return the shader file `name` with all includes."""
    defines = {key: value for key, value, _ in values}
    seen: set[str] = set()
    text = ["#version 330 core", *(f"#define {key} {value}" for key, value in defines.items())]
    places = [(name, 0)] * len(text)
    conditions = _Conditions(defines)

    def expand(name: str, included: str) -> None:
        if name in seen:
            return
        seen.add(name)
        try:
            content = glsl.INCLUDES[name] if name in glsl.INCLUDES else (root / name).read_text(encoding="utf-8")
        except OSError as error:
            raise ShaderError(f"{included}cannot read '{name}': {error.strerror}") from error
        for number, line in enumerate(content.splitlines(), start=1):
            if "#" in line:  # most lines have none, and each Renderer reads thousands of lines
                include, compiled = _INCLUDE.match(line), conditions.is_compiled(line)
                if include and compiled:
                    expand(include[1], f"{name}:{number}: ")
                if include:
                    continue
            text.append(line)
            places.append((name, number))

    expand(name, "")
    whole = "\n".join(text) + "\n"
    return Source(name, whole, tuple(places), _uniforms(whole, defines))


class _Conditions:
    """The lines of a shader that a compiler with these `defines` reads, including lines with undecidable conditions."""

    def __init__(self, defines: Mapping[str, object]) -> None:
        self._defines = defines
        self._blocks: list[bool | None] = []  # True if an open block is compiled; None: unknown
        self._compiled = True

    def is_compiled(self, line: str) -> bool:
        """Advance to the next line; True if it is compiled."""
        if "#" in line:
            self._read_directive(line)
        return self._compiled

    def _read_directive(self, line: str) -> None:
        word, _, condition = line.partition("//")[0].strip().partition(" ")
        if word.startswith("#if"):
            self._blocks.append(self._value_of(condition) if word == "#if" else None)
        elif word == "#elif":
            self._blocks[-1] = None if self._blocks[-1] is None or not self._blocks[-1] else False
        elif word == "#else" and self._blocks[-1] is not None:
            self._blocks[-1] = not self._blocks[-1]
        elif word == "#endif":
            self._blocks.pop()
        self._compiled = False not in self._blocks

    def _value_of(self, condition: str) -> bool | None:
        """True if the names, each with ! or not, joined by && and ||, are defined as non-zero; None for other conditions."""
        terms = [[name.strip() for name in both.split("&&")] for both in condition.split("||")]
        if not all(name.removeprefix("!").isidentifier() for both in terms for name in both):
            return None
        return any(all(bool(self._defines.get(n.removeprefix("!"), 0)) != n.startswith("!") for n in both) for both in terms)


def _uniforms(text: str, defines: Mapping[str, object]) -> dict[str, str]:
    """Return the uniforms that `text` declares in compiled lines, name → type."""
    bare = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)
    conditions = _Conditions(defines)
    kept = [line for line in bare.splitlines() if ("#" in line or "uniform" in line) and conditions.is_compiled(line)]
    return {name: kind for kind, name, _ in _UNIFORM.findall("\n".join(kept))}


def numbering_triangles(vertex: str, fragment: str, defines: Mapping[str, object]) -> tuple[str, str]:
    """Return a geometry shader that passes triangles on with their gl_PrimitiveID, and `fragment` adapted to it.

    For drivers whose fragment shaders have no gl_PrimitiveID otherwise. defines: those that both shaders were loaded with.
    """
    conditions, text, body = _Conditions(defines), fragment, ""
    outputs = _OUTPUT.findall("\n".join(line for line in vertex.splitlines() if conditions.is_compiled(line)))
    declared = "#version 330 core\nlayout(triangles) in;\nlayout(triangle_strip, max_vertices = 3) out;\n"
    for flat, kind, name, length in outputs:
        if name == "gl_ClipDistance":
            body += "".join(f"        {name}[{k}] = gl_in[i].{name}[{k}];\n" for k in range(int(length)))
            continue
        declared += f"{flat}in {kind} {name}[];\n{flat}out {kind} passed_{name};\n"
        body += f"        passed_{name} = {name}[i];\n"
        text = re.sub(rf"\b{name}\b", f"passed_{name}", text)
    body += "        gl_Position = gl_in[i].gl_Position;\n        gl_PrimitiveID = gl_PrimitiveIDIn;\n        EmitVertex();\n"
    return f"{declared}void main()\n{{\n    for (int i = 0; i < 3; ++i)\n    {{\n{body}    }}\n    EndPrimitive();\n}}\n", text


def explain(log: str, source: Source) -> str:
    """Return the compiler's `log` on one line, with its first place as ``file:line``."""
    lines = [line.strip() for line in log.splitlines() if line.strip(" =-\t")]
    complaint = next((line for line in lines if _PLACE.search(line)), lines[-1] if lines else "unknown error")
    place = _PLACE.search(complaint)
    if place and 0 < int(place[2]) <= len(source.places):
        file, line = source.places[int(place[2]) - 1]
        message = re.sub(r"^[\s:()\d]*(error\s*(\w\d+)?:)?\s*", "", complaint[place.end() :], flags=re.IGNORECASE) or complaint
        return f"{file}:{line}: {message}"
    return f"{source.name}: {complaint}"
