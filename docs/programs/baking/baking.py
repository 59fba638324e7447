"""Takes docs/images/baking.png: a scene by irrsplat, and its lightmap by three.js; and tells how far the two differ.

    .venv/bin/python docs/programs/baking/baking.py FOLDER [SCENE …]

FOLDER has what `npm install three gltf-validator puppeteer-core` puts there; Chromium is /usr/bin/chromium, or what CHROMIUM
names. The picture is of the first scene (default: cornell). Ends with status 1 where a mean differs by more than 3 %.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import irrsplat
from irrsplat.app.bake import bake_lightmap
from irrsplat.core.files import eight_bits
from irrsplat.image.tonemap import tonemap

DOCS = Path(__file__).resolve().parents[2]
SIDE, TEXELS = 400, 512
MOST = 0.03  # of the mean


def shown(folder: Path, glb: Path) -> np.ndarray:
    """(SIDE, SIDE, 4) linear radiance and alpha of the file's first camera, by three.js."""
    raw = glb.with_suffix(".f32")
    program = Path(__file__).with_name("baking.mjs").resolve()
    subprocess.run(["node", str(program), str(glb), str(SIDE), str(SIDE), str(raw)], cwd=folder, check=True)
    return np.fromfile(raw, "<f4").reshape(SIDE, SIDE, 4)[::-1]


def main() -> int:
    """Bake, render both, compare; the exit status."""
    folder, names = Path(sys.argv[1]).resolve(), sys.argv[2:] or ["cornell"]
    worst = 0.0
    for name in names:
        scene = irrsplat.load(name)
        made, pictures = bake_lightmap(scene, TEXELS), []
        frame = irrsplat.render(scene, size=(SIDE, SIDE))
        with tempfile.TemporaryDirectory() as there:
            for form in ("radiance", "irradiance"):
                glb = Path(there) / f"{form}.glb"
                made.save(glb, form)  # type: ignore[arg-type]
                pictures.append(shown(folder, glb))
        for form, picture in zip(("radiance", "irradiance"), pictures, strict=True):
            seen = np.isfinite(frame.depth) & (picture[..., 3] > 0.0)
            ours, theirs = frame.image[seen].astype(float), picture[seen][:, :3].astype(float)
            reflects = frame.albedo[seen] > 0.02
            E, E_ref = (np.where(reflects, L / np.maximum(frame.albedo[seen], 0.02), 0.0) * np.pi for L in (theirs, ours))
            off, apart = E.mean() / E_ref.mean() - 1.0, np.median(np.abs(E - E_ref)[reflects] / E_ref[reflects])
            worst = max(worst, abs(off))
            print(f"{name}, {form}: mean irradiance {off:+.2%}, median difference of a pixel {apart:.2%}")
        if name == names[0]:
            sides = [tonemap(L, frame.exposure) for L in (frame.image, pictures[0][..., :3])]
            whole = Image.fromarray(eight_bits(np.concatenate(sides, axis=1))).resize((600, 300), Image.Resampling.LANCZOS)
            whole.save(DOCS / "images" / "baking.png", optimize=True)
    return int(worst > MOST)


if __name__ == "__main__":
    sys.exit(main())
