"""Proves that pictures do not depend on which OpenGL draws them: versions, vector widths, threads and other drivers of Mesa.

    python tests/trust/gl/machines.py [NAME …] [--list]

NAME: a case's name, or a part of it; default: all. Each case renders scenes in a process of its own, and its pictures must be
those of the plain machine: byte for byte, or within a share where another driver rounds otherwise. Case `messages` listens to
KHR_debug in a debug context; case `shaders` gives all programs that tests link to glslangValidator. A case whose driver or tool
is not here is said to be so. Exit status: 0 if every case that could run held, else 1.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import moderngl
import numpy as np

REPOSITORY = Path(__file__).resolve().parents[3]
LAVAPIPE = Path("/usr/share/vulkan/icd.d")
SCENES = ("cornell", "cornell-paper", "curved", "door", "furnace", "atrium")
CHEAP: dict[str, Any] = {"bounces": 1, "gather_size": 16, "shadow_size": 64}
GATHERS = ("raster", "trace")
NAMES = ("image", "irradiance", "depth", "albedo", "records_position", "records_irradiance")
OTHER_DRIVER = 0.01  # share of the mean that the mean may differ by; a driver that rounds otherwise places records otherwise
PIXEL = 0.09  # the same for the RMS over the pixels that see the same surface; records of such few rays are noisy
EDGES = 0.02  # share of the pixels that may see another surface: at edges, whose pixels a driver may round to either side
TIME_LIMIT = 900.0  # seconds of a process
# KHR_debug's types of messages that tell of a fault: errors, deprecated, undefined and not portable behaviour
FAULTS = {0x824C: "error", 0x824D: "deprecated", 0x824E: "undefined", 0x824F: "not portable"}


@dataclass(frozen=True)
class Case:
    """A machine to try. env: what makes Mesa that machine. same: pictures must be the plain machine's byte for byte. driver: a
    part of the renderer's name by which the machine is known; where it is missing, the case cannot be tried here."""

    name: str
    env: dict[str, str] = field(default_factory=dict)
    same: bool = True
    driver: str = ""


def _version(version: str) -> Case:
    return Case(
        f"OpenGL {version}", {"MESA_GL_VERSION_OVERRIDE": version, "MESA_GLSL_VERSION_OVERRIDE": version.replace(".", "") + "0"}
    )


def _width(bits: str, again: str = "") -> Case:
    return Case(f"{bits}-bit vectors{again}", {"LP_NATIVE_VECTOR_WIDTH": bits}, same=False, driver=f"{bits} bits")


# Those of vector widths share a folder of kept shaders with all cases before them, which Mesa mixes up (see gpu.context.prepare).
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


@dataclass(frozen=True)
class Verdict:
    """What came of a case: whether it held, None where it cannot be tried here, and what was found in words."""

    held: bool | None
    words: str


# ---- in a process of its own -------------------------------------------------------------------------------------------


def draw(out: Path, scenes: Iterable[str], side: int) -> None:
    """Render the scenes by every gather, and keep their buffers in an .npz; "driver" in it is the renderer's name."""
    import irrsplat
    from irrsplat.gpu import context

    with context.create() as ctx:
        found: dict[str, Any] = {"driver": np.array(context.describe(ctx)["renderer"])}
    for scene in scenes:
        loaded = irrsplat.load(scene)
        for gather in GATHERS:
            frame = irrsplat.render(loaded, (side, side), gather=gather, **CHEAP)
            found |= {f"{scene} {gather} {name}": getattr(frame, name) for name in NAMES}
    np.savez(out, **found)


