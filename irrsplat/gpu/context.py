"""OpenGL contexts without a window, and advice where none can be made."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import FrameType
from typing import Any, TypedDict

import moderngl

from irrsplat.core.errors import GLError

REQUIRED = 330  # OpenGL 3.3 core, which includes macOS (4.1) and old laptops
_made_in: set[int] = set()  # process numbers; a forked process inherits its parent's
_deferred: list[tuple[moderngl.Context, Callable[[], object]]] = []  # frees that wait for their context
_DEVICES = 8  # EGL devices to try

# Part of moderngl's message -> what is wrong, and the one command that helps. moderngl 5.13 raises bare Exceptions.
_APT = "sudo apt-get install -y"
_ADVICE = (
    ("libGL.so", f"the library libGL is missing; run: {_APT} libgl1"),
    ("libEGL.so", f"the library libEGL is missing; run: {_APT} libegl1"),
    ("but found 0 devices", f"EGL finds no driver; install the GPU's driver, or run: {_APT} libegl-mesa0"),
    ("eglInitialize failed", f"the EGL driver does not start; run: {_APT} libgl1-mesa-dri"),
    ("eglCreateContext failed", f"the driver has no OpenGL 3.3; update it, or run: {_APT} libgl1-mesa-dri"),
    ("XOpenDisplay: cannot open display", f"no display, and no EGL in its place; run: {_APT} libegl1 libgl1"),
)


def create() -> moderngl.Context:
    """Return a new standalone context of at least version REQUIRED, made current; EGL on Linux, else the system's own.

    The context works only in the thread and process that made it. Raises GLError, one line with the remedy, if no context can be
    made, or if the process was forked from one with a context.
    """
    if _made_in and _made_in != {os.getpid()}:
        raise GLError(
            "this process was forked from one that uses OpenGL, and its driver would hang; start processes by spawn: "
            "multiprocessing.get_context('spawn')"
        )
    prepare()
    free_deferred()
    options: list[dict[str, Any]] = [{}]
    if sys.platform.startswith("linux"):
        os.environ.setdefault("EGL_LOG_LEVEL", "fatal")  # hide Mesa's warnings: an error is one line, ours
        chosen = "GLCONTEXT_DEVICE_INDEX" in os.environ  # the user's choice, which glcontext reads
        options = [
            {"backend": "egl"} | ({} if chosen or i == 0 else {"device_index": i}) for i in range(1 if chosen else _DEVICES)
        ]
    first = ""
    for option in options:
        try:
            ctx = moderngl.create_context(standalone=True, require=REQUIRED, **option)
        except Exception as error:  # moderngl raises bare Exceptions
            message = " ".join(str(error).split())
            first = first or message
            if "not loaded" in message or ("requested device index" in message and "but found" in message):
                break
        else:
            _made_in.add(os.getpid())
            ctx.extra = _process_and_thread()
            return ctx
    raise GLError(advice(first)) from None


def _process_and_thread() -> tuple[int, int]:
    """Return the numbers of the current process and thread."""
    return os.getpid(), threading.get_ident()


def prepare() -> None:
    """Set Mesa's environment variables where the user has not set them.

    Mesa's llvmpipe keeps compiled shaders on disk, and finds them for any LP_NATIVE_VECTOR_WIDTH. Shaders compiled for 256 bits
    write beyond the buffers of a process with 128 bits and end it ("free(): invalid next size"). A process with a set width has
    no disk cache.
    """
    if "LP_NATIVE_VECTOR_WIDTH" in os.environ:
        os.environ.setdefault("MESA_SHADER_CACHE_DISABLE", "true")


def is_gone(thing: moderngl.Context | moderngl.Texture) -> bool:
    """True if the owner of `thing` has released it; with a context, everything made in it."""
    return isinstance(thing.mglo, moderngl.InvalidObject)


def link(ctx: moderngl.Context, vertex: str, fragment: str, geometry: str | None) -> moderngl.Program:
    """Return a program of these shader texts; raises moderngl.Error if one does not compile or link.

    moderngl's C code calls Python for each member of a program, and ends the process if that call raises. Signal handlers such as
    Ctrl-C's raise there, so signals wait until the program exists.
    """
    with _signals_delayed():
        return ctx.program(vertex_shader=vertex, fragment_shader=fragment, geometry_shader=geometry)


_signals = cache(signal.valid_signals)  # the look-up takes half of the time of a delay, at each of a start's dozens of programs


@contextmanager
def _signals_delayed() -> Iterator[None]:
    """Delay Python's signal handlers until the block ends. No effect outside the main thread, which alone receives signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers: dict[int, Any] = {}
    delayed: list[int] = []
    delaying = True

    def handle_or_delay(number: int, frame: FrameType | None) -> None:
        if delaying:
            delayed.append(number)
        else:  # a signal between the end of the block and the return of this handler
            handlers[number](number, frame)

    try:
        for one in _signals():
            if callable(handler := signal.getsignal(one)):
                handlers[one] = handler
                signal.signal(one, handle_or_delay)
        yield
    finally:
        delaying = False
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in delayed:
            handlers[number](number, None)


