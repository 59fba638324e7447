"""Radiance as a peer: rtrace with an ambient file, filled in a first pass and read in a second."""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from irrsplat.app.bench.peers.judging import CPUS, Measurement, Series, check_plain, fastest_first
from irrsplat.app.bench.peers.table import Notify
from irrsplat.core.errors import IrrsplatError
from irrsplat.reference.timed_levels import ENOUGH, SECONDS, JudgedView
from irrsplat.reference.truth import vertices
from irrsplat.scene.io.text.scene_writer import obj_text
from irrsplat.scene.model import Light, Mesh, Scene
from irrsplat.settings import All

# Ambient accuracy, divisions and super-samples (-aa, -ad, -as), from coarse to fine
QUALITIES: tuple[tuple[float, int, int], ...] = (
    (0.3, 256, 64),
    (0.25, 512, 128),
    (0.2, 1024, 256),
    (0.3, 2048, 1024),
    (0.25, 2048, 1024),
    (0.2, 2048, 2048),
    (0.1, 4096, 1024),
    (0.07, 8192, 2048),
)
# One sample at the centre of every light; only ambient rays are random, and none ends early
_EXACT = ("-ds", "0", "-dt", "0", "-dc", "1", "-dj", "0", "-dr", "0", "-ss", "0", "-lr", "64", "-lw", "1e-7")
BULB = 0.002  # metres: radius of the sphere in place of a point light
SUN = 0.2  # degrees across: the disc in place of a directional light


