"""The documentation site: it builds without a warning, loads nothing from the net, and has every flag, key and public name."""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import irrsplat
from irrsplat.app import grammar
from irrsplat.app.viewer.input.keys import FLYING, KEYS
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


def test_nothing_is_loaded_from_the_net(site: dict[str, str]) -> None:
    pages = {name: text for name, text in site.items() if name.endswith(".html")}
    assert len(pages) > 20
    for name, text in pages.items():
        assert not LOADED.findall(text), name
    for name, text in site.items():
        if name.endswith(".css"):
            assert not re.search(r"url\([\"']?(?:https?:)?//|@import\s+[\"'](?:https?:)?//", text), name


def test_formulas_are_drawn_by_the_browser(site: dict[str, str]) -> None:
    source = re.sub(r"```.*?```|`[^`\n]*`", "", (ROOT / "docs/METHOD.md").read_text(encoding="utf-8"), flags=re.S)
    formulas = len(re.findall(r"\$\$.+?\$\$|\$[^$]+?\$", source, re.S))
    page = site["METHOD.html"]
    assert page.count("<math ") == formulas > 500
    assert "arithmatex" not in page and "\\frac" not in page


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


def test_the_reference_of_python_has_every_public_name(site: dict[str, str]) -> None:
    page = site["reference/python.html"]
    for name in irrsplat.__all__:
        home = f"{getattr(irrsplat, name).__module__}.{name}"
        found = re.search(rf'<h2 id="{re.escape(home)}".*?(?=<h2 id=|</article>)', page, re.S)
        assert found, f"{name} is missing"
        assert "<p>" in found[0], f"{name} has no docstring there"


def test_the_search_knows_all_pages(site: dict[str, str]) -> None:
    found = {entry["location"].split("#")[0] for entry in json.loads(site["search/search_index.json"])["docs"]}
    assert {"", "METHOD.html", "tutorial/3-the-mending.html", "reference/commands.html"} - {""} <= found
    assert "hemicube" in site["search/search_index.js"]


def test_the_search_looks_for_flags(site: dict[str, str]) -> None:
    """A word that begins with "-" would be one to leave out: on all pages a script takes the dashes away."""
    script = site["assets/search-flags.js"]
    pattern = re.search(r"replace\(/(.+)/g, \"\$1\"\)", script)
    assert pattern
    for typed, asked in (("--cache-mode", "cache-mode"), ("render --size", "render size"), ("cache-", "cache"), ("a-b", "a-b")):
        assert re.sub(pattern[1], lambda m: m[1] or "", typed) == asked
    assert all("assets/search-flags.js" in text for name, text in site.items() if name.endswith(".html") and "md-search" in text)


def test_a_page_that_is_found_by_its_sections_highlights_their_words(site: dict[str, str]) -> None:
    """The theme's worker gives such a page no words; the script, before the theme's listener, gives it those of its sections."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("there is no node to run the site's scripts")
    worker = next(text for name, text in site.items() if re.search(r"workers/search\.\w+\.min\.js$", name))
    page = site["viewer.html"]
    assert page.index("assets/search-flags.js") < page.index("/bundle.")
    asked = json.dumps(["--hemicube", "record radius"])
    script = _SEARCH % (worker, site["search/search_index.json"], site["assets/search-flags.js"], asked)
    done = subprocess.run([node, "-"], input=script, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for words, found in json.loads(done.stdout).items():
        assert len(found) > 10
        for before, after in found:
            assert any(after.values()) and before.items() <= after.items()
            assert set(after) <= set(words.strip("-").split())
        assert any(not before for before, _ in found), "there are such pages"


_SEARCH = """
const listeners = [], answers = [];
globalThis.self = globalThis;
globalThis.importScripts = () => {};
globalThis.addEventListener = (kind, listener) => listeners.push(listener);
globalThis.postMessage = (data) => answers.forEach((answer) => answer({ data }));
globalThis.Worker = class {
  addEventListener(kind, listener) { answers.push(listener); }
  postMessage(data) { listeners.forEach((listener) => listener({ data })); }
};
globalThis.window = globalThis;
answers.push(({ data }) => { if (data.type === 3) before = data.data.items.flat().map((item) => ({ ...item.terms })); });
let before, after, told;
%s
const index = %s;
%s
const worker = new Worker(), found = {};
worker.addEventListener("message", ({ data }) => {
  if (data.type === 3) after = data.data.items.flat().map((item) => item.terms);
  told();
});
const send = (message) => new Promise((done) => { told = done; worker.postMessage(message); });
(async () => {
  await send({ type: 0, data: { ...index, options: { suggest: false } } });
  for (const words of %s) {
    await send({ type: 2, data: words });
    found[words] = before.map((terms, i) => [terms, after[i]]);
  }
  console.log(JSON.stringify(found));
})();
"""


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
