"""Whatever is called, in whatever order: a change is applied whole or not at all, and at rest the picture is a fresh renderer's.

Calls are drawn at random: frames in ticks of any length, renders, lights, moves, paint, settings, sizes, caches, calls that have
to be refused, and Ctrl-C in the middle of any of them. What the scene has to be is kept beside, by value. Now and then the view
comes to rest and is held against new renderers of that scene. What no record has a part in is the same, bit for bit. Irradiance
differs from theirs by no more than AS_SEEDS times what two of them differ by that have other seeds; or, where records of the past
make the difference, it is no farther from a finer picture than theirs.

IRRSPLAT_CALLS: how many calls (60). IRRSPLAT_SEED: which ones (1). With -s, the pictures that were compared are summed up.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat import Frame, InputError, Renderer
from irrsplat.image.view import View, read
from irrsplat.scene.model import Camera, Light, Material, Scene
from tests.renderer.test_move import shift
from tests.renderer.test_renderer import FAST, FRONT, room
from tests.support.interrupts import run as run_lines
from tests.support.worlds import lamp

CALLS = int(os.environ.get("IRRSPLAT_CALLS", "60"))
SEED = int(os.environ.get("IRRSPLAT_SEED", "1"))
COMPARED = 40 if CALLS < 1000 else 100  # calls, after about so many a picture is compared
FEW = 600  # records that may be kept, where these are not enough for some views
MOST = 1500  # records, above which they are forgotten, so that the calls stay quick
SIZES = (48, 40), (64, 32), (8, 400)  # from 400 rows on a view begins with every other pixel
CAMERAS = FRONT, Camera((-0.8, 0.7, 0.9), (0.3, -0.5, -0.6), fov=60.0), Camera((0.7, -0.5, 0.9), (-0.6, 0.0, -1.0), fov=70.0)
BASE: dict[str, Any] = {**FAST, "gather": "trace", "gather_size": 24, "ray_noise": 0.0, "a": 0.5}
SETTINGS: dict[str, tuple[Any, ...]] = {
    "a": (0.4, 0.5),
    "bounces": (0, 1, 1, 2, 2, "all"),
    "borrow": (0, 4),
    "coarse": (False, True),
    "gather": ("raster", "trace"),
    "gather_size": (24, 32),
    "gradients": (False, True),
    "kernel": ("cut", "smooth"),
    "blend": (0.3, 0.5),
    "smooth": (False, True),
    "shadow_size": (64, 96),
    "seed": (0, 1),
    "fill_holes": (False, True),
    "fade": (False, True),
    "radius_max": (7.0, 12.0),
    "pixel_light_samples": (0, 0, 4),
    "adapt": (0.2, 0.4),
    "second_order": (False, True),
    "backdrop": ("sky", "grey"),
    "max_records": (FEW, 4000, 4000, 4000),
}  # fmt: skip; without `gradients` there are no walls either, which keep records from what is behind them
EXACT = "position", "normal", "albedo", "depth", "direct", "emission"
AS_SEEDS = 1.5  # times as much as two seeds do may a picture differ from a new renderer's
SEEDS = 24  # that are tried before a picture counts as wrong: one of eight may miss a strip of light that is a pixel wide
DARK = 1e-3  # W/m²: a mean that is less counts as this; with the only lamp in the closed box, 3 of 1000 rasters saw a lit texel
LEAST = 0.02  # of the mean: differences of the size of a seed's are not looked for below this

Draw = np.random.Generator


@dataclass
class Run:
    """A renderer in use, and beside it what its scene, settings and size have to be."""

    renderer: Renderer
    folder: Path
    loaded: Scene
    scene: Scene
    settings: Any
    size: tuple[int, int]
    headlamp: float = 0.0
    camera: Camera = FRONT
    view: View | None = None
    saved: int = 0
    done: list[str] = field(default_factory=list)
    off: list[tuple[float, float]] = field(default_factory=list)  # of each compared picture, and of two seeds there
    counted: Counter[str] = field(default_factory=Counter)

    def check(self) -> None:
        """The renderer is of what it has to be."""
        there, wanted = self.renderer.scene, self.scene
        assert there.lights == wanted.lights, f"other lights after {self.done}"
        for a, b in zip(there.meshes, wanted.meshes, strict=True):
            same = np.array_equal(a.positions, b.positions) and np.array_equal(a.normals, b.normals) and a.material == b.material
            assert same, f"another mesh after {self.done}"
        assert self.renderer.settings == self.settings and self.renderer.size == self.size, f"other settings after {self.done}"


# ---- calls: each returns the Run's values as they have to be once it is done ------------------------------------------------

Values = dict[str, Any]
Call = Callable[[Run, Draw], tuple[Callable[[], object], Values]]
CHANGES: list[Call] = []
LOOKS: list[Call] = []
REFUSED: list[Call] = []


def to(kind: list[Call], often: int = 1) -> Callable[[Call], Call]:
    """Puts a call among those of a kind; those that are to come more `often` are there several times."""

    def add(one: Call) -> Call:
        kind.extend([one] * often)
        return one

    return add


def vector(draw: Draw, low: float, high: float) -> tuple[float, float, float]:
    x, y, z = draw.uniform(low, high, 3).tolist()
    return x, y, z


@to(LOOKS, 4)
def frame(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    seconds = [None, 1e-4, 0.01, 0.1][draw.integers(4)]
    gather = bool(draw.random() < 0.85)

    def act() -> None:
        run.view = None
        run.view = run.renderer.frame(run.camera, seconds, gather)[0]

    return act, {}


@to(LOOKS)
def turn(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    run.camera = CAMERAS[draw.integers(len(CAMERAS))]
    return frame(run, draw)


@to(LOOKS)
def render(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    return lambda: run.renderer.render(run.camera), {}


@to(LOOKS)
def refine(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    return lambda: run.renderer.refine(run.camera, 0.05, 0.01), {}


@to(LOOKS)
def accumulate(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    """Of the view that the last call gave, if that gave one."""
    samples, seconds, view = int(draw.integers(1, 6)), [None, 1e-4][draw.integers(2)], run.view
    return lambda: view and run.renderer.accumulate(view, samples, seconds), {}


@to(LOOKS)
def forget(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    records, lights = bool(draw.random() < 0.2), bool(draw.random() < 0.5)
    return lambda: run.renderer.forget(records, lights), {}


@to(LOOKS)
def renew(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    return run.renderer.renew, {}


@to(LOOKS)
def cache(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    """Save it, or load one that was saved, which is refused where it is of another scene or other settings."""
    if not run.saved or draw.random() < 0.5:
        run.saved += 1
        return lambda: run.renderer.save_cache(run.folder / f"{run.saved % 3}.cache"), {}
    name = run.folder / f"{draw.integers(3)}.cache"

    def act() -> None:
        try:
            run.renderer.load_cache(name)
        except InputError as error:
            assert "record cache was made" in str(error) or "there is no such file" in str(error)

    return act, {}


@to(CHANGES, 3)
def relight(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    """Dim, carry, add and take away lamps."""
    lights, what = list(run.scene.lights), draw.integers(5)
    number = int(draw.integers(len(lights))) if lights else 0
    if what == 0 and lights:
        by = float(draw.choice([0.0, 0.5, 2.0, 1.3]))
        lights = [replace(light, color=tuple(max(by * c, 0.2) for c in light.color)) for light in lights]  # type: ignore[arg-type]
    elif what == 1 and lights:
        lights[number] = replace(lights[number], color=vector(draw, 0.5, 4.0))
    elif what == 2 and lights and not lights[number].directional:
        lights[number] = replace(lights[number], position=vector(draw, -0.8, 0.8))
    elif what == 3 and len(lights) < 3:
        sun = Light((*vector(draw, -0.3, 0.3)[:2], 1.0), (1.0, 1.0, 0.8), directional=True)
        spot = lamp(vector(draw, -0.7, 0.7), 2.0, spot_target=vector(draw, -1, 1), spot_cutoff=40.0)
        lights.append([sun, spot, lamp(vector(draw, -0.8, 0.8), 2.0)][draw.integers(3)])
    elif len(lights) > 1:
        del lights[number]
    return lambda: run.renderer.relight(lights), {"scene": replace(run.scene, lights=tuple(lights))}


@to(CHANGES, 2)
def move(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    """The box, from where it was loaded; by a mirror, too."""
    matrix = shift(*draw.uniform(-0.3, 0.3, 3)) if draw.random() < 0.8 else np.eye(4)
    if draw.random() < 0.2:
        matrix[0, 0] = -1.0
    return lambda: run.renderer.move(1, matrix), {"scene": _moved(run, matrix)}


def _moved(run: Run, matrix: np.ndarray) -> Scene:
    """By the same arithmetic as irrsplat's, which tests/renderer/test_move.py judges."""
    from irrsplat.scene.motion import moved

    return moved(run.scene, run.loaded.meshes, 1, matrix)


