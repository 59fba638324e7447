"""Calls in any order: a change applies completely or not at all, and the converged picture is a fresh renderer's.

Calls are random: frames, renders, lights, moves, materials, settings, sizes, caches, invalid calls, and Ctrl-C during any
of them. The expected scene is tracked by value. At intervals the refined view is compared with new renderers of that scene.
Buffers without records are equal bit for bit. Irradiance differs by at most AS_SEEDS times the difference of two other
seeds, or is as near to a finer picture as theirs.

IRRSPLAT_CALLS: number of calls (60). IRRSPLAT_SEED: their seed (1). With -s, a summary of the compared pictures is printed.
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
from tests.support.worlds import point_light

CALLS = int(os.environ.get("IRRSPLAT_CALLS", "60"))
SEED = int(os.environ.get("IRRSPLAT_SEED", "1"))
COMPARED = 40 if CALLS < 1000 else 100  # calls between two comparisons, about
FEW = 600  # limit of records, too low for some views
MOST = 1500  # records above which they are discarded, for quick calls
SIZES = (36, 30), (48, 24)
CAMERAS = FRONT, Camera((-0.8, 0.7, 0.9), (0.3, -0.5, -0.6), fov=60.0), Camera((0.7, -0.5, 0.9), (-0.6, 0.0, -1.0), fov=70.0)
BASE: dict[str, Any] = {**FAST, "gather": "trace", "gather_size": 24, "a": 0.5}
SETTINGS: dict[str, tuple[Any, ...]] = {
    "a": (0.4, 0.5), "bounces": (0, 1, 1, 2, 2, "all"), "gather": ("trace", "embree"), "gather_size": (24, 32),
    "gradients": (False, True), "weights": ("hessian", "paper"), "blend": (0.3, 0.5), "shadow_size": (64, 96), "seed": (0, 1),
    "radius_max": (7.0, 12.0), "backdrop": ("sky", "grey"),
    "max_records": (FEW, 4000, 4000, 4000),
}  # fmt: skip
EXACT = "position", "normal", "albedo", "depth", "direct", "emission"
AS_SEEDS = 1.5  # allowed difference from a new renderer, in differences of two seeds
SEEDS = 24  # seeds for the comparison with a finer picture: one in eight may miss a strip of light one pixel wide
DARK = 1e-3  # W/m²: lower bound for a mean
LEAST = 0.02  # of the mean: smaller differences are not checked

Draw = np.random.Generator


@dataclass
class Run:
    """Renderer in use, and the expected scene, settings and size."""

    renderer: Renderer
    folder: Path
    loaded: Scene
    scene: Scene
    settings: Any
    size: tuple[int, int]
    camera: Camera = FRONT
    view: View | None = None
    saved: int = 0
    done: list[str] = field(default_factory=list)
    off: list[tuple[float, float]] = field(default_factory=list)  # RMS differences: of each picture, of two seeds for its view

    def check(self) -> None:
        """Assert that the renderer has the expected state."""
        there = self.renderer
        assert _same(there.scene, self.scene), f"another scene after {self.done}"
        assert there.settings == self.settings and there.size == self.size, f"other settings after {self.done}"


# ---- calls: each is returned with the expected values of the Run after it ---------------------------------------------------

Call = tuple[Callable[[], object], dict[str, Any]]


def vector(draw: Draw, low: float, high: float) -> tuple[float, float, float]:
    x, y, z = draw.uniform(low, high, 3).tolist()
    return x, y, z


def look(name: str, run: Run, draw: Draw) -> Call:
    """Return a call that does not change the expected scene."""
    renderer, view, some = run.renderer, run.view, bool(draw.random() < 0.5)
    run.view = None
    if name == "turn":
        run.camera = CAMERAS[draw.integers(len(CAMERAS))]
    if name in ("frame", "turn"):
        seconds, gather = [None, 1e-4, 0.01, 0.1][draw.integers(4)], bool(draw.random() < 0.85)

        def frame() -> None:
            run.view = renderer.frame(run.camera, seconds, gather)[0]

        return frame, {}
    if name == "accumulate" and view:  # the view of the last call
        samples = int(draw.integers(1, 6))
        return lambda: renderer.accumulate(view, samples, None if some else 1e-4), {}
    if name == "save":
        run.saved += 1
        return lambda: renderer.save_cache(run.folder / f"{run.saved % 3}.cache"), {}
    if name == "load":  # refused for another scene or other settings
        file = run.folder / f"{draw.integers(3)}.cache"

        def load() -> None:
            try:
                renderer.load_cache(file)
            except InputError as error:
                assert "record cache was made" in str(error) or "there is no such file" in str(error)

        return load, {}

    def renew() -> None:
        renderer.forget(records=False)
        renderer.scheduler.expire()

    others: dict[str, Callable[[], object]] = {
        "render": lambda: renderer.render(run.camera),
        "refine": lambda: renderer.refine(run.camera, 0.05, 0.01),
        "renew": renew,
    }
    return others.get(name, lambda: renderer.forget(False, some)), {}


def relit(lights: list[Light], draw: Draw) -> list[Light]:
    """Dim, move, add or remove lights."""
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
        spot = point_light(vector(draw, -0.7, 0.7), 2.0, spot_target=vector(draw, -1, 1), spot_cutoff=40.0)
        lights.append([sun, spot, point_light(vector(draw, -0.8, 0.8), 2.0)][draw.integers(3)])
    elif len(lights) > 1:
        del lights[number]
    return lights


def change(name: str, run: Run, draw: Draw) -> Call:
    renderer, scene = run.renderer, run.scene
    if name == "relight":
        lights = relit(list(scene.lights), draw)
        return lambda: renderer.relight(lights), {"scene": replace(scene, lights=tuple(lights))}
    if name == "move":  # the box, from its loaded place, also mirrored; tests/renderer/test_move.py checks the arithmetic
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
    size = SIZES[draw.integers(len(SIZES))]
    return lambda: renderer.resize(size), {"size": size}


def refused(name: str, run: Run, draw: Draw) -> Call:
    renderer = run.renderer
    calls: list[Callable[[], object]] = [
        lambda: renderer.relight([point_light((0.0, 0.5, 0.0))] * 1000),
        lambda: renderer.move(1, np.zeros((4, 4))),
        lambda: renderer.repaint("nobody", Material()),
        lambda: renderer.resize((0, 5)),
        lambda: renderer.resize((10**6, 10**6)),
        lambda: renderer.load_cache(run.folder),
    ]
    return calls[draw.integers(len(calls))], {}


# ---- in order --------------------------------------------------------------------------------------------------------------

KINDS = (  # probability of each kind, and its calls; frequent ones are repeated
    (0.45, change, "relight relight relight move move repaint change change change change resize"),
    (0.5, look, "frame frame frame frame turn render refine accumulate forget renew save load"),
    (0.05, refused, "refused"),
)


def call(run: Run, draw: Draw) -> None:
    """Make one call; assert that it is applied or refused completely."""
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
            run.view = None  # later differences are applied completely: `check` tests that
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
    """Render the expected scene with a new renderer, with its seed raised by `more`; return the frame.

    For more > 0 it renders another view first, so that its records lie elsewhere too. settings: other changed settings.
    """
    with Renderer(run.scene, run.size) as made:
        made.change(replace(run.settings, **{"seed": run.settings.seed + more, **settings}))
        if more:
            made.render(CAMERAS[more % len(CAMERAS)])
        return made.render(run.camera)


def off(one: Frame, other: Frame) -> float:
    """Return the RMS difference of two pictures' irradiance, relative to its mean."""
    mean = max(float(other.irradiance.mean()), DARK)
    return float(np.sqrt(((one.irradiance - other.irradiance) ** 2).mean())) / mean


def converged_view(run: Run, draw: Draw) -> Frame:
    """Return the converged view, by a render, or by limited frames."""
    if draw.random() < 0.4:
        return run.renderer.render(run.camera)
    for _ in range(6000):
        view, progress = run.renderer.frame(run.camera, 0.02)
        if progress.done:
            return read(view, run.renderer.cache.read(), {"converged": progress.coverage == 1.0})
    raise AssertionError(f"not converged after {run.done}: {progress}")


def compare(run: Run, draw: Draw) -> None:
    """Converge, in limited frames or at once, and compare with new renderers."""
    found, made = converged_view(run, draw), [fresh(run, 0), fresh(run, 1)]
    for name in EXACT:
        assert np.array_equal(getattr(found, name), getattr(made[0], name)), f"{name} differs after {run.done}"
    if not (found.stats["converged"] and made[0].stats["converged"]):  # the quality then depends on earlier calls
        assert run.settings.max_records == FEW, f"unfinished after {run.done}"
        return
    apart, seeds = off(found, made[0]), off(made[0], made[1])
    if apart > max(AS_SEEDS * seeds, LEAST):  # older records can improve it: compare both with a finer picture
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
