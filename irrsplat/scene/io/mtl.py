"""Reads the diffuse colour and the emission of the materials in an OBJ file's `.mtl` library."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from irrsplat.core.color import clip_color, mean_color
from irrsplat.core.errors import InputError
from irrsplat.scene.io.lines import Line, lines, quote
from irrsplat.scene.model import Material


def load_mtl(path: Path) -> dict[str, Material]:
    """The materials in the file at `path`, by name: Kd (clipped to 0..1) times the mean colour of map_Kd, and Ke.

    Raises InputError with file and line for a malformed Kd or Ke and for a texture that can't be read.
    """
    found: dict[str, dict[str, np.ndarray]] = {}
    current: dict[str, np.ndarray] = {}
    for line in lines(path):
        if line.word == "newmtl":
            current = found.setdefault(line.rest, {})
        elif line.word in ("Kd", "Ke"):
            args = line.args * 3 if len(line.args) == 1 else line.args  # one value stands for three
            current[line.word] = np.array(line.numbers(f"{line.word} R G B", args))
        elif line.word == "map_Kd":
            current["map"] = _texture(line)
    return {name: _material(values) for name, values in found.items()}


def _material(values: dict[str, np.ndarray]) -> Material:
    textured = "map" in values
    albedo = values.get("Kd", np.full(3, 1.0 if textured else 0.5)) * values.get("map", np.ones(3))
    r, g, b = np.maximum(values.get("Ke", np.zeros(3)), 0.0).tolist()
    return Material(clip_color(albedo), (r, g, b))


def _texture(line: Line) -> np.ndarray:
    from PIL import Image

    file = line.path.parent / (line.rest if not line.rest.startswith("-") else line.args[-1])  # options stand first
    try:
        with Image.open(file) as image:
            return mean_color(image)
    except Exception as error:
        if isinstance(error, InputError):
            raise
        raise line.error(f"cannot read the texture {quote(str(file.name))}; expected an image beside the .mtl file") from None