def free_or_defer(ctx: moderngl.Context, handles: tuple[int, ...], free: Callable[[], object]) -> None:
    """Call `free` for the resources of a deleted owner in `ctx`. handles: from `current`, when the owner was made.

    Python may call this at any time and in any thread. If `ctx` is not current, or belongs to a host, `free` waits until `ctx` is
    next made current or found current.
    """
    if is_gone(ctx):
        return
    if ctx.extra == _process_and_thread() and any(handles) and current() == handles:
        free()
    else:
        _deferred.append((ctx, free))


def free_deferred(found: moderngl.Context | None = None) -> None:
    """Call the pending `free` functions of contexts that `create` made in this thread, or of the context `found` current."""
    for entry in list(_deferred):
        ctx, free = entry
        if is_gone(ctx):
            _deferred.remove(entry)
        elif ctx is found or (found is None and ctx.extra == _process_and_thread()):
            _deferred.remove(entry)
            if found is None:
                ctx.__enter__()  # type: ignore[no-untyped-call]
            free()


def check_alive(ctx: moderngl.Context) -> None:
    """Raise GLError if `ctx` has been released."""
    if is_gone(ctx):
        raise GLError("the OpenGL context has been released; what was made with it can do no more: make it anew")


def make_current(ctx: moderngl.Context) -> None:
    """Make `ctx`, made by `create`, the current context of this thread; raises GLError in another thread or process than its
    own."""
    if ctx.extra != _process_and_thread():
        if ctx.extra[0] != os.getpid():
            raise GLError("a Renderer or LightMeter works only in the process that made it; spawn others, and make one there")
        raise GLError("a Renderer or LightMeter works only in the thread that made it; make one of its own in this thread")
    free_deferred()
    ctx.__enter__()  # type: ignore[no-untyped-call]


_NATIVE = {  # libraries that make contexts current, and their query functions
    "linux": (("libEGL.so.1", "eglGetCurrentContext"), ("libGLX.so.0", "glXGetCurrentContext")),
    "win32": (("opengl32.dll", "wglGetCurrentContext"),),
    "darwin": (("/System/Library/Frameworks/OpenGL.framework/OpenGL", "CGLGetCurrentContext"),),
}
_native_functions: dict[str, Callable[[], int | None]] = {}


def current() -> tuple[int, ...]:
    """Return the system's handles of the contexts current in this thread, one per library; 0 for none, empty if unknown."""
    return tuple(_native_handle(library, name) for library, name in _NATIVE.get(sys.platform, ()))


def _native_handle(library: str, name: str) -> int:
    """Return the result of the library's function `name`; 0 if the library is not loaded, so that no context of it is current."""
    if library not in _native_functions:
        try:
            # Windows always has it loaded, and offers no RTLD_NOLOAD
            loaded = ctypes.CDLL(library) if sys.platform == "win32" else ctypes.CDLL(library, os.RTLD_NOLOAD | os.RTLD_LAZY)
            function = getattr(loaded, name)
        except (OSError, AttributeError):
            return 0
        function.argtypes, function.restype = (), ctypes.c_void_p
        _native_functions[library] = function
    return _native_functions[library]() or 0


def check_current(expected: tuple[int, ...]) -> None:
    """Raise GLError if other contexts are current than `expected` (from `current`); no check if the system reports no handles.

    Otherwise OpenGL would draw into objects of the same numbers in another context, or crash.
    """
    if any(expected) and (now := current()) != expected:
        which = "another OpenGL context is" if any(now) else "no OpenGL context is"
        raise GLError(
            f"{which} current, not the one that this Renderer or LightMeter was given; make that current before each call "
            "(moderngl: with ctx:, Qt: makeCurrent())"
        )


def check_errors(ctx: moderngl.Context) -> None:
    """Raise GLError if OpenGL has recorded an error since the last check, so that the result is unreliable."""
    error = ctx.error
    if error == "GL_OUT_OF_MEMORY":
        raise GLError("OpenGL is out of memory; take a smaller size")
    if error != "GL_NO_ERROR":
        raise GLError(f"OpenGL reports {error}; the picture would be wrong. Details: irrsplat doctor, or IRRSPLAT_DEBUG=1")


def advice(message: str) -> str:
    """Return one line for a user in place of moderngl's `message`: the fault of the OpenGL installation, and its remedy."""
    for part, text in _ADVICE:
        if part in message:
            return f"no OpenGL 3.3: {text}"
    return f"no OpenGL 3.3: {message or 'unknown reason'}; install a graphics driver, or run: {_APT} libgl1 libegl1"


class Description(TypedDict):
    """Properties of an OpenGL context; `software`: it runs on the CPU."""

    renderer: str
    vendor: str
    version: str
    version_code: int  # 330 is OpenGL 3.3
    software: bool
    max_texture_size: int  # texels


def describe(ctx: moderngl.Context) -> Description:
    """Return the properties of `ctx`."""
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
