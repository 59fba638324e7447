"""Fill the tables of docs/reference.md from settings, buffers and the viewer's actions: `python docs/programs/tables.py`."""

from __future__ import annotations

import re
from pathlib import Path

from irrsplat.app.viewer.input.commands import FLYING, GROUPS
from irrsplat.core.buffers import CHANNELS
from irrsplat.settings import PRESETS, SETTINGS

PAGE = Path(__file__).resolve().parents[1] / "reference.md"


def word(value: object) -> str:
    """A setting's value as on the command line."""
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float) else str(value)


def table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A Markdown table."""
    lines = [head, tuple("---" for _ in head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def settings() -> str:
    """A row per setting."""
    rows = [(f"`{d.flag}`", d.range, word(d.default), d.stage, d.help) for d in SETTINGS.values()]
    return table(("flag", "range", "default", "stage", "meaning"), rows)


def presets() -> str:
    """A row per preset."""
    rows = [
        (f"`{name}`", ", ".join(f"`{SETTINGS[key].flag} {word(v)}`" for key, v in p.items()) or "–")
        for name, p in PRESETS.items()
    ]
    return table(("preset", "differs from the defaults in"), rows)


def buffers() -> str:
    """A row per channel."""
    rows = [(f"`{c.name}`", "H W 3" if c.components == 3 else "H W", c.unit, c.help) for c in CHANNELS.values()]
    return table(("name", "shape", "unit", "meaning"), rows)


def keys() -> str:
    """A row per key of the viewer, those of the buffers in one."""
    rows = [(f"{held}", help) for held, help in FLYING]
    shown = " ".join(f"`{key.shown}`" for key in GROUPS["View/Buffer"])
    rows.append((shown, ", ".join(key.title for key in GROUPS["View/Buffer"])))
    rows += [
        (f"`{key.shown}`", f"{key.title}: {key.help}" if key.help else key.title)
        for name, group in GROUPS.items()
        if name != "View/Buffer"
        for key in group
    ]
    return table(("key", "action"), rows)


def between(text: str, program: str, name: str, made: str) -> str:
    """A page's `text` with what stands between its marks of this `name` replaced by what the `program` has made."""
    start = f"<!-- {name}: made by docs/programs/{program}.py -->\n"
    text, count = re.subn(f"({re.escape(start)}).*?(<!-- end -->)", lambda m: m[1] + made + m[2], text, flags=re.S)
    assert count == 1, f"the page has no place for {name}, made by docs/programs/{program}.py"
    return text


def filled(text: str) -> str:
    """`text` with each marked table made anew."""
    for name, make in (("buffers", buffers), ("settings", settings), ("presets", presets), ("keys", keys)):
        text = between(text, "tables", name, make())
    return text


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
