"""The words of code and documents: how docstrings open, a few banned words, and the length of sentences."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = "irrsplat", "app", "shaders", "tests", "docs"
PAGES = "README.md", "CONTRIBUTING.md", "CHANGELOG.md"
OPENING = re.compile(r"(What|Whether|How|Those)\b")
BANNED = re.compile(r"\b(beside(?!:)|held against|mend(s|ed|ing)?|nothing but|speaks? for|contradict\w*)\b", re.I)
LONGEST = 32  # words of a sentence
KINDS = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def comments(text: str, mark: str = "//") -> Iterator[tuple[int, str, bool]]:
    """Yield line and text of each run of comments; False, since it is no docstring."""
    for match in re.finditer(rf"(?:^[ \t]*{mark}.*\n)+|(?<=\s){mark} .*", text, re.M):
        yield text[: match.start()].count("\n") + 1, re.sub(rf"^\s*{mark}", "", match[0], flags=re.M), False


def python(text: str) -> Iterator[tuple[int, str, bool]]:
    """Yield line and text of docstrings and of comments, and True for a docstring."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, KINDS) and (doc := ast.get_docstring(node, clean=False)):
            yield getattr(node, "lineno", 1), doc, True
    yield from comments(text, "#")


def markdown(text: str) -> Iterator[tuple[int, str, bool]]:
    """Yield line and text of each paragraph and item outside of code, tables and formulas."""
    text = re.sub(r"^```.*?^```|\$\$.*?\$\$|<!--.*?-->|^[|#<].*?$", lambda m: "\n" * m[0].count("\n"), text, flags=re.M | re.S)
    text = re.sub(r"\]\([^)\s]*\)", "]", text)  # the targets of links
    for match in re.finditer(r"\S(?:.|\n(?!\s*\n|\s*(?:[-*]|\d+\.) ))*", text):
        yield text[: match.start()].count("\n") + 1, match[0], False


READERS = {".py": python, ".md": markdown, **dict.fromkeys((".glsl", ".frag", ".vert"), comments)}


def faults(path: Path) -> list[str]:
    """Return what is wrong with the words of a file, by lines."""
    name, found = path.relative_to(ROOT).as_posix(), []
    for line, text, docstring in READERS[path.suffix](path.read_text(encoding="utf-8")):
        if docstring and (opening := OPENING.match(text)):
            found.append(f"{name}:{line}: a docstring opens with {opening[0]}")
        found += [f"{name}:{line}: {word[0]}" for word in BANNED.finditer(text)]
        sentences = re.split(r"(?<=[.!?:;])\s+|\n\s*\n|\n {2,}", text)
        found += [f"{name}:{line}: a long sentence: {s[:60]}" for s in sentences if len(s.split()) > LONGEST]
    return found


@pytest.mark.parametrize("folder", (*FOLDERS, *PAGES))
def test_words_are_plain(folder: str) -> None:
    """The rules are in CONTRIBUTING.md, "Words and style"; this module is left out, since it names the banned words."""
    files = [path for path in ((ROOT / folder).rglob("*") if folder in FOLDERS else [ROOT / folder]) if path.suffix in READERS]
    checked = [path for path in files if path != Path(__file__)]
    assert checked
    found = [fault for path in sorted(checked) for fault in faults(path)]
    assert not found, "\n".join(found)
