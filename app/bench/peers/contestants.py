"""Who the benchmark sets beside each other: ours, Radiance and Mitsuba, each timed on the same points at rising quality."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from irrsplat.app.bench import cases, gather_truth
from irrsplat.app.bench.peers import radiance
from irrsplat.app.verify import error_curve
from irrsplat.core.errors import InputError, IrrsplatError
from irrsplat.indirect import paper_scan
from irrsplat.reference import fine_gather, worker
from irrsplat.reference.truth import NOTHING, in_words, vertices
from irrsplat.scene.model import Camera, Scene

ENOUGH = 0.03  # relative RMSE: nobody goes on beyond it
SECONDS = 120.0  # after which an entrant begins nothing finer
CPUS = max(1, os.cpu_count() or 1)  # for everybody: ours, rtrace -n and Mitsuba's threads
_POINTS = "from irrsplat.reference.trace_points import main; main()"

Tell = Callable[[str], object]


@dataclass(frozen=True)
class Point:
    """One measurement: what the `system` was set to, its seconds, and the relative RMSE of irradiance that it then has.

    further, further_rmse: the same of a further view of the scene with all that it has kept from the first; None: not known.
    """

    system: str
    quality: str
    seconds: float
    rmse: float
    further: float | None
    further_rmse: float | None


@dataclass(frozen=True)
class Entry:
    """All that is known of an entrant: its points, fewest seconds or samples first; in words what came before its clock began,
    or why it could not take part. anew: it keeps nothing, and its error goes with 1/√seconds."""

    points: tuple[Point, ...]
    about: str
    anew: bool = False


@dataclass(frozen=True)
class View:
    """What a camera sees: points (N, 3) with shading and geometric normals, the numbers (M,) of those at which irradiance is
    judged, and the truth there (M, 3) in W/m²; its pixels as `exact.Truth` has them."""

    camera: Camera
    position: np.ndarray
    normal: np.ndarray
    geometric: np.ndarray
    judged: np.ndarray
    truth: fine_gather.Truth

    def error(self, E: np.ndarray) -> float:
        """The relative RMSE of irradiance (N, 3) at all points."""
        off = E[self.judged] - self.truth.irradiance
        return float(np.sqrt(np.mean(off**2)) / self.truth.irradiance.mean(dtype=float))


def view(renderer: Any, camera: Camera) -> View:
    """What `camera` sees, and its truth; raises InputError where there is none."""
    truth = gather_truth.truth(renderer, camera)
    if truth is None or not truth.irradiance.any():
        bounces = renderer.settings.bounces
        if bounces == 1:
            raise InputError(NOTHING if truth is None else "no indirect light reaches the view, so there is nothing to compare")
        size = "{} {}".format(*renderer.size)
        raise InputError(
            f"there is no truth of {in_words(bounces)}; run first: irrsplat verify SCENE --size {size} --bounces {bounces}"
        )
    shown, _ = renderer.frame(camera, gather=False)
    with renderer.ctx:
        seen = paper_scan.read_back(shown.gbuffer)
    numbers = np.cumsum(seen.mask.ravel()).reshape(seen.mask.shape) - 1
    position, normal, geometric = (array[seen.mask] for array in (seen.position, seen.normal, seen.geometric))
    return View(camera, position, normal, geometric, numbers[tuple(truth.pixels.T)], truth)


def ours(scene: Scene, size: tuple[int, int], bounces: int | str, views: Sequence[View], tell: Tell) -> Entry:
    """irrsplat, with the settings of `verify --curve`: from an empty cache, then the further view with the records kept."""
    import irrsplat

    points: list[Point] = []
    for values in error_curve.points("default", {"bounces": bounces}):
        with irrsplat.Renderer(scene, size=size, **values) as renderer:
            tell(f"irrsplat, a {values['a']:.3g}")
            cases.warm_up(renderer, views[0].camera)
            empty = cases.middle(cases.from_records(renderer, views[0].camera, 0))
            rmse = views[0].truth.error(renderer.render(views[0].camera).irradiance)
            further = cases.middle(cases.from_records(renderer, views[1].camera, empty.records))
            again = views[1].truth.error(renderer.render(views[1].camera).irradiance)
            about = f"from the loaded scene and compiled shaders, on {renderer.about['renderer']}"
        assert rmse is not None
        quality = f"a {values['a']:.3g}, {empty.records} records"
        points.append(Point("irrsplat", quality, empty.seconds, rmse, further.seconds, again))
        if rmse <= ENOUGH / 2.0 or empty.seconds >= SECONDS:
            break
    return Entry(_by_time(points), about)


def rtrace(scene: Scene, bounces: int | str, views: Sequence[View], tell: Tell) -> Iterator[Entry]:
    """Radiance's rtrace with an ambient file: what the pass that fills it says, and what a second one does."""
    first, second = views
    most = vertices(bounces)
    with tempfile.TemporaryDirectory(prefix="irrsplat-") as folder:
        tell("Radiance: compiling the scene")
        it = radiance.Rtrace(scene, Path(folder), CPUS)
        plain = [min((it.irradiance(v.position, v.normal, 0) for _ in range(2)), key=lambda found: found[1]) for v in views]
        prepared = ", ".join(f"{program} {seconds:.2f} s" for program, seconds in it.seconds.items())
        about = f"after {prepared}; {plain[0][1]:.2f} s of loading and direct light are taken off each pass; rtrace -n {CPUS}"
        once: list[Point] = []
        twice: list[Point] = []
        for quality in radiance.QUALITIES:
            it.forget()
            found: list[tuple[float, float]] = []
            for v, (direct, base) in ((first, plain[0]), (first, plain[0]), (second, plain[1])):
                tell(f"Radiance, -aa {quality[0]:g} -ad {quality[1]} -as {quality[2]}: pass {len(found) + 1}")
                E, seconds = it.irradiance(v.position, v.normal, most, quality)
                found.append((max(seconds - base, 1e-3), v.error(E - direct)))
            words = "-aa {:g} -ad {} -as {}".format(*quality)
            once.append(Point("Radiance, one pass", words, *found[0], *found[2]))
            twice.append(Point("Radiance, two passes", words, found[0][0] + found[1][0], found[1][1], *found[2]))
            if found[1][1] <= ENOUGH or found[0][0] >= SECONDS / 2.0:
                break
    yield Entry(_by_time(once), about)
    yield Entry(_by_time(twice), about)


