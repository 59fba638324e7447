"""An OpenGL context without a window, and what to do where there is none."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from types import FrameType
from typing import Any, TypedDict

import moderngl

from irrsplat.core.errors import GLError

REQUIRED = 330  # OpenGL 3.3 core: macOS (4.1) and old laptops stay in
_made_in: set[int] = set()  # the processes that made contexts, of which a forked one finds its parent's
_left: list[tuple[moderngl.Context, Callable[[], object]]] = []  # what could not be freed at once, and how it is freed
_DEVICES = 8  # EGL devices that are tried before giving up

# Part of moderngl's message -> what is wrong, and the one command that helps. moderngl 5.13 raises bare Exceptions.
_APT = "sudo apt-get install -y"
_ADVICE = (
    ("libGL.so not loaded", f"the library libGL is missing; run: {_APT} libgl1"),
    ("libGL.so.1", f"the library libGL is missing; run: {_APT} libgl1"),
    ("libEGL.so not loaded", f"the library libEGL is missing; run: {_APT} libegl1"),
    ("libEGL.so.1", f"the library libEGL is missing; run: {_APT} libegl1"),
    ("but found 0 devices", f"EGL finds no driver; install the GPU's driver, or run: {_APT} libegl-mesa0"),
    ("eglInitialize failed", f"the EGL driver does not start; run: {_APT} libgl1-mesa-dri"),
    ("eglCreateContext failed", f"the driver has no OpenGL 3.3; update it, or run: {_APT} libgl1-mesa-dri"),
    ("XOpenDisplay: cannot open display", f"no display, and no EGL in its place; run: {_APT} libegl1 libgl1"),
)


def create(require: int = REQUIRED) -> moderngl.Context:
    """A new standalone context of at least version `require`, made current; EGL on Linux, else the system's own.

    It works in the thread and the process that made it, and nowhere else. Raises GLError, one line with the command that helps,
    where there is none, and in a process that was forked from one with a context.
    """
    if _made_in and _made_in != {os.getpid()}:
        raise GLError(
            "this process was forked from one that uses OpenGL, and its driver would hang; start processes by spawn: "
            "multiprocessing.get_context('spawn')"
        )
    prepare()
    free_left()
    options: list[dict[str, Any]] = [{}]
    if sys.platform.startswith("linux"):
        os.environ.setdefault("EGL_LOG_LEVEL", "fatal")  # without Mesa's own warnings: an error is one line, ours
        chosen = "GLCONTEXT_DEVICE_INDEX" in os.environ  # the user's choice, which glcontext reads
        options = [
            {"backend": "egl"} | ({} if chosen or i == 0 else {"device_index": i}) for i in range(1 if chosen else _DEVICES)
        ]
    first = ""
    for option in options:
        try:
            ctx = moderngl.create_context(standalone=True, require=require, **option)
        except Exception as error:  # a bare Exception is all that moderngl raises
            message = " ".join(str(error).split())
            first = first or message
            if "not loaded" in message or ("requested device index" in message and "but found" in message):
                break
        else:
            _made_in.add(os.getpid())
            ctx.extra = _here()
            return ctx
    raise GLError(advice(first)) from None


def _here() -> tuple[int, int]:
    """The process and the thread."""
    return os.getpid(), threading.get_ident()


def prepare() -> None:
    """Set what Mesa reads when OpenGL starts, where the user's environment leaves it open.

    Mesa's llvmpipe keeps compiled shaders on disk, and finds them again whatever LP_NATIVE_VECTOR_WIDTH they were compiled for.
    Those of 256 bits write beyond the buffers of a process with 128, and end it ("free(): invalid next size"): a process to
    which a width is given keeps none.
    """
    if "LP_NATIVE_VECTOR_WIDTH" in os.environ:
        os.environ.setdefault("MESA_SHADER_CACHE_DISABLE", "true")


def is_gone(ctx: moderngl.Context) -> bool:
    """Whether its owner has released `ctx`, and all that was made in it."""
    return isinstance(ctx.mglo, moderngl.InvalidObject)


def link(ctx: moderngl.Context, vertex: str, fragment: str, geometry: str | None) -> moderngl.Program:
    """A program of these shaders' texts; raises moderngl.Error where they do not compile or link.

    moderngl's C code calls Python for each of a program's members, and ends the process where that raises: what raises there is
    a signal's handler, as Ctrl-C's. So signals wait until the program is there.
    """
    with _signals_held():
        return ctx.program(vertex_shader=vertex, fragment_shader=fragment, geometry_shader=geometry)


@contextmanager
def _signals_held() -> Iterator[None]:
    """While this lasts, signals to which Python code answers wait; afterwards it does. In other threads than the main one, to
    which Python gives them, nothing happens."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    answers: dict[int, Any] = {}
    came: list[int] = []
    holding = True

    def answer(number: int, frame: FrameType | None) -> None:
        if holding:
            came.append(number)
        else:  # between the end and the return of its own handler
            answers[number](number, frame)

    try:
        for one in signal.valid_signals():
            if callable(handler := signal.getsignal(one)):
                answers[one] = handler
                signal.signal(one, answer)
        yield
    finally:
        holding = False
        for number, handler in answers.items():
            signal.signal(number, handler)
        for number in came:
            answers[number](number, None)


