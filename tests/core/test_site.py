"""The documentation site: it builds without a warning, loads nothing from the net, and has every flag, key and public name."""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import irrsplat
from irrsplat.app import grammar
from irrsplat.app.viewer.input.commands import FLYING, KEYS
from irrsplat.settings import SETTINGS

ROOT = Path(__file__).resolve().parents[2]
LOADED = re.compile(r"<(?:script|link|img|iframe|source|video)\b[^>]*?\b(?:src|href|srcset)=[\"']?((?:https?:)?//[^\"'\s>]+)")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Its files of text by name, built as `make docs` builds them: strict, so that a link or anchor that leads nowhere fails."""
    folder = tmp_path_factory.mktemp("site")
    command = (sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder))
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    kinds = (".html", ".css", ".js", ".json")
    return {str(f.relative_to(folder)): f.read_text(encoding="utf-8") for f in folder.rglob("*") if f.suffix in kinds}


@pytest.mark.long
def test_nothing_is_loaded_from_the_net(site: dict[str, str]) -> None:
    pages = {name: text for name, text in site.items() if name.endswith(".html")}
    assert len(pages) > 20
    for name, text in pages.items():
        assert not LOADED.findall(text), name
    for name, text in site.items():
        if name.endswith(".css"):
            assert not re.search(r"url\([\"']?(?:https?:)?//|@import\s+[\"'](?:https?:)?//", text), name


@pytest.mark.long
def test_the_commands_have_every_flag(site: dict[str, str]) -> None:
    page = site["reference/commands.html"]
    commands = [("", grammar.build())]
    for name, parser in commands:  # grows by the tools of each
        assert f"irrsplat {name}".strip() in page
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                commands += [(f"{name} {word}".strip(), tool) for word, tool in action.choices.items()]
            for flag in action.option_strings if name and action.help != argparse.SUPPRESS else ():
                assert re.search(rf"<code>{flag}\b", page), f"irrsplat {name} {flag}"
    settings = site["reference.html"]
    for declaration in SETTINGS.values():
        assert declaration.flag in settings


@pytest.mark.long
def test_the_reference_of_python_has_every_public_name(site: dict[str, str]) -> None:
    page = site["reference/python.html"]
    for name in irrsplat.__all__:
        home = f"{getattr(irrsplat, name).__module__}.{name}"
        found = re.search(rf'<h2 id="{re.escape(home)}".*?(?=<h2 id=|</article>)', page, re.S)
        assert found, f"{name} is missing"
        assert "<p>" in found[0], f"{name} has no docstring there"


def test_the_exercises_name_keys_that_there_are() -> None:
    there = {key.shown for key in KEYS} | {"`"} | set(" ".join(held for held, _ in FLYING).replace(",", "").split())
    exercises = [page.read_text(encoding="utf-8") for page in sorted((ROOT / "docs/tutorial").glob("*.md"))]
    named = [key for text in exercises for key in re.findall(r"`((?:Ctrl\+|Shift\+)*(?:F\d\d?|Tab|Home|End|[A-Z0-9=\-]))`", text)]
    assert len(named) > 30
    assert {key.removeprefix("Shift+") if key not in there else key for key in named} <= there


def test_every_exercise_has_an_answer() -> None:
    for page in sorted((ROOT / "docs/tutorial").glob("[0-9]*.md")):
        _, exercises = page.read_text(encoding="utf-8").split("## Exercises")
        asked = re.findall(r"^\*\*\d+\.\*\* ", exercises, re.M)
        assert len(asked) >= 3
        assert len(re.findall(r"<summary>Answer</summary>\n\n\S.+?\n\n</details>", exercises, re.S)) == len(asked)
