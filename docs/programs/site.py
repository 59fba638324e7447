"""Additions to mkdocs.yml for mkdocs: README and changelog as pages, generated reference, formulas as MathML.

`make docs` builds the site into build/site. Nothing here is written into docs/: generated pages live in memory only.
"""

from __future__ import annotations

import argparse
import html
import posixpath
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import irrsplat
from irrsplat.app import grammar
from irrsplat.core import paths
from irrsplat.core.buffers import CHANNELS
from irrsplat.core.record_layout import COLUMNS
from irrsplat.image.frame import ENDINGS, RECORDS
from irrsplat.scene import FORMATS

ROOT = Path(__file__).resolve().parents[2]
OUTSIDE = {"README.md": "index.md", "CONTRIBUTING.md": "about/contributing.md", "CHANGELOG.md": "about/changelog.md"}
ASSETS = Path(__file__).with_name("site_assets")  # style and script of the site
_LINK = re.compile(r"(\]\()([^)\s#]+)((?:#[^)\s]*)?\))")
_CODE = re.compile(r"(^```.*?^```|`[^`\n]*`)", re.M | re.S)
_ITEM = re.compile(r"(?:[-*+]|\d+\.) ")
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.S)
_SIZED = re.compile(
    r"\\[bB]igg?[lr]?(?=\s*\\[lr]angle)"
)  # latex2mathml knows no sized angle brackets; MathML stretches them itself


# ---- mkdocs calls these ------------------------------------------------------------------------------------------------------


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """All pages: those of docs/, those outside of it, and the generated ones."""
    made = {page: (ROOT / name).read_text(encoding="utf-8") for name, page in OUTSIDE.items()}
    made |= {"reference/commands.md": commands(), "reference/formats.md": formats(), "reference/python.md": python()}
    made |= {f"assets/{file.name}": file.read_text(encoding="utf-8") for file in sorted(ASSETS.iterdir())}
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """A page's text, its links leading to where the site has what they name."""
    here = page.file.src_uri
    source = next((name for name, target in OUTSIDE.items() if target == here), f"docs/{here}")
    parts = _CODE.split(markdown)
    parts[::2] = [_LINK.sub(lambda m: m[1] + relinked(m[2], source, here) + m[3], part) for part in parts[::2]]
    return indented("".join(parts))


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """A page's HTML, its formulas as MathML, which browsers draw by themselves."""
    return _FORMULA.sub(lambda m: mathml(html.unescape(m[2]), m[1] == "div"), content)


# ---- links and formulas ------------------------------------------------------------------------------------------------------


def relinked(link: str, source: str, here: str) -> str:
    """The link of a page for the site: `link` as the file `source` of the repository has it, for the page `here` of the site."""
    if re.match(r"[a-z]+:|/", link):
        return link
    target = posixpath.normpath(posixpath.join(posixpath.dirname(source), link))
    named = OUTSIDE.get(target, target.removeprefix("docs/"))
    if target not in OUTSIDE and not target.startswith("docs/"):
        if (ROOT / target).exists():  # a file of the code: the site has none of those
            return posixpath.relpath("about/contributing.md", posixpath.dirname(here) or ".")
        return link
    return posixpath.relpath(named, posixpath.dirname(here) or ".")


def indented(text: str) -> str:
    """Markdown whose list items go on at four blanks, as Python-Markdown wants it; GitHub does with two or three."""
    lines: list[str] = []
    in_list = in_code = parted = False  # parted: the item has more than one paragraph
    for line in text.splitlines():
        in_code ^= line.startswith("```")
        item = bool(_ITEM.match(line))
        if line and not line.startswith(" "):
            in_list = item or (in_list and bool(lines[-1]))  # a paragraph goes on without blanks
        if item and parted and lines[-1]:
            lines.append("")  # or it would be a line of the paragraph above
        parted = in_list and not item and (parted or not line)
        blanks = len(line) - len(line.lstrip(" "))
        lines.append(" " * (4 - blanks) + line if in_list and not in_code and blanks in (2, 3) else line)
    return "\n".join(lines) + "\n"


def mathml(formula: str, block: bool) -> str:
    """A LaTeX formula as MathML; raises PluginError where it holds a command that is not known."""
    try:
        made = convert(_SIZED.sub("", formula.strip()), display="block" if block else "inline")
    except Exception as error:  # latex2mathml raises many kinds, none of them its own base class
        raise PluginError(f"no formula: {formula}: {error}") from error
    if "\\" in made:
        raise PluginError(f"a command that latex2mathml does not know, in {formula}")
    return f'<div class="formula">{made}</div>' if block else str(made)


# ---- generated pages ---------------------------------------------------------------------------------------------------------


