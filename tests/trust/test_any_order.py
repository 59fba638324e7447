"""Whatever is called, in whatever order: a change is applied whole or not at all, and at rest the picture is a fresh renderer's.

Calls are drawn at random: frames, renders, lights, moves, paint, settings, sizes, caches, calls that have to be refused, and
Ctrl-C in the middle of any of them. The scene that they make is kept beside, by value. Now and then the refined view is compared
with new renderers of that scene. Buffers without a part of records are equal bit for bit. Irradiance differs by at most AS_SEEDS
times the difference of two of them with other seeds, or is as near to a finer picture as theirs.

IRRSPLAT_CALLS: how many calls (60). IRRSPLAT_SEED: which ones (1). With -s, the pictures that were compared are summed up.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat import Frame, InputError, Renderer
from irrsplat.image.view import View, read
from irrsplat.scene.model import Camera, Light, Material, Scene
from irrsplat.scene.motion import moved
from tests.renderer.test_renderer import FAST, FRONT, room
from tests.support.interrupts import run as run_lines
from tests.support.worlds import lamp

CALLS = int(os.environ.get("IRRSPLAT_CALLS", "60"))
SEED = int(os.environ.get("IRRSPLAT_SEED", "1"))
COMPARED = 40 if CALLS < 1000 else 100  # calls, after about so many a picture is compared
FEW = 600  # records that may be kept, where these are not enough for some views
MOST = 1500  # records, above which they are forgotten, so that the calls stay quick
SIZES = (36, 30), (48, 24)
CAMERAS = FRONT, Camera((-0.8, 0.7, 0.9), (0.3, -0.5, -0.6), fov=60.0), Camera((0.7, -0.5, 0.9), (-0.6, 0.0, -1.0), fov=70.0)
BASE: dict[str, Any] = {**FAST, "gather": "trace", "gather_size": 24, "a": 0.5}
SETTINGS: dict[str, tuple[Any, ...]] = {
    "a": (0.4, 0.5), "bounces": (0, 1, 1, 2, 2, "all"), "gather": ("trace", "embree"), "gather_size": (24, 32),
    "gradients": (False, True), "kernel": ("cut", "smooth"), "blend": (0.3, 0.5), "shadow_size": (64, 96), "seed": (0, 1),
    "fade": (False, True), "radius_max": (7.0, 12.0), "second_order": (False, True), "backdrop": ("sky", "grey"),
    "max_records": (FEW, 4000, 4000, 4000),
}  # fmt: skip
EXACT = "position", "normal", "albedo", "depth", "direct", "emission"
AS_SEEDS = 1.5  # times as much as two seeds do may a picture differ from a new renderer's
SEEDS = 24  # that are tried before a picture counts as wrong: one of eight may miss a strip of light that is a pixel wide
DARK = 1e-3  # W/m²: a mean that is less counts as this
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

    def check(self) -> None:
        """The renderer is of what it has to be."""
        there = self.renderer
        assert _same(there.scene, self.scene), f"another scene after {self.done}"
        assert there.settings == self.settings and there.size == self.size, f"other settings after {self.done}"


# ---- calls: each is returned with the Run's values as they have to be once it is done ---------------------------------------

Call = tuple[Callable[[], object], dict[str, Any]]


def vector(draw: Draw, low: float, high: float) -> tuple[float, float, float]:
    x, y, z = draw.uniform(low, high, 3).tolist()
    return x, y, z


def look(name: str, run: Run, draw: Draw) -> Call:
    """A call that changes nothing that the scene has to be."""
    renderer, view, some = run.renderer, run.view, bool(draw.random() < 0.5)
    run.view = None
    if name == "turn":
        run.camera = CAMERAS[draw.integers(len(CAMERAS))]
    if name in ("frame", "turn"):
        seconds, gather = [None, 1e-4, 0.01, 0.1][draw.integers(4)], bool(draw.random() < 0.85)

        def frame() -> None:
            run.view = renderer.frame(run.camera, seconds, gather)[0]

        return frame, {}
    if name == "accumulate" and view:  # the view that the last call gave
        samples = int(draw.integers(1, 6))
        return lambda: renderer.accumulate(view, samples, None if some else 1e-4), {}
    if name == "save":
        run.saved += 1
        return lambda: renderer.save_cache(run.folder / f"{run.saved % 3}.cache"), {}
    if name == "load":  # refused where it is of another scene or other settings
        file = run.folder / f"{draw.integers(3)}.cache"

        def load() -> None:
            try:
                renderer.load_cache(file)
            except InputError as error:
                assert "record cache was made" in str(error) or "there is no such file" in str(error)

        return load, {}
    others: dict[str, Callable[[], object]] = {
        "render": lambda: renderer.render(run.camera),
        "refine": lambda: renderer.refine(run.camera, 0.05, 0.01),
        "renew": renderer.renew,
    }
    return others.get(name, lambda: renderer.forget(False, some)), {}


def relit(lights: list[Light], draw: Draw) -> list[Light]:
    """Dim, carry, add and take away lamps."""
    what, number = draw.integers(5), int(draw.integers(len(lights) or 1))
    if what == 0:
        by = float(draw.choice([0.0, 0.5, 2.0, 1.3]))
        return [replace(light, color=tuple(max(by * c, 0.2) for c in light.color)) for light in lights]  # type: ignore[arg-type]
    if what == 1 and lights:
        lights[number] = replace(lights[number], color=vector(draw, 0.5, 4.0))
    elif what == 2 and lights and not lights[number].directional:
        lights[number] = replace(lights[number], position=vector(draw, -0.8, 0.8))
    elif what == 3 and len(lights) < 3:
        sun = Light((*vector(draw, -0.3, 0.3)[:2], 1.0), (1.0, 1.0, 0.8), directional=True)
        spot = lamp(vector(draw, -0.7, 0.7), 2.0, spot_target=vector(draw, -1, 1), spot_cutoff=40.0)
        lights.append([sun, spot, lamp(vector(draw, -0.8, 0.8), 2.0)][draw.integers(3)])
    elif len(lights) > 1:
        del lights[number]
    return lights


def change(name: str, run: Run, draw: Draw) -> Call:
    renderer, scene = run.renderer, run.scene
    if name == "relight":
        lights = relit(list(scene.lights), draw)
        return lambda: renderer.relight(lights), {"scene": replace(scene, lights=tuple(lights))}
    if name == "move":  # the box, from where it was loaded; by a mirror, too; tests/renderer/test_move.py judges the arithmetic
        matrix = np.diag([-1.0 if draw.random() < 0.2 else 1.0, 1.0, 1.0, 1.0])
        matrix[:3, 3] = draw.uniform(-0.3, 0.3, 3)
        return lambda: renderer.move(1, matrix), {"scene": moved(scene, run.loaded.meshes, 1, matrix)}
    if name == "repaint":
        number, emission = int(draw.integers(3)), vector(draw, 0.1, 1.0) if draw.random() < 0.3 else (0.0, 0.0, 0.0)
        material, meshes = Material(vector(draw, 0.1, 0.9), emission), list(scene.meshes)
        meshes[number] = replace(meshes[number], material=material)
        return lambda: renderer.repaint(number, material), {"scene": replace(scene, meshes=tuple(meshes))}
    if name == "change":  # up to three settings at once
        names = draw.choice(list(SETTINGS), int(draw.integers(1, 4)), replace=False).tolist()
        settings = replace(run.settings, **{name: SETTINGS[name][draw.integers(len(SETTINGS[name]))] for name in names})
        return lambda: renderer.change(settings), {"settings": settings}
    if name == "resize":
        size = SIZES[draw.integers(len(SIZES))]
        return lambda: renderer.resize(size), {"size": size}
    power = float(draw.choice([0.0, 0.5]))
    return lambda: renderer.carry_headlamp(power), {"headlamp": power}


def refused(name: str, run: Run, draw: Draw) -> Call:
    renderer = run.renderer
    calls: list[Callable[[], object]] = [
        lambda: renderer.relight([lamp((0.0, 0.5, 0.0))] * 1000),
        lambda: renderer.move(1, np.zeros((4, 4))),
        lambda: renderer.repaint("nobody", Material()),
        lambda: renderer.resize((0, 5)),
        lambda: renderer.resize((10**6, 10**6)),
        lambda: renderer.load_cache(run.folder),
    ]
    return calls[draw.integers(len(calls))], {}


# ---- in order --------------------------------------------------------------------------------------------------------------

KINDS = (  # how often each is drawn, and its calls; those that come more often stand there several times
    (0.45, change, "relight relight relight move move repaint change change change change resize carry"),
    (0.5, look, "frame frame frame frame turn render refine accumulate forget renew save load"),
    (0.05, refused, "refused"),
)


def call(run: Run, draw: Draw) -> None:
    """Make one call, and see that it is applied, or refused, whole."""
    _, kind, names = KINDS[draw.choice(3, p=[often for often, _, _ in KINDS])]
    name = str(draw.choice(names.split()))
    act, values = kind(name, run, draw)
    run.done = [*run.done[-60:], name]
    applied = True
    if kind is refused:
        with pytest.raises(InputError):
            act()
    elif draw.random() < 0.05:
        run.done[-1] += " interrupted"
        if run_lines(act, int(np.exp(draw.uniform(0.0, 9.0))))[1]:
            run.view = None  # and what differs now is applied, and whole: `check` sees to that
            applied = not all(_same(getattr(run.renderer, one), getattr(run, one)) for one in values)
    else:
        act()
    if applied:
        for one, value in values.items():
            setattr(run, one, value)
    if kind is change:
        run.view = None
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
        return
    apart, seeds = off(found, made[0]), off(made[0], made[1])
    if apart > max(AS_SEEDS * seeds, LEAST):  # as records of the past may make it better: which is nearer to a finer picture?
        fine = fresh(run, 0, a=0.15, radius_max=2.0, max_records=20_000)
        made += [fresh(run, more) for more in range(2, SEEDS)]
        apart, seeds = off(found, fine), max(off(one, fine) for one in made)
    run.off.append((apart, seeds))
    assert apart <= max(AS_SEEDS * seeds, LEAST), f"{apart:.3f} off, new renderers {seeds:.3f}: {run.settings} {run.done}"


@pytest.mark.parametrize(("calls", "seed"), [(15, 3), pytest.param(CALLS, SEED, marks=pytest.mark.long)])
def test_calls_in_any_order(calls: int, seed: int, tmp_path: Path) -> None:
    draw = np.random.default_rng(seed)
    scene = room()
    with Renderer(scene, SIZES[0], **BASE) as renderer:
        run = Run(renderer, tmp_path, scene, scene, renderer.settings, SIZES[0])
        for number in range(calls):
            call(run, draw)
            if renderer.cache.count > MOST:
                renderer.forget()
                run.view = None
            if draw.random() < 1.0 / COMPARED or number == calls - 1:
                compare(run, draw)
                run.view = None
    apart, seeds = np.array(run.off).T
    ratio = float(np.median(apart[seeds > 0.0] / seeds[seeds > 0.0]))
    print(f"\n{calls} calls; {len(apart)} pictures, {ratio:.2f} times as far apart as seeds, in the median")
