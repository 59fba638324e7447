"""The context without a window: what it is, and what is said where there is none."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import moderngl
import pytest

from irrsplat.core.errors import GLError
from irrsplat.gpu import context

pytest_plugins = ["pytester"]


def test_a_context_is_at_least_what_is_required(ctx: moderngl.Context) -> None:
    about = context.describe(ctx)
    assert about["version_code"] >= context.REQUIRED
    assert about["max_texture_size"] >= 1024  # the least that OpenGL 3.3 promises
    assert isinstance(about["software"], bool)
    assert about["renderer"] and about["version"] and about["vendor"]


def test_too_much_asked_is_one_line_of_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(context, "REQUIRED", 990)
    with pytest.raises(GLError) as error:
        context.create()
    assert "\n" not in str(error.value)
    assert "apt-get install" in str(error.value)


# what moderngl 5.13 and glcontext 3.1 say, seen on bare Debian 12 images -> the missing package
@pytest.mark.parametrize(
    ("message", "package"),
    [
        ("libGL.so not loaded", "libgl1"),
        ("libEGL.so not loaded", "libegl1"),
        ("requested device index 0, but found 0 devices", "libegl-mesa0"),
        ("eglCreateContext failed (0x3009)", "libgl1-mesa-dri"),
        ("something new", "libgl1"),
    ],
)
def test_advice_names_the_package(message: str, package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(**_: object) -> None:
        raise Exception(message)

    monkeypatch.setattr(moderngl, "create_context", fail)
    with pytest.raises(GLError) as error:
        context.create()
    assert str(error.value).endswith(package) or f" {package}" in str(error.value)
    assert "\n" not in str(error.value)


LINKED = """
import os, signal, sys
import _moderngl
import moderngl
from irrsplat.gpu import context

number = getattr(signal, sys.argv[1])
signal.signal(signal.SIGTERM, signal.default_int_handler)
plain, sent = _moderngl.make_uniform, 0

def make_uniform(*values):
    global sent
    sent += 1
    os.kill(os.getpid(), number)
    return plain(*values)

ctx = context.create()
_moderngl.make_uniform = make_uniform
before = [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)]
try:
    context.link(
        ctx,
        "#version 330\\nuniform vec4 place; void main() { gl_Position = place; }",
        "#version 330\\nout vec4 color; void main() { color = vec4(1.0); }",
        None,
    )
except KeyboardInterrupt:
    after = [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)]
    print("interrupted", sent, before == after)
"""


def test_a_signal_while_a_program_is_linked_comes_after_it() -> None:
    """In a process of its own, since moderngl crashes where it comes amid."""
    done = subprocess.run([sys.executable, "-c", LINKED, "SIGTERM"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "interrupted 1 True\n"), done.stderr


def test_the_watch_sees_gl_errors(pytester: pytest.Pytester) -> None:
    """The fixture of conftest.py fails a test that asks OpenGL for a capability that no machine has."""
    pytester.makeconftest((Path(__file__).resolve().parents[1] / "conftest.py").read_text(encoding="utf-8"))
    pytester.makepyfile(
        """
        def test_wrong(ctx):
            ctx.enable_direct(0xFFFF)  # no such capability: GL_INVALID_ENUM

        def test_right(ctx):
            ctx.enable(ctx.BLEND)
        """
    )
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider")
    result.assert_outcomes(passed=2, errors=1)


def test_another_process_or_an_opengl_error_is_one_line(ctx: moderngl.Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fork shares the driver's threads, which hang there; after an error of OpenGL a picture would be wrong."""
    for error, words in (
        ("GL_OUT_OF_MEMORY", "out of memory; take a smaller size"),
        ("GL_INVALID_VALUE", "reports GL_INVALID_VALUE"),
    ):
        with pytest.raises(GLError, match=words):
            context.check_errors(SimpleNamespace(error=error))  # type: ignore[arg-type]
    pid = os.getpid() + 1
    monkeypatch.setattr(os, "getpid", lambda: pid)
    with pytest.raises(GLError, match="start processes by spawn"):
        context.create()
    with pytest.raises(GLError, match="only in the process that made it"):
        context.make_current(ctx)