def leave(ctx: moderngl.Context, handles: tuple[int, ...], free: Callable[[], object]) -> None:
    """Free what somebody who has gone had in `ctx`: by `free`. handles: what `current` gave.

    Python may call this at any time and in any thread. Where `ctx` is not the current context, or is a host's, `free` is called
    when it is next made or found current.
    """
    if is_gone(ctx):
        return
    if ctx.extra == _here() and any(handles) and current() == handles:
        free()
    else:
        _left.append((ctx, free))


def free_left(found: moderngl.Context | None = None) -> None:
    """Free what `leave` could not in contexts that `create` made in this thread, or in the one that was found current."""
    for left in list(_left):
        ctx, free = left
        if is_gone(ctx):
            _left.remove(left)
        elif ctx is found or (found is None and ctx.extra == _here()):
            _left.remove(left)
            if found is None:
                ctx.__enter__()  # type: ignore[no-untyped-call]
            free()


def check_alive(ctx: moderngl.Context) -> None:
    """Raises GLError where `ctx` has been released."""
    if is_gone(ctx):
        raise GLError("the OpenGL context has been released; what was made with it can do no more: make it anew")


def make_current(ctx: moderngl.Context) -> None:
    """Make `ctx`, which `create` made, the context of all further OpenGL calls of this thread; raises GLError where that is
    not the thread, or not the process, that made it."""
    if ctx.extra != _here():
        if ctx.extra[0] != os.getpid():
            raise GLError("a Renderer or LightMeter works only in the process that made it; spawn others, and make one there")
        raise GLError("a Renderer or LightMeter works only in the thread that made it; make one of its own in this thread")
    free_left()
    ctx.__enter__()  # type: ignore[no-untyped-call]


_NATIVE = {  # the libraries that make contexts current, and what tells which one is
    "linux": (("libEGL.so.1", "eglGetCurrentContext"), ("libGLX.so.0", "glXGetCurrentContext")),
    "win32": (("opengl32.dll", "wglGetCurrentContext"),),
    "darwin": (("/System/Library/Frameworks/OpenGL.framework/OpenGL", "CGLGetCurrentContext"),),
}
_asked: dict[str, Callable[[], int | None]] = {}


def current() -> tuple[int, ...]:
    """The system's handles of the OpenGL contexts that are current in this thread, one for each library that makes them; 0 for
    none. Empty where that cannot be known."""
    return tuple(_ask(library, name) for library, name in _NATIVE.get(sys.platform, ()))


def _ask(library: str, name: str) -> int:
    """What the function `name` of a library returns; 0 where that is not loaded, so that none of its contexts is current."""
    if library not in _asked:
        try:
            # Windows has it loaded, and no flag that asks for that
            loaded = ctypes.CDLL(library) if sys.platform == "win32" else ctypes.CDLL(library, os.RTLD_NOLOAD | os.RTLD_LAZY)
            function = getattr(loaded, name)
        except (OSError, AttributeError):
            return 0
        function.argtypes, function.restype = (), ctypes.c_void_p
        _asked[library] = function
    return _asked[library]() or 0


def check_current(expected: tuple[int, ...]) -> None:
    """Raises GLError where other contexts are current than those `expected`, which `current` gave: OpenGL would draw into things
    of the same numbers there, or crash. Says nothing where that cannot be known."""
    if any(expected) and (now := current()) != expected:
        which = "another OpenGL context is" if any(now) else "no OpenGL context is"
        raise GLError(
            f"{which} current, not the one that this Renderer or LightMeter was given; make that current before each call "
            "(moderngl: with ctx:, Qt: makeCurrent())"
        )


def check_errors(ctx: moderngl.Context) -> None:
    """Raises GLError where OpenGL has noted an error since it was last asked: what was drawn is not to be trusted."""
    error = ctx.error
    if error == "GL_OUT_OF_MEMORY":
        raise GLError("OpenGL is out of memory; take a smaller size, or less --texture-memory")
    if error != "GL_NO_ERROR":
        raise GLError(f"OpenGL reports {error}; the picture would be wrong. IRRSPLAT_DEBUG=1 and irrsplat doctor tell more")


def advice(message: str) -> str:
    """One line for a user in place of moderngl's `message`: what is wrong with OpenGL here, and what helps."""
    for part, text in _ADVICE:
        if part in message:
            return f"no OpenGL 3.3: {text}"
    return f"no OpenGL 3.3: {message or 'unknown reason'}; install a graphics driver, or run: {_APT} libgl1 libegl1"


class Description(TypedDict):
    """What an OpenGL context is; `software`: it runs on the CPU."""

    renderer: str
    vendor: str
    version: str
    version_code: int  # 330 is OpenGL 3.3
    software: bool
    max_texture_size: int  # texels


def describe(ctx: moderngl.Context) -> Description:
    """What `ctx` is."""
    info = ctx.info
    renderer = str(info["GL_RENDERER"])
    return {
        "renderer": renderer,
        "vendor": str(info["GL_VENDOR"]),
        "version": str(info["GL_VERSION"]),
        "version_code": int(ctx.version_code),
        "software": any(name in renderer.lower() for name in ("llvmpipe", "softpipe", "swrast", "swiftshader")),
        "max_texture_size": int(info["GL_MAX_TEXTURE_SIZE"]),
    }


def machine(about: Mapping[str, object]) -> str:
    """What results hold for that are kept between runs: the OpenGL that `about` describes, and this version of irrsplat."""
    try:
        version = metadata.version("irrsplat")
    except metadata.PackageNotFoundError:
        version = ""
    return f"{about['renderer']}; {about['version']}; irrsplat {version}"


@cache
def shared() -> moderngl.Context:
    """The context that tests and short scripts share; it lives until the process ends."""
    return create()