def commands() -> str:
    """All commands with all of their flags, from the grammar that the program itself parses by."""
    top = grammar.build()
    lines = [
        "# All commands and flags",
        "",
        "This page lists all commands and their flags. [The command line](../command-line.md) explains their use.",
    ]
    for name, parser in with_tools(top):
        usage = " ".join(parser.format_usage().split()).removeprefix("usage: ")
        short = re.sub(r"(?: \[--[\w-]+ [^\]]*\]){8,}", " [flags]", usage)  # a line of settings says nothing
        lines += ["", f"## irrsplat {name}", "", parser.description or "", "", "```text", short, "```"]
        for group in parser._action_groups:
            rows = [row for action in group._group_actions if (row := flag_row(action)) is not None]
            if rows:
                lines += ["", f"**{group.title}**" + (f": {group.description}" if group.description else ""), ""]
                lines += ["| word | meaning |", "| --- | --- |", *rows]
        if parser.epilog:
            lines += ["", *(cell(line) + "  " for line in parser.epilog.splitlines())]
    return "\n".join(lines) + "\n"


def with_tools(parser: argparse.ArgumentParser, name: str = "") -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """All commands by their words, those of a command's own tools after it."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, command in action.choices.items():
                yield f"{name}{word}", command
                yield from with_tools(command, f"{name}{word} ")


def flag_row(action: argparse.Action) -> str | None:
    """A row for an argument: how it is written, and its help; None where help leaves it out."""
    if action.help == argparse.SUPPRESS:
        return None
    metavar = action.metavar or (action.dest.upper() if action.nargs != 0 else "")
    if action.choices is not None and not action.metavar:
        metavar = "|".join(map(str, action.choices))
    shown = " ".join(metavar) if isinstance(metavar, tuple) else str(metavar or "")
    words = [f"{flag} {shown}".strip() for flag in action.option_strings] or [shown]
    text = (action.help or "").replace("%%", "%")
    return f"| {', '.join(f'<code>{cell(word)}</code>' for word in words)} | {cell(text)} |"


def cell(text: str) -> str:
    """Text for a cell of a table, in which nothing is markup."""
    return re.sub(r"([*_`\[\]$])", r"\\\1", html.escape(text, quote=False)).replace("|", "&#124;")


def formats() -> str:
    """Return a page of the formats that are read and written, from the program's own tables."""
    lines = [
        "# Formats",
        "",
        "This page lists all file formats. [Scenes](../scene-format.md) describes the text formats line by line.",
        "",
        f"**Scenes**: {', '.join(f'`{ending}`' for ending in FORMATS)}. "
        f"Text has at most {paths.MOST_TEXT >> 20} MiB, an image {paths.MOST_IMAGE >> 20} MiB, "
        f"and geometry or a record cache {paths.MOST_GEOMETRY >> 20} MiB.",
        "",
        f"**Outputs** of `irrsplat render`: {', '.join(f'`{ending}`' for ending in ENDINGS)}, "
        "and a folder if the name has no extension.",
        "",
        "## EXR layers and NPZ arrays",
        "",
        "Arrays are linear float32, with the top row first.",
        "",
        "| name | shape | unit | meaning |",
        "| --- | --- | --- | --- |",
        *(f"| `{c.name}` | {'H W 3' if c.components == 3 else 'H W'} | {c.unit} | {cell(c.help)} |" for c in CHANNELS.values()),
        *(f"| `{name}` | {'N' if name.endswith('radius') else 'N 3'} | | records, only in NPZ files |" for name in RECORDS),
        "",
        "## Record caches",
        "",
        "The table lists the columns of a record, in the file of `--cache` and on the GPU.",
        "",
        "| column | type | unit | written by | meaning |",
        "| --- | --- | --- | --- | --- |",
        *(f"| `{c.name}` | {c.kind} | {c.unit} | {c.source} | {cell(c.meaning)} |" for c in COLUMNS.values()),
    ]
    return "\n".join(lines) + "\n"


def python() -> str:
    """A section for each public name, which mkdocstrings fills from the docstrings."""
    lines = ["# Python", "", "This page lists the public names of `irrsplat`.", ""]
    for name, home in public():
        inherited = ["      inherited_members: true"] if name == "Frame" else []  # its arrays
        options = [f"      heading: irrsplat.{name}", f"      toc_label: {name}", *inherited]
        lines += [f"::: {home}.{name}", "    options:", *options, ""]
    return "\n".join(lines)


def public() -> Iterator[tuple[str, str]]:
    """Each public name with the module in which it is defined; functions and Renderer first."""
    order = ("load", "render", "Renderer", "Frame", "irradiance", "LightMeter")
    names = sorted(irrsplat.__all__, key=lambda name: (order.index(name) if name in order else len(order), name))
    for name in names:
        found: Any = getattr(irrsplat, name)
        home = found.__module__
        assert getattr(import_module(home), name) is found
        yield name, home
