"""What all tests share: one OpenGL context, and a watch over every test's OpenGL errors."""

from __future__ import annotations

from collections.abc import Iterator

import moderngl
import pytest

from irrsplat.gpu import context


@pytest.fixture
def ctx() -> Iterator[moderngl.Context]:
    """The session's OpenGL context, made current for this test (a Renderer of an earlier test may have left another current)."""
    shared = context.shared()
    with shared:
        yield shared


@pytest.fixture(autouse=True)
def no_gl_errors(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fails the test that left an OpenGL error in any context that it used: the shared one, or one that it made itself."""
    contexts: list[moderngl.Context] = [context.shared()] if context.shared.cache_info().currsize else []
    for one in contexts:
        with one:
            one.clear_errors()
    found: list[str] = []
    create, release = context.create, moderngl.Context.release

    def watched_create(require: int = context.REQUIRED) -> moderngl.Context:
        made = create(require)
        contexts.append(made)
        return made

    def watched_release(self: moderngl.Context) -> None:
        look(self)
        release(self)

    def look(one: moderngl.Context) -> None:
        if not isinstance(one.mglo, moderngl.InvalidObject):  # not released already
            with one:
                found.append(one.error)

    monkeypatch.setattr(context, "create", watched_create)
    monkeypatch.setattr(moderngl.Context, "release", watched_release)
    yield
    for one in contexts:
        look(one)
    assert set(found) <= {"GL_NO_ERROR"}, f"this test left OpenGL errors: {found}"
