"""Independence of pictures from the OpenGL implementation: versions, vector widths, threads and other Mesa drivers.

Each case renders scenes in a separate process. Its pictures must equal the plain machine's byte for byte, or within a share
for drivers with other rounding. IRRSPLAT_RUNS=full: six scenes, else one.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from irrsplat.gpu import context
from tests.support.worlds import shared

ROOT = Path(__file__).resolve().parents[3]
LAVAPIPE = sorted(Path("/usr/share/vulkan/icd.d").glob("lvp_icd*.json"))
FULL = os.environ.get("IRRSPLAT_RUNS") == "full"
SCENES = ("cornell", "cornell-paper", "curved", "door", "furnace", "atrium") if FULL else ("cornell",)
LINKING = ("tests/gpu/test_programs.py", "tests/gpu/test_self_test.py", "tests/app/viewer/test_buffer_view.py")
OTHER_DRIVER = 0.01  # allowed difference of the mean, relative; other rounding places records differently
PIXEL = 0.09  # allowed RMS over pixels of equal surfaces, relative to the mean; records of so few rays are noisy
EDGES = 0.02  # share of the pixels that may show another surface: edge pixels depend on rounding

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif("Mesa" not in context.describe(shared())["version"], reason="Mesa's environment variables"),
]


@dataclass(frozen=True)
class Case:
    """Tested machine.

    env: Mesa's environment for it. same: True if pictures must equal the plain machine's byte for byte. driver: part of the
    renderer's name that identifies the machine; without it, the case is skipped.
    """

    name: str
    env: dict[str, str] = field(default_factory=dict)
    same: bool = True
    driver: str = ""


def _version(version: str) -> Case:
    glsl = version.replace(".", "") + "0"
    return Case(f"OpenGL {version}", {"MESA_GL_VERSION_OVERRIDE": version, "MESA_GLSL_VERSION_OVERRIDE": glsl})


def _width(bits: str, again: str = "") -> Case:
    return Case(f"{bits}-bit vectors{again}", {"LP_NATIVE_VECTOR_WIDTH": bits}, same=False, driver=f"{bits} bits")


# Mesa's shader cache confuses vector widths; these cases therefore share it with all cases before (see gpu.context.prepare).
CASES = (
    Case("plain again"),
    *map(_version, ("3.3", "4.1", "4.5")),
    _width("256"),
    _width("128"),
    _width("256", " after 128"),
    Case("CPU without AVX", {"GALLIUM_OVERRIDE_CPU_CAPS": "sse4.1"}, same=False, driver="128 bits"),
    Case("1 thread", {"LP_NUM_THREADS": "1"}),
    Case("2 threads", {"LP_NUM_THREADS": "2"}),
    Case("softpipe", {"GALLIUM_DRIVER": "softpipe"}, same=False, driver="softpipe"),
    Case("zink over lavapipe", {"GALLIUM_DRIVER": "zink", "LIBGL_ALWAYS_SOFTWARE": "1"}, same=False, driver="zink"),
)

DRAW = """
import sys, numpy, irrsplat
from irrsplat.gpu import context
with context.create() as ctx:
    found = {"driver": numpy.array(context.describe(ctx)["renderer"])}
for scene in sys.argv[2:]:
    for gather in ("plane", "trace"):
        frame = irrsplat.render(irrsplat.load(scene), (48, 48), gather=gather, bounces=1, gather_size=16, shadow_size=64)
        for name in ("image", "irradiance", "depth", "albedo", "records_position", "records_irradiance"):
            found[f"{scene} {gather} {name}"] = getattr(frame, name)
numpy.savez(sys.argv[1], **found)
"""


def run(code: str, arguments: list[str], env: dict[str, str]) -> str:
    """Return a process's output; `env` has its only Mesa variables."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("LP_", "MESA_", "GALLIUM_"))}
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, cwd=ROOT, env=inherited | env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"status {done.returncode}: {done.stderr[-3000:]}"
    return done.stdout


def drawn(folder: Path, case: Case) -> dict[str, Any]:
    """Return the pictures of a machine with its shader cache in `folder`."""
    out = folder / f"{case.name}.npz"
    if not out.exists():
        env = {"MESA_SHADER_CACHE_DIR": str(folder / "shaders"), "XDG_RUNTIME_DIR": str(folder), **case.env}
        run(DRAW, [str(out), *SCENES], env | ({"VK_ICD_FILENAMES": str(LAVAPIPE[0])} if LAVAPIPE else {}))
    with np.load(out) as file:
        return dict(file)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the pictures and of Mesa's shader cache."""
    return tmp_path_factory.mktemp("machines")