def listen(scenes: Iterable[str], side: int) -> int:
    """Render the scenes while KHR_debug's messages are listened to; print those that tell of a fault. Returns how many."""
    import irrsplat
    from irrsplat.gpu import context

    faults: list[str] = []
    heard: list[int] = []

    def hear(source: int, kind: int, number: int, severity: int, length: int, text: bytes, _: object) -> None:
        heard.append(kind)
        if kind in FAULTS:
            faults.append(f"{FAULTS[kind]}: {text.decode(errors='replace').strip()}")

    callback = ctypes.CFUNCTYPE(None, *[ctypes.c_uint] * 4, ctypes.c_int, ctypes.c_char_p, ctypes.c_void_p)(hear)
    address = ctypes.CDLL("libEGL.so.1").eglGetProcAddress
    address.restype, address.argtypes = ctypes.c_void_p, [ctypes.c_char_p]

    def attach(ctx: moderngl.Context) -> None:
        found = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(address(b"glDebugMessageCallback"))
        found(ctypes.cast(callback, ctypes.c_void_p), None)
        ctx.enable_direct(0x92E0)  # GL_DEBUG_OUTPUT
        ctx.enable_direct(0x8242)  # GL_DEBUG_OUTPUT_SYNCHRONOUS

    for scene in scenes:
        for gather in GATHERS:
            with irrsplat.Renderer(irrsplat.load(scene), (side, side), gather=gather, samples=2, **CHEAP) as renderer:
                attach(renderer.ctx)
                renderer.render()
                renderer.relight(renderer.scene.lights[:1])
                renderer.resize((side // 2, side))
                renderer.render()
    with context.create() as ctx:  # so that silence is known to mean something
        attach(ctx)
        before = len(faults)
        ctx.enable_direct(0xFFFF)
        if len(faults) == before:
            print("KHR_debug tells nothing here")
            return 0
        del faults[before:]
    print(f"{len(heard)} messages, {len(faults)} of them faults", *faults[:5], sep="; ")
    return len(faults)


def link(folder: Path) -> None:
    """Run the tests that link programs, and keep the sources of each program that they link in the folder."""
    import pytest

    plain, count = moderngl.Context.program, 0
    known: set[object] = set()

    def program(self: moderngl.Context, *some: Any, **more: Any) -> Any:
        nonlocal count
        sources = {
            kind: more.get(f"{name}_shader") for kind, name in (("vert", "vertex"), ("geom", "geometry"), ("frag", "fragment"))
        }
        made = plain(self, *some, **more)
        if (key := tuple(sources.values())) not in known:
            known.add(key)
            count += 1
            for kind, text in sources.items():
                if text is not None:
                    (folder / f"{count:03d}.{kind}").write_text(text)
        return made

    moderngl.Context.program = program  # type: ignore[method-assign]
    tests = ("tests/gpu/test_programs.py", "tests/gpu/test_self_test.py", "tests/app/viewer/test_buffer_view.py")
    if status := pytest.main(["-q", "-x", "-p", "no:cacheprovider", "--no-header", *tests]):
        raise SystemExit(int(status))


# ---- judging -----------------------------------------------------------------------------------------------------------


def compare(case: Case, plain: Path, other: Path) -> Verdict:
    """Whether the pictures of a case are those of the plain machine."""
    with np.load(plain) as one, np.load(other) as two:
        if case.driver not in str(two["driver"]):
            return Verdict(None, f"not here: the driver is {two['driver']}")
        pictures = [name for name in one.files if name != "driver"]
        if case.same:
            wrong = [name for name in pictures if one[name].tobytes() != two[name].tobytes()]
            return Verdict(not wrong, f"{len(pictures) - len(wrong)} of {len(pictures)} arrays equal byte for byte")
        apart, pixels, edges = 0.0, 0.0, 0.0
        for name in pictures:
            if name.endswith((" image", " irradiance", " albedo")):
                a, b = one[name].astype(float), two[name].astype(float)
                apart = max(apart, abs(b.mean() / a.mean() - 1.0))
                albedo = f"{name.rsplit(' ', 1)[0]} albedo"
                same = np.abs(one[albedo] - two[albedo]).max(-1) < 0.01
                edges = max(edges, float(1.0 - same.mean()))
                pixels = max(pixels, float(np.sqrt(((a - b)[same] ** 2).mean()) / a.mean()))
    held = bool(apart <= OTHER_DRIVER and pixels <= PIXEL and edges <= EDGES)
    return Verdict(held, f"means at most {apart:.2%} apart, pixels {pixels:.2%} RMS but for {edges:.2%} at edges")


def run(arguments: Iterable[object], env: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """This program in a process of its own, with more in its environment."""
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("LP_", "MESA_", "GALLIUM_"))}
    return subprocess.run(
        [sys.executable, __file__, *map(str, arguments)],
        cwd=REPOSITORY,
        env={**inherited, **env},
        capture_output=True,
        text=True,
        timeout=TIME_LIMIT,
        check=False,
    )


def tell(done: subprocess.CompletedProcess[str]) -> str:
    """How a process ended, and its last line."""
    said = (done.stderr or done.stdout).strip().splitlines()
    how = f"signal {-done.returncode}" if done.returncode < 0 else f"status {done.returncode}"
    return f"ended with {how}: {said[-1] if said else 'nothing said'}"


def judge(case: Case, folder: Path, plain: Path, scenes: Iterable[str], side: int) -> Verdict:
    """Render in the case's machine and compare with the plain one."""
    out = folder / f"{case.name.replace(' ', '-')}.npz"
    env = {"MESA_SHADER_CACHE_DIR": str(folder / "shaders"), "XDG_RUNTIME_DIR": str(folder), **case.env}
    if case.driver == "zink":
        found = sorted(LAVAPIPE.glob("lvp_icd*.json"))
        if not found:
            return Verdict(None, "not here: Mesa's lavapipe is not installed (mesa-vulkan-drivers)")
        env["VK_ICD_FILENAMES"] = str(found[0])
    done = run(("--draw", out, side, *scenes), env)
    return compare(case, plain, out) if done.returncode == 0 else Verdict(False, tell(done))


def draw_plain(folder: Path, scenes: Iterable[str], side: int) -> Path:
    """The pictures of the plain machine."""
    out = folder / "plain.npz"
    done = run(("--draw", out, side, *scenes), {"MESA_SHADER_CACHE_DIR": str(folder / "shaders")})
    if done.returncode:
        raise SystemExit(f"the plain machine {tell(done)}")
    return out


def judge_messages(folder: Path, scenes: Iterable[str], side: int) -> Verdict:
    """Whether KHR_debug tells of no fault in a debug context."""
    done = run(("--listen", folder, side, *scenes), {"MESA_DEBUG": "context"})
    said = (done.stdout.strip().splitlines() or [tell(done)])[-1]
    return Verdict(None if "tells nothing" in said else done.returncode == 0, said)


def judge_shaders(folder: Path) -> Verdict:
    """Whether glslangValidator takes every program that the tests link."""
    if shutil.which("glslangValidator") is None:
        return Verdict(None, "not here: glslangValidator (glslang-tools)")
    programs = folder / "programs"
    programs.mkdir()
    done = run(("--link", programs, 0), {})
    if done.returncode:
        return Verdict(False, f"the tests {tell(done)}")
    numbers = sorted({path.stem for path in programs.iterdir()})
    wrong = []
    for number in numbers:
        files = [str(path) for path in sorted(programs.glob(f"{number}.*"))]
        checked = subprocess.run(["glslangValidator", "-l", *files], capture_output=True, text=True, check=False)
        if checked.returncode:
            wrong.append(next((line for line in checked.stdout.splitlines() if "ERROR" in line), number))
    return Verdict(
        not wrong, f"{len(numbers) - len(wrong)} of {len(numbers)} programs pass" + "".join(f"; {w}" for w in wrong[:3])
    )


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--list", action="store_true", help="only name the cases")
    parser.add_argument("--scenes", nargs="+", default=SCENES, help="what is rendered")
    parser.add_argument("--side", type=int, default=48, help="of a picture, pixels")
    for child in ("--draw", "--listen", "--link"):
        parser.add_argument(child, nargs="+", help=argparse.SUPPRESS)
    args = parser.parse_args()
    sys.path.insert(0, str(REPOSITORY))
    if args.draw:
        draw(Path(args.draw[0]), args.draw[2:], int(args.draw[1]))
        return 0
    if args.listen:
        return int(listen(args.listen[2:], int(args.listen[1])) > 0)
    if args.link:
        link(Path(args.link[0]))
        return 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        judges: dict[str, Callable[[], Verdict]] = {
            case.name: lambda case=case: judge(case, folder, folder / "plain.npz", args.scenes, args.side)  # type: ignore[misc]
            for case in CASES
        }
        judges["messages"] = lambda: judge_messages(folder, args.scenes, args.side)
        judges["shaders"] = lambda: judge_shaders(folder)
        chosen = [name for name in judges if not args.names or any(part in name for part in args.names)]
        if args.list:
            print(*judges, sep="\n")
            return 0
        draw_plain(folder, args.scenes, args.side)
        wrong = 0
        for name in chosen:
            verdict = judges[name]()
            wrong += verdict.held is False
            print(
                f"{name:<22} {'held' if verdict.held else 'WRONG' if verdict.held is False else '-':<6} {verdict.words}",
                flush=True,
            )
    print(f"{len(chosen) - wrong} of {len(chosen)} cases held or cannot be tried here")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