def mitsuba(scene: Scene, bounces: int | str, views: Sequence[View], method: str, tell: Tell) -> Entry:
    """Mitsuba's path tracer, or Tracer's with Mitsuba's intersections: of a further view it keeps nothing."""
    name = {"path": "Mitsuba", "joined": "Mitsuba, lamps joined"}[method]
    tell(name)
    v = views[0]
    arguments = (
        scene, (v.position, v.normal, v.geometric), v.judged, v.truth.irradiance.astype(float), method, vertices(bounces),
        ENOUGH, SECONDS / 4.0,
    )  # fmt: skip
    found = worker.call(_POINTS, arguments)
    points = [
        Point(name, f"{count} samples", seconds, rmse, seconds, rmse) for count, seconds, rmse in found["levels"] if seconds > 0.0
    ]
    return Entry(tuple(points), f"after {found['load']:.2f} s of loading, compiled; {found['threads']} threads", anew=True)


def all_of(scene: Scene, size: tuple[int, int], bounces: int | str, views: Sequence[View], tell: Tell) -> Iterator[Entry]:
    """Every entrant; one that cannot take part has no points, and says why."""
    yield ours(scene, size, bounces, views, tell)
    made: list[tuple[str, Callable[[], Iterator[Entry]]]] = [
        ("Radiance", lambda: rtrace(scene, bounces, views, tell)),
        ("Mitsuba", lambda: iter([mitsuba(scene, bounces, views, "path", tell)])),
        ("Mitsuba, lamps joined", lambda: iter([mitsuba(scene, bounces, views, "joined", tell)])),
    ]
    for name, make in made:
        try:
            yield from make()
        except IrrsplatError as error:
            yield Entry((), f"{name}: {error}")


def _by_time(points: Sequence[Point]) -> tuple[Point, ...]:
    return tuple(sorted(points, key=lambda point: point.seconds))
