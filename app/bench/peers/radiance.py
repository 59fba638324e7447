"""Radiance as a peer: a scene in its words, and irradiance at a view's points by rtrace with its ambient cache."""

from __future__ import annotations

import importlib.util
import math
import os
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from irrsplat.core.errors import IrrsplatError
from irrsplat.scene.model import Light, Mesh, Scene

LAMP = 0.002  # metres: the radius of the sphere that stands for a point light
SUN = 0.2  # degrees across: the disc that stands for a directional one
# ambient accuracy, divisions and super-samples (-aa, -ad, -as), from rough to fine
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
# every lamp is sampled once, at its middle; what is left to chance are the ambient rays, and none of those ends early
_EXACT = ("-ds", "0", "-dt", "0", "-dc", "1", "-dj", "0", "-dr", "0", "-ss", "0", "-lr", "64", "-lw", "1e-7")


def installed() -> Path | None:
    """Where pyradiance keeps its programs (bin) and their files (lib); None where it is not installed."""
    spec = importlib.util.find_spec("pyradiance")
    places = [] if spec is None else list(spec.submodule_search_locations or ())
    return Path(places[0]) if places else None


def text(scene: Scene) -> str:
    """The scene's description; its meshes lie beside it as mesh0.rtm and so on, and bring their places and normals with them.

    Raises IrrsplatError for a scene that Radiance has no words for.
    """
    parts = []
    for number, mesh in _meshes(scene):
        albedo, emission = mesh.material.albedo, mesh.material.emission
        if mesh.colors is not None:
            raise IrrsplatError("colours of vertices have no counterpart here")
        if max(emission) > 0.0 and max(albedo) > 0.0:
            raise IrrsplatError("a surface that both shines and reflects has no counterpart")
        words = f"glow paint{number} 0 0 4 {_row(*emission, 0)}"  # 0: met by ambient rays, never aimed at
        if not max(emission) > 0.0:
            words = f"plastic paint{number} 0 0 5 {_row(*albedo, 0, 0)}"
        parts.append(f"void {words}\npaint{number} mesh mesh{number} 1 mesh{number}.rtm 0 0\n")
    parts += [_lamp(light, number) for number, light in enumerate(scene.lights)]
    if max(scene.sky) > 0.0:
        parts.append(f"void glow sky 0 0 4 {_row(*scene.sky, 0)}\nsky source around 0 0 4 0 0 1 360\n")
    return "\n".join(parts)


def _meshes(scene: Scene) -> Iterator[tuple[int, Mesh]]:
    return ((number, mesh) for number, mesh in enumerate(scene.meshes) if len(mesh.faces))


def _lamp(light: Light, number: int) -> str:
    """A light: a small invisible sphere of radiance I/(π r²), or a small disc in the sky of radiance E/Ω."""
    colour, place = np.asarray(light.color, float), np.asarray(light.position, float)
    if light.directional:
        radiance = np.pi * colour / (2.0 * math.pi * (1.0 - math.cos(math.radians(SUN / 2.0))))
        return f"void light lamp{number} 0 0 3 {_row(*radiance)}\nlamp{number} source from{number} 0 0 4 {_row(*place, SUN)}\n"
    factor, numbers = _factor(light)
    radiance = colour / (np.pi * LAMP**2)
    shape = f"lamp{number} sphere bulb{number} 0 0 4 {_row(*place, LAMP)}\n"
    if not factor:
        return f"void illum lamp{number} 1 void 0 3 {_row(*radiance)}\n{shape}"
    pattern = f"void brightfunc look{number} 2 {factor} . 0 {len(numbers)} {_row(*numbers)}\n"
    return f"{pattern}look{number} illum lamp{number} 1 void 0 3 {_row(*radiance)}\n{shape}"


def _factor(light: Light) -> tuple[str, list[float]]:
    """What a light's strength is multiplied by on the way D to it, T metres long, and the numbers A1, A2, … in that."""
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


class Rtrace:
    """A scene compiled in an empty `folder`; seconds: what compiling took, by program. Raises IrrsplatError where that fails."""

    def __init__(self, scene: Scene, folder: Path, cpus: int) -> None:
        home = installed()
        if home is None:
            raise IrrsplatError("Radiance is not installed")
        self.home, self.folder, self.cpus = home, folder, cpus
        (folder / "scene.rad").write_text(text(scene), encoding="ascii")
        self.seconds = {"obj2mesh": 0.0, "oconv": 0.0}
        for number, mesh in _meshes(scene):
            _write_obj(folder / f"mesh{number}.obj", mesh)
            self.seconds["obj2mesh"] += self._run(["obj2mesh", f"mesh{number}.obj", f"mesh{number}.rtm"])[1]
        octree, self.seconds["oconv"] = self._run(["oconv", "scene.rad"])
        (folder / "scene.oct").write_bytes(octree)

    def _run(self, command: Sequence[str], rays: bytes = b"") -> tuple[bytes, float]:
        """What a program says to `rays`, and the seconds that it took."""
        program = self.home / "bin" / command[0]
        environment = os.environ | {"RAYPATH": os.pathsep.join((".", str(self.home / "lib")))}
        start = time.perf_counter()
        try:
            done = subprocess.run(
                [program, *command[1:]], input=rays, capture_output=True, cwd=self.folder, env=environment, check=False
            )
        except OSError as error:
            raise IrrsplatError(f"{command[0]}: {error.strerror or error}") from error
        seconds = time.perf_counter() - start
        if done.returncode:
            raise IrrsplatError(f"{command[0]}: {' '.join(done.stderr.decode('utf-8', 'replace').split())[:200]}")
        return done.stdout, seconds

    def irradiance(
        self, position: np.ndarray, normal: np.ndarray, bounces: int, quality: tuple[float, int, int] | None = None
    ) -> tuple[np.ndarray, float]:
        """(N, 3) irradiance, direct and of so many bounces, at points (N, 3) with their normals, and the seconds of the process.

        quality: as in QUALITIES; what was gathered before with the ambient file is read, and what is new added to it.
        """
        words: list[str] = []
        if quality is not None:
            accuracy, divisions, supersamples = (str(x) for x in quality)
            words = ["-aa", accuracy, "-ad", divisions, "-as", supersamples, "-af", "ambient"]
        rays = np.concatenate([position, normal], axis=1, dtype=np.float32).tobytes()
        command = ["rtrace", "-h", "-I", "-fff", "-n", str(self.cpus), "-ab", str(bounces), *_EXACT, *words, "scene.oct"]
        answer, seconds = self._run(command, rays)
        return np.frombuffer(answer, np.float32).reshape(-1, 3).astype(float), seconds

    def forget(self) -> None:
        """Without the ambient file."""
        (self.folder / "ambient").unlink(missing_ok=True)


def _write_obj(path: Path, mesh: Mesh) -> None:
    with open(path, "w", encoding="ascii") as file:
        np.savetxt(file, mesh.positions, fmt="v %.9g %.9g %.9g")
        np.savetxt(file, mesh.normals, fmt="vn %.9g %.9g %.9g")
        numbers = np.repeat(mesh.faces + 1, 2, axis=1)
        np.savetxt(file, numbers, fmt="f %d//%d %d//%d %d//%d")
