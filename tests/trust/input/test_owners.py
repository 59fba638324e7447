"""A renderer works in its own thread and process and raises an error elsewhere; a failed construction frees all resources."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import moderngl
import pytest

import irrsplat
from irrsplat.core.errors import GLError, InputError
from irrsplat.gpu import context
from irrsplat.gpu.target import pixels
from irrsplat.scene.model import Camera, Light, Scene
from tests.gpu.test_programs import resources

LIGHT = Light((0, 0, 2), (1, 1, 1))
EMPTY = Scene((), (LIGHT,), (Camera((0, 0, 3), (0, 0, 0)),), sky=(1, 1, 1))


def in_thread(act):
    """Return the result of `act` in a new thread, or its error."""
    found = []

    def run():
        try:
            found.append(act())
        except Exception as error:
            found.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return found[0]


def test_each_thread_uses_only_its_own_renderer():
    with irrsplat.Renderer(EMPTY, (8, 8), bounces=1) as renderer:
        picture = renderer.render().image
        for act in (renderer.render, renderer.release, lambda: renderer.relight([])):
            error = in_thread(act)
            assert isinstance(error, GLError) and "only in the thread that made it" in str(error)
        assert (in_thread(lambda: irrsplat.render(EMPTY, (8, 8), bounces=1).image) == picture).all()
        assert (renderer.render().image == picture).all()


def test_an_unreferenced_renderer_is_freed_by_its_own_thread():
    """A renderer is freed at once if its context is current, else at its thread's next use of OpenGL; its views then raise."""
    one, two = irrsplat.Renderer(EMPTY, (8, 8), bounces=1), irrsplat.LightMeter(EMPTY)
    first, second = one.ctx, two.ctx
    view, _ = one.frame()
    del one
    assert context.is_gone(first)
    with pytest.raises(GLError, match="has been released"):
        pixels(view.image)
    held = [two]
    del two
    in_thread(held.clear)
    assert not context.is_gone(second)
    irrsplat.render(EMPTY, (8, 8), bounces=1)
    assert context.is_gone(second)


def test_an_unreferenced_renderer_is_freed_by_the_next_call_in_a_host():
    host = context.create()
    host.extra = None  # `create` stores data of its own contexts here
    with host:
        one, two = (irrsplat.Renderer(EMPTY, (8, 8), bounces=1, ctx=host) for _ in range(2))
        textures = [thing for thing in resources(one) if isinstance(thing, moderngl.Texture)]
        del one
        assert textures and not any(isinstance(texture.mglo, moderngl.InvalidObject) for texture in textures)
        two.frame()
        assert all(isinstance(texture.mglo, moderngl.InvalidObject) for texture in textures)
        two.release()
    host.release()


FORKED = """
import os, signal, irrsplat
from tests.trust.input.test_owners import EMPTY
renderer = irrsplat.Renderer(EMPTY, (8, 8))
renderer.render()
for act in (renderer.render, lambda: irrsplat.render(EMPTY, (8, 8))):
    if not os.fork():
        signal.alarm(120)
        try:
            act()
        except irrsplat.GLError as error:
            os.write(1, f"{error}\\n".encode())
        os._exit(0)
    os.wait()
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_process_raises_instead_of_hanging():
    done = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, text=True, timeout=300, check=True)
    first, second = done.stdout.splitlines()
    assert "only in the process that made it" in first and "start processes by spawn" in second


def test_a_failed_construction_frees_its_context(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[moderngl.Context] = []
    plain = context.create

    def create() -> moderngl.Context:
        made.append(plain())
        return made[-1]

    monkeypatch.setattr(context, "create", create)
    many = Scene((), (LIGHT,) * 5000, EMPTY.cameras)
    with pytest.raises(InputError, match="5000 lights"):
        irrsplat.Renderer(many, (8, 8))
    with pytest.raises(InputError, match="5000 lights"):
        irrsplat.irradiance(many, [[0, 0, 0]], [0, 0, 1])
    assert len(made) == 2 and all(isinstance(ctx.mglo, moderngl.InvalidObject) for ctx in made)
