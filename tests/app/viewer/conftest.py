"""What the viewer's tests share: a view of the Cornell box after a few rounds, which they only look at."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import irrsplat
from irrsplat.gpu import context
from tests.support.viewing import ShownView, shown_view


@pytest.fixture(scope="session")
def shared_cornell() -> Iterator[ShownView]:
    """The Cornell box after two rounds; the records of the second are splatted, and some pixels still ask."""
    with context.shared():
        made = shown_view(irrsplat.load("cornell"), gather="raster")
    yield made
    with context.shared():
        made.release()


@pytest.fixture
def cornell(shared_cornell: ShownView) -> Iterator[ShownView]:
    """The same, with its context current; nothing in a test may have changed it."""
    renderer = shared_cornell.renderer
    before = renderer.settings, renderer.cache.count, renderer.cache.revision
    with context.shared():
        yield shared_cornell
    assert before == (renderer.settings, renderer.cache.count, renderer.cache.revision)
