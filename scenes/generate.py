"""Makes the bundled scenes `door`, `atrium` and `curved` at any level of detail, up to a million triangles.

    python scenes/generate.py door --detail 1 -o scenes/door

`--detail` multiplies the number of triangles of whatever is curved; 1 gives the files that are bundled. All shapes are designs
of our own, in metres, and nothing is random: equal details, equal files.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

if __package__:  # installed, as irrsplat.scenes
    from irrsplat.scenes.shapes import Array, Writer, ball, cube, lathe, pipe, sheet, surface, torus
else:
    from shapes import Array, Writer, ball, cube, lathe, pipe, sheet, surface, torus  # type: ignore[no-redef]


# (radius, height) from the middle of the bottom, up the outside and, for a vessel, down the inside again
VASE = [(0, 0), (0.2, 0), (0.3, 0.22), (0.34, 0.5), (0.2, 0.85), (0.13, 1.02), (0.19, 1.15), (0.185, 1.17), (0.17, 1.165)]
VASE += [(0.1, 1.02), (0.25, 0.5), (0, 0.06)]
POT = [(0, 0), (0.07, 0), (0.11, 0.04), (0.13, 0.09), (0.1, 0.15), (0.06, 0.17), (0.035, 0.185)]
POT += [(0.012, 0.195), (0.02, 0.21), (0.012, 0.222), (0, 0.224)]
CUP = [(0, 0), (0.022, 0), (0.036, 0.025), (0.042, 0.068), (0.0415, 0.072), (0.039, 0.072), (0.038, 0.068)]
CUP += [(0.032, 0.028), (0.018, 0.008), (0, 0.006)]
BOWL = [(0, 0), (0.06, 0), (0.12, 0.035), (0.17, 0.09), (0.169, 0.095), (0.163, 0.094), (0.115, 0.045), (0.05, 0.014), (0, 0.01)]
URN = [(0, 0), (0.12, 0), (0.2, 0.2), (0.19, 0.42), (0.09, 0.62), (0.08, 0.7), (0.125, 0.77), (0.125, 0.78), (0.115, 0.775)]
URN += [(0.06, 0.7), (0.07, 0.62), (0.17, 0.41), (0.1, 0.05), (0, 0.03)]
PLANTER = [(0, 0), (0.2, 0), (0.32, 0.3), (0.34, 0.6), (0.24, 0.8), (0.3, 0.89), (0.29, 0.905), (0.265, 0.9)]
PLANTER += [(0.2, 0.8), (0.3, 0.6), (0.2, 0.1), (0, 0.08)]
FOUNTAIN = [(0, 0), (0.55, 0), (0.5, 0.12), (0.2, 0.3), (0.15, 0.7), (0.3, 0.9), (0.85, 1.08), (1.0, 1.24), (1.0, 1.27)]
FOUNTAIN += [(0.96, 1.26), (0.75, 1.14), (0.25, 1.05), (0.13, 1.2), (0.1, 1.5), (0.2, 1.66), (0, 1.8)]
COLUMN = [(0.3, 0), (0.3, 0.12), (0.31, 0.16), (0.24, 0.24), (0.2, 0.34), (0.2, 1.0), (0.19, 1.9), (0.17, 2.6)]
COLUMN += [(0.18, 2.68), (0.24, 2.74), (0.28, 2.86), (0.28, 2.9)]
STAGE = [(0, 4), (0, 1), (0, -1), (0.12, -1.75), (0.75, -2.35), (1.6, -2.5), (2.6, -2.5), (3.8, -2.5)]  # (height, depth)
OPEN = math.radians(75)  # the door's angle
SPOUT = [(0.1, 0.05, 0.026), (0.16, 0.07, 0.02), (0.19, 0.13, 0.014), (0.225, 0.165, 0.012)]  # x, y, radius
HANDLE = [(-0.09, 0.15, 0.01), (-0.16, 0.16, 0.011), (-0.19, 0.11, 0.011), (-0.16, 0.06, 0.011), (-0.11, 0.05, 0.01)]


def _bumps(x: Array, y: Array, z: Array) -> Array:
    coarse, fine = np.sin(2.6 * x + 1) * np.sin(3.1 * y) * np.sin(2.7 * z + 2), np.sin(4 * (x + y)) * np.cos(4 * (z - y))
    height: Array = 0.2 * coarse + 0.06 * fine
    return height


def curved(folder: Path, detail: float) -> None:
    about = "Curved things on a stage, a design of our own: smooth normals, contacts, and coloured walls that bleed."
    w = Writer(folder, "curved", detail, about)
    w.say("", "cam 0.3 1.7 6.4  0 1.02 0  0 1 0", "cam close 1.9 1.1 3.2  -0.2 0.6 0.1  0 1 0", "proj 42 1 0.1 100", "")
    w.light("lamp", "# a bare bulb, half a metre and more from everything", "position 0.5 3.1 1.5 1", "intensity 30 27 22")
    w.shape("cube", cube())
    w.shape("stage", sheet(STAGE, 5.6, w.n(28)))
    w.shape("sphere", ball(w.n(12), w.n(20)))
    w.shape("large", ball(w.n(24), w.n(38)))
    w.shape("torus", torus(0.62, 0.2, w.n(12), w.n(30)))
    w.shape("blob", ball(w.n(28), w.n(40), _bumps))
    w.shape("vase", lathe(VASE, w.n(20), w.n(20)))
    w.color(0.78, 0.76, 0.72, "the floor, which bends up into the back wall")
    w.draw("stage")
    w.color(0.8, 0.8, 0.8, "ceiling")
    w.box((-2.9, 2.9), (3.8, 4.0), (-2.6, 4.0))
    w.color(0.78, 0.2, 0.06, "left wall")
    w.box((-2.9, -2.7), (-0.1, 3.8), (-2.6, 4.0))
    w.color(0.05, 0.32, 0.55, "right wall")
    w.box((2.7, 2.9), (-0.1, 3.8), (-2.6, 4.0))
    w.color(0.85, 0.85, 0.82)
    w.draw("blob", (0.05, 0.893, -0.7), size=(0.92, 0.92, 0.92))
    w.draw("large", (-1.45, 0.6, 0.35), size=(0.6, 0.6, 0.6))
    w.color(0.85, 0.62, 0.08)
    w.draw("torus", (1.35, 0.2, 0.65))
    w.draw("sphere", (0.1, 0.25, 1.35), size=(0.25, 0.25, 0.25))
    w.color(0.2, 0.55, 0.15)
    w.draw("sphere", (1.3, 0.38, 0.6), size=(0.38, 0.38, 0.38))
    w.color(0.62, 0.1, 0.32)
    w.draw("vase", (1.75, 0, -1.05), size=(1.25, 1.25, 1.25))
    w.done()


def door(folder: Path, detail: float) -> None:
    about = "A room that gets all its light through a door ajar, from two lamps in the corridor behind: the idea\n"
    about += "is Lafortune's and Veach's, the geometry and the colours are our own."
    w = Writer(folder, "door", detail, about)
    w.say(
        "", "cam 2.0 1.65 2.1  -0.2 0.69 -1.0  0 1 0", "cam table 1.45 1.25 0.75  0.4 0.85 -0.55  0 1 0", "proj 54 1 0.05 100", ""
    )
    w.light(
        "uplighter",
        "# stands in the corridor in the plane of the open door and shines past it to the ceiling of the room",
        "position -2.05 0.8 -3.9 1",
        "intensity 100 88 66",
        "spotDirection 0 2.8 -0.3",
        "spotCutoff 24",
        "spotInner 10",
    )
    w.light(
        "corridor",
        "# under the corridor's ceiling; its beam falls through the door on the floor",
        "position -0.9 2.4 -4.5 1",
        "intensity 60 50 36",
        "spotDirection -1.2 0.6 -1.5",
        "spotCutoff 40",
        "spotInner 20",
    )
    w.shape("cube", cube())
    w.shape("sphere", ball(w.n(8), w.n(12)))
    w.shape("pot", lathe(POT, w.n(18), w.n(22)))
    w.shape("spout", pipe(SPOUT, w.n(8), w.n(10)))
    w.shape("handle", pipe(HANDLE, w.n(10), w.n(8)))
    w.shape("cup", lathe(CUP, w.n(13), w.n(14)))
    w.shape("bowl", lathe(BOWL, w.n(12), w.n(18)))
    w.shape("urn", lathe(URN, w.n(16), w.n(18)))

    w.color(0.55, 0.4, 0.25, "floor of room and corridor")
    w.box((-2.7, 2.7), (-0.2, 0), (-5.1, 2.7))
    w.color(0.85, 0.84, 0.8, "ceiling")
    w.box((-2.7, 2.7), (2.8, 3.0), (-5.1, 2.7))
    w.color(0.82, 0.78, 0.7, "the wall with the doorway, 1 m by 2.1 m; right and front walls")
    w.box((-2.7, -1.7), (0, 2.8), (-2.7, -2.5))
    w.box((-0.7, 2.7), (0, 2.8), (-2.7, -2.5))
    w.box((-1.7, -0.7), (2.1, 2.8), (-2.7, -2.5))
    w.box((2.5, 2.7), (0, 2.8), (-2.5, 2.7))
    w.box((-2.7, 2.5), (0, 2.8), (2.5, 2.7))
    w.color(0.12, 0.45, 0.48, "left wall")
    w.box((-2.7, -2.5), (0, 2.8), (-2.5, 2.5))
    w.color(0.85, 0.74, 0.5, "corridor")
    w.box((-2.7, 2.7), (0, 2.8), (-5.1, -4.9))
    w.box((-2.7, -2.5), (0, 2.8), (-4.9, -2.7))
    w.box((2.5, 2.7), (0, 2.8), (-4.9, -2.7))
    w.color(0.4, 0.22, 0.1, "the door, open by 75 degrees, and its frame")
    w.box((-1.79, -1.68), (0, 2.19), (-2.5, -2.462))  # reaches behind the hinge, so that no light seeps past it
    w.box((-0.72, -0.61), (0, 2.19), (-2.5, -2.462))
    w.box((-1.68, -0.72), (2.08, 2.19), (-2.5, -2.462))
    w.box((-1.7, -1.68), (0, 2.1), (-2.7, -2.5))
    w.box((-0.72, -0.7), (0, 2.1), (-2.7, -2.5))
    w.box((-1.68, -0.72), (2.08, 2.1), (-2.7, -2.5))
    along, across = np.array([math.cos(OPEN), 0, math.sin(OPEN)]), np.array([-math.sin(OPEN), 0, math.cos(OPEN)])
    hinge = np.array([-1.65, 0.01, -2.46])
    w.draw("cube", hinge, turn=[(-math.degrees(OPEN), 0, 1, 0)], size=(0.93, 2.06, 0.04))
    w.color(0.7, 0.55, 0.15)
    for side in (-0.03, 0.07):
        w.draw("sphere", hinge + 0.86 * along + side * across + (0, 1, 0), size=(0.035, 0.035, 0.035))

    w.color(0.62, 0.08, 0.08, "rug")
    w.box((-1.5, 1.8), (0, 0.015), (-1.65, 1.05))
    w.color(0.6, 0.38, 0.2, "table and chairs, and what lies on the table")
    w.say("push", "trans 0.35 0 0")
    w.box((-0.75, 0.85), (0.7, 0.74), (-0.85, 0.15))
    for x in (-0.7, 0.73):
        for z in (-0.8, 0.03):
            w.box((x, x + 0.07), (0.015, 0.7), (z, z + 0.07))
    for x, z, turn in ((-1.2, -0.25, 80), (0.1, -1.35, -10), (-0.3, 0.72, 165)):
        w.say("push", f"trans {x:g} 0.015 {z:g}", f"rotate {turn:g} 0 1 0")  # a chair about its seat's centre, its back at -z
        w.box((-0.21, 0.21), (0.42, 0.46), (-0.17, 0.21))
        for a in (-0.21, 0.17):
            w.box((a, a + 0.04), (0, 0.9), (-0.21, -0.17))
            w.box((a, a + 0.04), (0, 0.42), (0.17, 0.21))
        w.box((-0.17, 0.17), (0.72, 0.9), (-0.2, -0.18))
        w.say("pop")

    w.color(0.85, 0.85, 0.85, "on the table: tea, fruit, books")
    for part in ("pot", "spout", "handle"):
        w.draw(part, (0.12, 0.74, -0.42), turn=[(-35, 0, 1, 0)])
    for x, z in ((0.42, -0.2), (-0.02, -0.08), (0.5, -0.62)):
        w.draw("cup", (x, 0.74, z))
    w.color(0.1, 0.25, 0.6)
    w.draw("bowl", (-0.38, 0.74, -0.3))
    w.color(0.8, 0.4, 0.05)
    for x, y, z in ((-0.43, 0.80, -0.31), (-0.33, 0.80, -0.35), (-0.37, 0.805, -0.24), (-0.38, 0.865, -0.3)):
        w.draw("sphere", (x, y, z), size=(0.045, 0.045, 0.045))
    for rgb, y, turn in (((0.6, 0.07, 0.08), 0.74, 12), ((0.08, 0.4, 0.16), 0.78, 25), ((0.75, 0.6, 0.12), 0.815, 5)):
        w.color(*rgb)
        w.draw("cube", (0.62, y, -0.02), turn=[(turn, 0, 1, 0), (180, 0, 1, 0)], size=(0.22, 0.04 if y < 0.8 else 0.03, 0.16))
    w.say("pop")

    w.color(0.15, 0.3, 0.55, "vase, low cupboard and picture")
    w.draw("urn", (-2.1, 0, 0.35), size=(1.15, 1.15, 1.15))
    w.color(0.75, 0.45, 0.1)
    w.box((0.3, 2.2), (0, 0.8), (-2.5, -2.1))
    for x in (0.36, 1.27):
        w.box((x, x + 0.87), (0.08, 0.74), (-2.1, -2.085))
    w.color(0.55, 0.1, 0.3)
    w.draw("urn", (0.75, 0.8, -2.28), size=(0.6, 0.6, 0.6))
    w.color(0.12, 0.08, 0.05)
    w.box((0.55, 1.95), (1.3, 2.2), (-2.5, -2.46))
    w.color(0.85, 0.8, 0.3)
    w.box((0.62, 1.88), (1.37, 2.13), (-2.5, -2.455))
    w.color(0.7, 0.12, 0.1)
    w.box((0.8, 1.25), (1.5, 2.0), (-2.5, -2.45))
    w.done()


def atrium(folder: Path, detail: float) -> None:
    w = Writer(
        folder,
        "atrium",
        detail,
        "A courtyard of arcades under sun and sky, with drapes of zero thickness; a spot lights the sculpture.",
    )
    w.say("", "cam -6.6 1.75 -1.1  1.5 2.05 0.35  0 1 0", "cam gallery -6 1.7 -4.9  3 1.5 -3.4  0 1 0", "proj 62 1 0.05 200", "")
    w.light("sun", "# directional: the light comes from X Y Z", "position 0.3 1 0.5 0", "diffuse 5 4.4 3.5 1")
    w.light(
        "spot", "position 4.6 4.6 -0.4 1", "intensity 130 105 70", "spotDirection 6.7 1.6 -1.2", "spotCutoff 20", "spotInner 13"
    )
    w.say("sky 0.45 0.63 0.95")
    w.shape("cube", cube())
    w.shape("column", lathe(COLUMN, w.n(16), w.n(16)))
    inner, half, top = 1.22, 1.5, 2.0  # of an arch: radius, half a bay, height of its wall above the springing

    def arch(u: Array, v: Array, z: float | Array, outer: float = 1.0) -> tuple[Array, Array, Array]:
        corner = math.atan2(top, half)
        angle = np.interp(u, [0.0, 0.25, 0.75, 1.0], [0.0, corner, math.pi - corner, math.pi])
        x, y = -np.cos(angle), np.sin(angle)
        reach = np.minimum(half / np.maximum(np.abs(x), 1e-9), top / np.maximum(y, 1e-9))  # from the centre to the wall's edge
        r = inner + (reach - inner) * v * outer
        return r * x, r * y, z + 0 * u

    steps = 4 * ((w.n(20) + 3) // 4)  # so that a step ends at each corner of the wall
    w.shape("arch_front", surface(lambda u, v: arch(u, 1 - v, 0.25), steps, 1, ring=False))
    w.shape("arch_back", surface(lambda u, v: arch(u, v, -0.25), steps, 1, ring=False))
    w.shape("arch_inside", surface(lambda u, v: arch(u, 0 * v, 0.25 - 0.5 * v), steps, 1, ring=False))

    def drape(u: Array, v: Array) -> tuple[Array, Array, Array]:
        waist = 1.0 - 0.45 * np.exp(-(((u - 0.62) / 0.22) ** 2))
        x = (v - 0.5) * 2.1 * waist
        fold = np.sin(2 * np.pi * (6.5 * v + 0.15 * np.sin(4 * u))) * (0.05 + 0.05 * u)
        return x, 2.75 - 2.3 * u, fold + 0.08 * np.sin(3 * u) * np.cos(3 * v)

    w.shape("drape", surface(drape, w.n(12), w.n(32), ring=False))
    w.shape("fountain", lathe(FOUNTAIN, w.n(26), w.n(26)))
    w.shape("planter", lathe(PLANTER, w.n(16), w.n(20)))
    w.shape("bush", ball(w.n(14), w.n(22), lambda x, y, z: 0.12 * np.sin(7 * x + 1) * np.sin(8 * y) * np.sin(7 * z)))
    w.shape("sculpture", ball(w.n(20), w.n(28), _bumps))
    w.shape("rod", pipe([(-1.35, 2.78, 0.025), (1.35, 2.78, 0.025)], 1, w.n(8)))

    w.color(0.6, 0.55, 0.46, "stone: floor, end walls, storeys above the arcades, gallery roofs")
    w.box((-7.9, 7.9), (-0.3, 0), (-6.6, 6.6))
    w.box((-8.2, -7.9), (0, 7), (-6.6, 6.6))
    w.box((7.9, 8.2), (0, 7), (-6.6, 6.6))
    for side in (-1, 1):
        for low, high, y in (
            (3.25, 3.75, (4.9, 7.0)),
            (3.15, 3.85, (7.0, 7.25)),
            (3.15, 3.25, (4.85, 5.05)),
            (3.75, 6.6, (4.9, 5.2)),
        ):
            z = (low, high) if side > 0 else (-high, -low)
            w.box((-7.9, 7.9), y, z)
        for x in (-6, -3, 0, 3, 6):
            for part in ("arch_front", "arch_back", "arch_inside"):
                w.draw(part, (x, 2.9, 3.5 * side))
        for at in (-7.5, -4.5, -1.5, 1.5, 4.5, 7.5):
            w.draw("column", (at, 0, 3.5 * side))
            w.box((at - 0.28, at + 0.28), (2.88, 2.9), (3.5 * side - 0.28, 3.5 * side + 0.28))
        w.box((-7.9, -7.5), (2.9, 4.9), (3.5 * side - 0.25, 3.5 * side + 0.25))
        w.box((7.5, 7.9), (2.9, 4.9), (3.5 * side - 0.25, 3.5 * side + 0.25))
    w.color(0.66, 0.27, 0.13, "back walls of the galleries")
    w.box((-7.9, 7.9), (0, 4.9), (-6.6, -6.3))
    w.color(0.72, 0.5, 0.16)
    w.box((-7.9, 7.9), (0, 4.9), (6.3, 6.6))
    for rgb, places in (
        ((0.62, 0.04, 0.05), ((-6, 1), (0, 1), (3, -1))),
        ((0.06, 0.3, 0.1), ((-3, -1), (6, 1))),
        ((0.06, 0.12, 0.5), ((3, 1), (-6, -1), (6, -1))),
    ):
        w.color(*rgb, comment="drapes")
        for x, side in places:
            w.draw("drape", (x, 0, 3.5 * side), turn=[(90 - 90 * side, 0, 1, 0)])
    w.color(0.35, 0.2, 0.08)
    for x in (-6, -3, 0, 3, 6):
        for side in (-1, 1):
            w.draw("rod", (x, 0, 3.5 * side))
    w.color(0.08, 0.4, 0.45, "basin and fountain")
    w.box((-0.6, 3.6), (0, 0.06), (-0.9, 2.3))
    w.color(0.75, 0.73, 0.7)
    w.draw("fountain", (1.5, 0.06, 0.7))
    w.color(0.6, 0.24, 0.1, "plants")
    pots = ((-4.5, -2.4), (-1.5, 2.5), (4.5, 2.5), (4.5, -2.4))
    for pot_x, pot_z in pots:
        w.draw("planter", (pot_x, 0, pot_z))
    w.color(0.12, 0.35, 0.06)
    for pot_x, pot_z in pots:
        w.draw("bush", (pot_x, 1.2, pot_z), size=(0.42, 0.5, 0.42))
    w.color(0.8, 0.78, 0.74, "sculpture")
    w.box((6.3, 7.1), (0, 1.0), (-1.6, -0.8))
    w.draw("sculpture", (6.7, 1.58, -1.2), size=(0.5, 0.6, 0.5))
    w.done()


SCENES: dict[str, Callable[[Path, float], None]] = {"door": door, "atrium": atrium, "curved": curved}


def main() -> None:
    parser = argparse.ArgumentParser(description="Make one of the generated scenes.")
    parser.add_argument("scene", choices=SCENES)
    parser.add_argument("--detail", type=float, default=1.0, help="multiplies the triangles; 1 is the bundled scene")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the .scene and its files")
    arguments = parser.parse_args()
    if not 0.0 < arguments.detail <= 1000.0:
        parser.error("--detail takes a number above 0, at most 1000")
    SCENES[arguments.scene](arguments.output, arguments.detail)


if __name__ == "__main__":
    main()