def measure(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Yield two series: the pass that fills the ambient file, and a second pass."""
    first, second = views
    most = vertices(bounces)
    with tempfile.TemporaryDirectory(prefix="irrsplat-") as folder:
        notify("Radiance: compiling the scene")
        it = Rtrace(scene, Path(folder), CPUS)
        plain = [min((it.irradiance(v.position, v.normal, 0) for _ in range(2)), key=lambda found: found[1]) for v in views]
        prepared = ", ".join(f"{program} {seconds:.2f} s" for program, seconds in it.seconds.items())
        about = f"after {prepared}; {plain[0][1]:.2f} s of loading and direct light are taken off each pass; rtrace -n {CPUS}"
        once: list[Measurement] = []
        twice: list[Measurement] = []
        for quality in QUALITIES:
            (it.folder / "ambient").unlink(missing_ok=True)
            found: list[tuple[float, float]] = []
            for v, (direct, base) in ((first, plain[0]), (first, plain[0]), (second, plain[1])):
                notify(f"Radiance, -aa {quality[0]:g} -ad {quality[1]} -as {quality[2]}: pass {len(found) + 1}")
                E, seconds = it.irradiance(v.position, v.normal, most, quality)
                found.append((max(seconds - base, 1e-3), v.error(E - direct)))
            words = "-aa {:g} -ad {} -as {}".format(*quality)
            once.append(Measurement("Radiance, one pass", words, *found[0], *found[2]))
            twice.append(Measurement("Radiance, two passes", words, found[0][0] + found[1][0], found[1][1], *found[2]))
            if found[1][1] <= ENOUGH or found[0][0] >= SECONDS / 2.0:
                break
    yield Series(fastest_first(once), about, (226, 150, 90))
    yield Series(fastest_first(twice), about, (190, 70, 10))


def installed() -> Path | None:
    """Return pyradiance's folder of programs (bin) and files (lib); None if it is not installed."""
    spec = importlib.util.find_spec("pyradiance")
    places = [] if spec is None else list(spec.submodule_search_locations or ())
    return Path(places[0]) if places else None


class Rtrace:
    """Scene compiled in an empty `folder`; seconds: compile time by program. Raises IrrsplatError for a failure."""

    def __init__(self, scene: Scene, folder: Path, cpus: int) -> None:
        home = installed()
        if home is None:
            raise IrrsplatError("Radiance is not installed")
        self.home, self.folder, self.cpus = home, folder, cpus
        (folder / "scene.rad").write_text(text(scene), encoding="ascii")
        self.seconds = {"obj2mesh": 0.0, "oconv": 0.0}
        for number, mesh in meshes(scene):
            (folder / f"mesh{number}.obj").write_text(obj_text(mesh), encoding="ascii")
            self.seconds["obj2mesh"] += self._run(["obj2mesh", f"mesh{number}.obj", f"mesh{number}.rtm"])[1]
        octree, self.seconds["oconv"] = self._run(["oconv", "scene.rad"])
        (folder / "scene.oct").write_bytes(octree)

    def _run(self, command: Sequence[str], rays: bytes = b"") -> tuple[bytes, float]:
        """Return a program's output for `rays`, and its seconds of processor time."""
        program = self.home / "bin" / command[0]
        environment = os.environ | {"RAYPATH": os.pathsep.join((".", str(self.home / "lib")))}
        start = _processor_time()
        try:
            done = subprocess.run(
                [program, *command[1:]], input=rays, capture_output=True, cwd=self.folder, env=environment, check=False
            )
        except OSError as error:
            raise IrrsplatError(f"{command[0]}: {error.strerror or error}") from error
        seconds = _processor_time() - start
        if done.returncode:
            raise IrrsplatError(f"{command[0]}: {' '.join(done.stderr.decode('utf-8', 'replace').split())[:200]}")
        return done.stdout, seconds

    def irradiance(
        self, position: np.ndarray, normal: np.ndarray, bounces: int, quality: tuple[float, int, int] | None = None
    ) -> tuple[np.ndarray, float]:
        """Return irradiance (N, 3), direct and indirect, at points (N, 3) with normals, and its processor time.

        quality: an entry of QUALITIES; the ambient file is read and extended. None: no ambient file.
        """
        words: list[str] = []
        if quality is not None:
            accuracy, divisions, supersamples = (str(x) for x in quality)
            words = ["-aa", accuracy, "-ad", divisions, "-as", supersamples, "-af", "ambient"]
        rays = np.concatenate([position, normal], axis=1, dtype=np.float32).tobytes()
        command = ["rtrace", "-h", "-I", "-fff", "-n", str(self.cpus), "-ab", str(bounces), *_EXACT, *words, "scene.oct"]
        answer, seconds = self._run(command, rays)
        return np.frombuffer(answer, np.float32).reshape(-1, 3).astype(float), seconds


def _processor_time() -> float:
    """Return the processor time of all ended child processes, seconds."""
    now = os.times()
    return now.children_user + now.children_system


# ---- the scene in Radiance's format -----------------------------------------------------------------------------------


def text(scene: Scene) -> str:
    """Return the scene's description; it refers to mesh0.rtm and so on, with positions and normals.

    Raises IrrsplatError for a scene that Radiance cannot express.
    """
    check_plain(scene)
    parts = []
    for number, mesh in meshes(scene):
        albedo, emission = mesh.material.albedo, mesh.material.emission
        if max(emission) > 0.0 and max(albedo) > 0.0:
            raise IrrsplatError("a surface that both emits and reflects has no counterpart")
        words = f"glow paint{number} 0 0 4 {_row(*emission, 0)}"  # 0: hit by ambient rays, never sampled directly
        if not max(emission) > 0.0:
            words = f"plastic paint{number} 0 0 5 {_row(*albedo, 0, 0)}"
        parts.append(f"void {words}\npaint{number} mesh mesh{number} 1 mesh{number}.rtm 0 0\n")
    parts += [_light(light, number) for number, light in enumerate(scene.lights)]
    if max(scene.sky) > 0.0:
        parts.append(f"void glow sky 0 0 4 {_row(*scene.sky, 0)}\nsky source around 0 0 4 0 0 1 360\n")
    return "\n".join(parts)


def meshes(scene: Scene) -> Iterator[tuple[int, Mesh]]:
    """Return the meshes with faces, and their file numbers."""
    return ((number, mesh) for number, mesh in enumerate(scene.meshes) if len(mesh.faces))


def _light(light: Light, number: int) -> str:
    """Return a light: a small invisible sphere of radiance I/(π r²), or a small disc in the sky of radiance E/Ω."""
    colour, place = np.asarray(light.color, float), np.asarray(light.position, float)
    if light.directional:
        radiance = np.pi * colour / (2.0 * math.pi * (1.0 - math.cos(math.radians(SUN / 2.0))))
        return f"void light lamp{number} 0 0 3 {_row(*radiance)}\nlamp{number} source from{number} 0 0 4 {_row(*place, SUN)}\n"
    factor, numbers = _factor(light)
    radiance = colour / (np.pi * BULB**2)
    shape = f"lamp{number} sphere bulb{number} 0 0 4 {_row(*place, BULB)}\n"
    if not factor:
        return f"void illum lamp{number} 1 void 0 3 {_row(*radiance)}\n{shape}"
    pattern = f"void brightfunc look{number} 2 {factor} . 0 {len(numbers)} {_row(*numbers)}\n"
    return f"{pattern}look{number} illum lamp{number} 1 void 0 3 {_row(*radiance)}\n{shape}"


def _factor(light: Light) -> tuple[str, list[float]]:
    """Return the formula of a light's factor in direction D at distance T metres, and its arguments A1, A2, …."""
    factors: list[str] = []
    numbers: list[float] = []

    def number(value: float) -> str:
        numbers.append(value)
        return f"A{len(numbers)}"

    if not light.physical:
        constant, linear, quadratic = (number(k) for k in light.attenuation)
        factors.append(f"PI*T*T/({constant}+{linear}*T+{quadratic}*T*T)")
    if light.spot_target is not None and light.spot_cutoff not in (90.0, 180.0):
        axis = np.subtract(light.spot_target, light.position)
        x, y, z = (number(float(a)) for a in axis / np.linalg.norm(axis))
        cosine = f"bound(-1,-({x}*Dx+{y}*Dy+{z}*Dz),1)"
        inner = min(light.spot_inner, light.spot_cutoff - 1e-3)
        cutoff, width = number(light.spot_cutoff), number(light.spot_cutoff - inner)
        factors.append(f"bound(0,({cutoff}-acos({cosine})*180/PI)/{width},1)")
        if light.spot_exponent > 0.0:
            factors.append(f"bound(0,{cosine},1)^{number(light.spot_exponent)}")
    return "*".join(factors), numbers


def _row(*numbers: float) -> str:
    return " ".join(f"{float(x):.9g}" for x in numbers)
