"""Radiance as a peer: rtrace with an ambient file, filled in a first pass and read in a second."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from irrsplat.app.bench.peers.judging import CPUS, Measurement, Series, fastest_first
from irrsplat.app.bench.peers.radiance_scene import meshes, text
from irrsplat.app.bench.peers.table import Notify
from irrsplat.core.errors import IrrsplatError
from irrsplat.reference.timed_levels import ENOUGH, SECONDS, JudgedView
from irrsplat.reference.truth import vertices
from irrsplat.scene.io.text.scene_writer import obj_text
from irrsplat.scene.model import Scene
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
            it.forget()
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

    def forget(self) -> None:
        """Delete the ambient file."""
        (self.folder / "ambient").unlink(missing_ok=True)


def _processor_time() -> float:
    """Return the processor time of all ended child processes, seconds."""
    now = os.times()
    return now.children_user + now.children_system