def wrong(case: Case, one: dict[str, Any], two: dict[str, Any]) -> list[str]:
    """Return the names of pictures that differ from the plain machine's."""
    pictures = [name for name in one if name != "driver"]
    if case.same:
        return [name for name in pictures if one[name].tobytes() != two[name].tobytes()]
    found = []
    for name in (name for name in pictures if name.endswith((" image", " irradiance", " albedo"))):
        a, b, albedo = one[name].astype(float), two[name].astype(float), f"{name.rsplit(' ', 1)[0]} albedo"
        same = np.abs(one[albedo] - two[albedo]).max(-1) < 0.01
        apart, pixels = abs(b.mean() / a.mean() - 1.0), np.sqrt(((a - b)[same] ** 2).mean()) / a.mean()
        if apart > OTHER_DRIVER or pixels > PIXEL or same.mean() < 1.0 - EDGES:
            found.append(f"{name}: mean {apart:.2%} apart, pixels {pixels:.2%} RMS but for {1.0 - same.mean():.2%} at edges")
    return found


@pytest.mark.parametrize("case", CASES if FULL else (CASES[1], CASES[5]), ids=lambda case: case.name)
def test_pictures_do_not_depend_on_the_machine(case: Case, folder: Path) -> None:
    if case.driver == "zink" and not LAVAPIPE:
        pytest.skip("Mesa's lavapipe is not installed (mesa-vulkan-drivers)")
    plain, other = drawn(folder, Case("plain")), drawn(folder, case)
    if case.driver not in str(other["driver"]):
        pytest.skip(f"the driver is {other['driver']}")
    assert wrong(case, plain, other) == []


LISTEN = """
import ctypes, sys, irrsplat
from irrsplat.gpu import context
faults = []
KINDS = {0x824C: "error", 0x824D: "deprecated", 0x824E: "undefined", 0x824F: "not portable"}  # KHR_debug's
def hear(source, kind, number, severity, length, text, _):
    if kind in KINDS:
        faults.append(f"{KINDS[kind]}: {text.decode(errors='replace').strip()}")
callback = ctypes.CFUNCTYPE(None, *[ctypes.c_uint] * 4, ctypes.c_int, ctypes.c_char_p, ctypes.c_void_p)(hear)
address = ctypes.CDLL("libEGL.so.1").eglGetProcAddress
address.restype, address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
def attach(ctx):
    set_callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(address(b"glDebugMessageCallback"))
    set_callback(ctypes.cast(callback, ctypes.c_void_p), None)
    ctx.enable_direct(0x92E0)  # GL_DEBUG_OUTPUT
    ctx.enable_direct(0x8242)  # GL_DEBUG_OUTPUT_SYNCHRONOUS
for scene in sys.argv[1:]:
    for gather in ("plane", "trace"):
        settings = dict(gather=gather, samples=2, bounces=1, gather_size=16, shadow_size=64)
        with irrsplat.Renderer(irrsplat.load(scene), (16, 16), **settings) as renderer:
            attach(renderer.ctx)
            renderer.render()
            renderer.relight(renderer.scene.lights[:1])
            renderer.resize((8, 16))
            renderer.render()
print(*faults, sep="\\n")
with context.create() as ctx:  # so that silence is known to mean something
    attach(ctx)
    faults.clear()
    ctx.enable_direct(0xFFFF)
    print("heard" if faults else "deaf")
"""


def test_khr_debug_reports_no_fault() -> None:
    *faults, heard = run(LISTEN, list(SCENES), {"MESA_DEBUG": "context"}).split("\n")[:-1]
    if heard == "deaf":
        pytest.skip("KHR_debug tells nothing here")
    assert [fault for fault in faults if fault] == []


LINK = """
import sys, moderngl, pytest
from pathlib import Path
plain, known = moderngl.Context.program, set()
ENDINGS = {"vertex": "vert", "geometry": "geom", "fragment": "frag"}  # by which glslangValidator knows them
def program(self, *some, **more):
    sources = tuple((kind, more[f"{kind}_shader"]) for kind in ENDINGS if more.get(f"{kind}_shader"))
    if sources not in known:
        known.add(sources)
        for kind, text in sources:
            Path(sys.argv[1], f"{len(known):03d}.{ENDINGS[kind]}").write_text(text)
    return plain(self, *some, **more)
moderngl.Context.program = program
sys.exit(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *sys.argv[2:]]))
"""


@pytest.mark.skipif(shutil.which("glslangValidator") is None, reason="needs glslangValidator (glslang-tools)")
def test_glslang_compiles_all_programs(tmp_path: Path) -> None:
    """All programs that some tests link compile with glslang."""
    run(LINK, [str(tmp_path), *LINKING], {})
    numbers = sorted({path.stem for path in tmp_path.iterdir()})
    for number in numbers:
        files = [str(path) for path in sorted(tmp_path.glob(f"{number}.*"))]
        done = subprocess.run(["glslangValidator", "-l", *files], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-3000:]
    assert len(numbers) > 50
