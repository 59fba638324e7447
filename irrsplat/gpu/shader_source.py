"""Shader text: reads GLSL files, expands each include once, and turns a compiler's message into file and line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from irrsplat.core import glsl
from irrsplat.core.errors import IrrsplatError
from irrsplat.core.paths import folder

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')
_UNIFORM = re.compile(r"^\s*uniform\s+(\w+)\s+(\w+)\s*(\[[^\]]*\])?\s*;", re.MULTILINE)
_OUTPUT = re.compile(r"^\s*(flat\s+)?out\s+(\w+)\s+(\w+)\s*(?:\[(\w+)\])?\s*;", re.MULTILINE)
_PLACE = re.compile(r"\b(\d+)[:(](\d+)\)?")  # Mesa: 2:17(5), NVIDIA: 2(17), Apple and Intel: 2:17


_Stamps = dict[Path, tuple[int, int] | None]


class ShaderError(IrrsplatError):
    """A shader that does not compile; the message starts with ``file:line:``."""


@dataclass(frozen=True)
class Source:
    """Expanded GLSL: `text` for the compiler, the place (file, line) of each of its lines, `uniforms` name → GLSL type."""

    name: str
    text: str
    places: tuple[tuple[str, int], ...]
    uniforms: dict[str, str]


_MOST_LOADED = 500  # some 15 MB
_loaded: dict[tuple[object, ...], tuple[Source, _Stamps]] = {}  # what `load` gave, and of which states of which files


def load(name: str, defines: Mapping[str, object] | None = None, root: Path | None = None) -> Source:
    """The shader file `name` (relative to `root`, default the bundled shaders) with includes and `defines` in place.

    `#include "lib/x.glsl"` is replaced by that file's text the first time and by nothing afterwards; what "generated/x.glsl" is
    replaced by is made from Python (core/glsl.py). An include in a block that the compiler skips is left out. Where each line
    came from is kept here, not in #line directives: Mesa forgets their file numbers. Files that have not changed since they were
    last expanded so are not read again. Raises ShaderError for a missing file.
    """
    root, defines = root or folder("shaders"), defines or {}
    asked = name, root, tuple((key, str(value)) for key, value in defines.items())
    if asked not in _loaded or _stamps(_loaded[asked][1]) != _loaded[asked][1]:
        if len(_loaded) >= _MOST_LOADED:
            _loaded.clear()
        _loaded[asked] = _expanded(name, defines, root)
    return _loaded[asked][0]


def _stamps(files: Iterable[Path]) -> _Stamps:
    """When each file was last written, in ns, and its size; None where there is none."""
    found: _Stamps = {}
    for file in files:
        try:
            about = file.stat()
            found[file] = about.st_mtime_ns, about.st_size
        except OSError:
            found[file] = None
    return found


def _expanded(name: str, defines: Mapping[str, object], root: Path) -> tuple[Source, _Stamps]:
    """The shader file `name` with all its includes, and which files that took."""
    stamps: _Stamps = {}
    seen: set[str] = set()
    text = ["#version 330 core", *(f"#define {key} {value}" for key, value in defines.items())]
    places = [(name, 0)] * len(text)
    conditions = _Conditions(defines)

    def expand(name: str, included: str) -> None:
        if name in seen:
            return
        seen.add(name)
        try:
            if name not in glsl.INCLUDES:
                stamps.update(_stamps([root / name]))  # before it is read: a change in between shows next time
            content = glsl.INCLUDES[name] if name in glsl.INCLUDES else (root / name).read_text(encoding="utf-8")
        except OSError as error:
            raise ShaderError(f"{included}cannot read '{name}': {error.strerror}") from error
        for number, line in enumerate(content.splitlines(), start=1):
            include = _INCLUDE.match(line) if "#" in line else None
            looked_at = conditions.follow(line)
            if include and looked_at:
                expand(include[1], f"{name}:{number}: ")
            elif not include:
                text.append(line)
                places.append((name, number))

    expand(name, "")
    whole = "\n".join(text) + "\n"
    return Source(name, whole, tuple(places), _uniforms(whole, defines)), stamps


class _Conditions:
    """Which lines of a shader a compiler with these `defines` looks at: all those of whose conditions that is not certain."""

    def __init__(self, defines: Mapping[str, object]) -> None:
        self._defines = defines
        self._blocks: list[bool | None] = []  # whether each block that is open is looked at; None: not known
        self._looked_at = True

    def follow(self, line: str) -> bool:
        """Take the next line; whether it is looked at."""
        if "#" in line:  # few have one, and every Renderer reads thousands of lines
            self._take(line)
        return self._looked_at

    def _take(self, line: str) -> None:
        word, _, condition = line.partition("//")[0].strip().partition(" ")
        if word.startswith("#if"):
            self._blocks.append(self._holds(condition) if word == "#if" else None)
        elif word == "#elif":
            self._blocks[-1] = None if self._blocks[-1] is None or not self._blocks[-1] else False
        elif word == "#else" and self._blocks[-1] is not None:
            self._blocks[-1] = not self._blocks[-1]
        elif word == "#endif":
            self._blocks.pop()
        self._looked_at = False not in self._blocks

    def _holds(self, condition: str) -> bool | None:
        """Whether names, each with ! or not, joined by && and ||, are defined as other than 0; None for other conditions."""
        terms = [[name.strip() for name in both.split("&&")] for both in condition.split("||")]
        if not all(name.removeprefix("!").isidentifier() for both in terms for name in both):
            return None
        return any(all(bool(self._defines.get(n.removeprefix("!"), 0)) != n.startswith("!") for n in both) for both in terms)


def _uniforms(text: str, defines: Mapping[str, object]) -> dict[str, str]:
    """The uniforms that `text` declares, name → type, in what a compiler looks at."""
    bare = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.DOTALL)
    conditions = _Conditions(defines)
    kept = [line for line in bare.splitlines() if conditions.follow(line)]
    return {name: kind for kind, name, _ in _UNIFORM.findall("\n".join(kept))}


def numbering_triangles(vertex: str, fragment: str, defines: Mapping[str, object]) -> tuple[str, str]:
    """A geometry shader that passes on triangles as they are, with their gl_PrimitiveID, and the `fragment` shader for behind it:
    for drivers that give fragment shaders no gl_PrimitiveID otherwise. defines: those that both were loaded with."""
    conditions, text, body = _Conditions(defines), fragment, ""
    outputs = _OUTPUT.findall("\n".join(line for line in vertex.splitlines() if conditions.follow(line)))
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
    """The compiler's `log` on one line, its first place turned into ``file:line``."""
    lines = [line.strip() for line in log.splitlines() if line.strip(" =-\t")]
    complaint = next((line for line in lines if _PLACE.search(line)), lines[-1] if lines else "unknown error")
    place = _PLACE.search(complaint)
    if place and 0 < int(place[2]) <= len(source.places):
        file, line = source.places[int(place[2]) - 1]
        message = re.sub(r"^[\s:()\d]*(error\s*(\w\d+)?:)?\s*", "", complaint[place.end() :], flags=re.IGNORECASE) or complaint
        return f"{file}:{line}: {message}"
    return f"{source.name}: {complaint}"