@to(CHANGES)
def repaint(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    number, shines = int(draw.integers(3)), bool(draw.random() < 0.3)
    material = Material(vector(draw, 0.1, 0.9), vector(draw, 0.1, 1.0) if shines else (0.0, 0.0, 0.0))
    meshes = list(run.scene.meshes)
    meshes[number] = replace(meshes[number], material=material)
    return lambda: run.renderer.repaint(number, material), {"scene": replace(run.scene, meshes=tuple(meshes))}


@to(CHANGES, 4)
def change(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    """Up to three settings at once."""
    names = draw.choice(list(SETTINGS), int(draw.integers(1, 4)), replace=False).tolist()
    values = {name: SETTINGS[name][draw.integers(len(SETTINGS[name]))] for name in names}
    settings = replace(run.settings, **values)
    return lambda: run.renderer.change(settings), {"settings": settings}


@to(CHANGES)
def resize(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    size = SIZES[draw.integers(len(SIZES))]
    return lambda: run.renderer.resize(size), {"size": size}


@to(CHANGES)
def carry(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    power = float(draw.choice([0.0, 0.5]))
    return lambda: run.renderer.carry_headlamp(power), {"headlamp": power}


@to(REFUSED)
def too_many_lights(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    return lambda: run.renderer.relight([lamp((0.0, 0.5, 0.0))] * 1000), {}


@to(REFUSED)
def singular(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    return lambda: run.renderer.move(1, np.zeros((4, 4))), {}


@to(REFUSED)
def nowhere(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    return lambda: run.renderer.repaint("nobody", Material()), {}


@to(REFUSED)
def no_size(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    return lambda: run.renderer.resize((0, 5) if draw.random() < 0.5 else (10**6, 10**6)), {}


@to(REFUSED)
def no_cache(run: Run, draw: Draw) -> tuple[Callable[[], object], Values]:
    return lambda: run.renderer.load_cache(run.folder), {}


# ---- in order --------------------------------------------------------------------------------------------------------------


def call(run: Run, draw: Draw) -> None:
    """Make one call, and see that it is applied, or refused, whole."""
    kind = [CHANGES, LOOKS, REFUSED][draw.choice(3, p=(0.45, 0.5, 0.05))]
    one = kind[draw.integers(len(kind))]
    act, values = one(run, draw)
    run.done = [*run.done[-60:], one.__name__]
    if one not in (accumulate, frame, turn):
        run.view = None
    if kind is REFUSED:
        with pytest.raises(InputError):
            act()
    elif draw.random() < 0.05:
        run.done[-1] += " interrupted"
        run.view = None
        line = int(np.exp(draw.uniform(0.0, 9.0)))
        if run_lines(act, line)[1]:
            run.counted["interrupted"] += 1
            made = {name: getattr(run.renderer, name) for name in values}
            if values and not all(_same(made[name], getattr(run, name)) for name in values):
                for name, value in values.items():  # then it is applied, and whole: `check` sees to that
                    setattr(run, name, value)
        else:
            for name, value in values.items():
                setattr(run, name, value)
    else:
        act()
        for name, value in values.items():
            setattr(run, name, value)
    run.counted[one.__name__] += 1
    run.check()


def _same(a: Any, b: Any) -> bool:
    if not isinstance(a, Scene):
        return bool(a == b)
    pairs = zip(a.meshes, b.meshes, strict=True)
    return a.lights == b.lights and all(np.array_equal(x.positions, y.positions) and x.material == y.material for x, y in pairs)


def fresh(run: Run, more: int, **settings: Any) -> Frame:
    """What a new renderer makes of the scene as it has to be, by a seed that is so much more; then it has seen another view
    before, so that its records lie elsewhere, too. settings: what else differs."""
    with Renderer(run.scene, run.size) as made:
        made.change(replace(run.settings, **{"seed": run.settings.seed + more, **settings}))
        made.carry_headlamp(run.headlamp)
        if more:
            made.render(CAMERAS[more % len(CAMERAS)])
        return made.render(run.camera)


def off(one: Frame, other: Frame) -> float:
    """How far two pictures' irradiance is apart, relative to its mean: the root of the mean square."""
    mean = max(float(other.irradiance.mean()), DARK)
    return float(np.sqrt(((one.irradiance - other.irradiance) ** 2).mean())) / mean


def at_rest(run: Run, draw: Draw) -> Frame:
    """The view, by a render, or by ticks until nothing is left to do."""
    if draw.random() < 0.4:
        return run.renderer.render(run.camera)
    for _ in range(6000):
        view, progress = run.renderer.frame(run.camera, 0.02)
        if progress.done:
            return read(view, run.renderer.cache.read(), {"converged": progress.coverage == 1.0})
    raise AssertionError(f"no rest after {run.done}: {progress}")


def compare(run: Run, draw: Draw) -> None:
    """Come to rest, in ticks or at once, and see what a new renderer has there."""
    found, made = at_rest(run, draw), [fresh(run, 0), fresh(run, 1)]
    for name in EXACT:
        assert np.array_equal(getattr(found, name), getattr(made[0], name)), f"{name} differs after {run.done}"
    if not (found.stats["converged"] and made[0].stats["converged"]):  # how good a picture is then depends on the past
        assert run.settings.max_records == FEW, f"unfinished after {run.done}"
        run.counted["more records wanted than may be kept"] += 1
        return
    apart, seeds = off(found, made[0]), off(made[0], made[1])
    if apart > max(AS_SEEDS * seeds, LEAST):  # as records of the past may make it better: which is nearer to a finer picture?
        fine = fresh(run, 0, a=0.15, radius_max=2.0, max_records=20_000)
        made += [fresh(run, more) for more in range(2, SEEDS)]
        apart, seeds = off(found, fine), max(off(one, fine) for one in made)
        run.counted["judged by a finer one"] += 1
    run.off.append((apart, seeds))
    assert apart <= max(AS_SEEDS * seeds, LEAST), f"{apart:.3f} off, new renderers {seeds:.3f}: {run.settings} {run.done}"


@pytest.mark.slow
def test_calls_in_any_order(tmp_path: Path) -> None:
    draw = np.random.default_rng(SEED)
    scene = room()
    with Renderer(scene, SIZES[0], **BASE) as renderer:
        run = Run(renderer, tmp_path, scene, scene, renderer.settings, SIZES[0])
        for number in range(CALLS):
            call(run, draw)
            if number % 1000 == 999:
                print(f"{number + 1} calls", flush=True)
            if renderer.cache.count > MOST:
                renderer.forget()
                run.view = None
            if draw.random() < 1.0 / COMPARED or number == CALLS - 1:
                compare(run, draw)
                run.view = None
    apart, seeds = np.array(run.off).T
    print(f"\n{CALLS} calls: {dict(run.counted)}")
    ratio = apart[seeds > 0.0] / seeds[seeds > 0.0]
    for name, values in (("the renderer in use", apart), ("new ones", seeds), ("ratio", ratio)):
        if len(values):
            print(f"{name}: median {np.median(values):.4f}, worst {values.max():.4f} of {len(values)} pictures")
