"""Large pictures: known memory needs, less memory for a single picture, and one-line errors for a lack of memory."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import moderngl
import numpy as np
import pytest
from PIL import Image

import irrsplat
from irrsplat import Renderer
from irrsplat.app import cli
from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.image import frame as output
from irrsplat.image.backdrop import BackdropKind
from irrsplat.image.frame import RECORDS, Frame
from irrsplat.renderer import memory, whole_renders
from irrsplat.settings import preset
from tests.renderer.test_renderer import FAST, room

SIZE = (176, 416)  # high enough for views that start with every other pixel
CHEAP: dict[str, Any] = {**FAST, "a": 0.8}
ALONE = ("image", "alpha")


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Treat every picture as large."""
    monkeypatch.setattr(memory, "LARGE", 0)


@pytest.mark.few_sites
def test_a_picture_alone_has_the_same_records_and_bytes(large: None) -> None:
    kind = {**CHEAP, "bounces": "all"}
    with Renderer(room(sky=0.5), SIZE, **kind) as renderer:
        alone = renderer.render(buffers=ALONE)
        with pytest.raises(InputError, match="unknown buffer 'imag' \\(did you mean 'image'"):
            renderer.render(buffers=("imag",))
    whole = irrsplat.render(room(sky=0.5), SIZE, **kind)
    for name in (*ALONE, *RECORDS):
        assert getattr(alone, name).tobytes() == getattr(whole, name).tobytes(), name
    assert alone.depth.shape == (0, 0) and alone.normal.shape == (0, 0, 3)
    assert alone.stats["records"] == whole.stats["records"] and alone.exposure == whole.exposure


@pytest.fixture
def peak(monkeypatch: pytest.MonkeyPatch) -> Callable[[], float]:
    """Peak bytes per pixel of SIZE, over textures of that size or of every other pixel."""
    live: dict[int, int] = {}
    most = [0]

    def follow(name: str, bytes_of: Callable[..., int]) -> None:
        make = getattr(moderngl.Context, name)

        def made(self: moderngl.Context, size: Any, *some: Any, **more: Any) -> Any:
            texture = make(self, size, *some, **more)
            if size in (SIZE, (SIZE[0] // 2, SIZE[1] // 2)):
                live[id(texture)] = size[0] * size[1] * bytes_of(*some, **more)
                kept.append(texture)  # keeps the ids unique
            most[0] = max(most[0], sum(n for t in kept if (n := live[id(t)]) and not isinstance(t.mglo, moderngl.InvalidObject)))
            return texture

        monkeypatch.setattr(moderngl.Context, name, made)

    kept: list[Any] = []
    follow("texture", lambda components, *_, **__: 4 * components)
    follow("depth_texture", lambda *_, **__: 4)
    return lambda: most[0] / (SIZE[0] * SIZE[1])


@pytest.mark.few_sites
@pytest.mark.parametrize(
    ("settings", "alone", "rounds"), [({}, True, 50), ({"bounces": "all"}, False, 1), ({"samples": 2}, True, 50)], ids=str
)
def test_what_a_view_needs_is_known_beforehand(
    large: None, peak: Callable[[], float], monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], alone: bool, rounds: int
) -> None:
    monkeypatch.setattr(whole_renders, "MOST_ROUNDS", rounds)
    kind = {**CHEAP, **settings}
    with Renderer(room(), SIZE, **kind) as renderer:
        renderer.render(buffers=ALONE if alone else None)
    need = memory.view_bytes(room(), preset("default", **kind))
    assert 0.7 * need <= peak() <= need, (peak(), need)


def test_what_does_not_fit_is_refused_before_anything_is_made(
    large: None, software: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if not software:
        pytest.skip("hardware has memory of its own, of which OpenGL does not tell")
    monkeypatch.setattr(memory, "available", lambda: 4_000_000_000)
    picture = str(tmp_path / "x.png")
    assert cli.main(["render", "--size", "8192", "8192", "-o", picture, "--tile-size", "0"]) == 2
    assert capsys.readouterr().err == (
        "irrsplat: size 8192x8192 needs 12.7 GB of memory, and 4.0 GB are free here: take a smaller size\n"
    )
    monkeypatch.setattr(memory, "available", lambda: 2_000_000_000)
    assert cli.main(["render", "--size", "4096", "4096", "-o", picture, "-o", str(tmp_path / "x.exr")]) == 2
    assert "or fewer buffers: a .png needs least" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(memory, "available", lambda: 1_000_000_000)
    with Renderer(room(), (8, 8), **FAST) as renderer:
        with pytest.raises(InputError, match="8192x8192 needs"):
            renderer.resize((8192, 8192))
        assert renderer.render().image.shape == (8, 8, 3), "it goes on as before"


def test_the_end_of_memory_ends_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def none(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(whole_renders, "render", none)
    assert cli.main(["render", "-o", str(tmp_path / "x.png")]) == 1
    err = capsys.readouterr().err
    assert err.startswith("irrsplat: out of memory; take a smaller --size") and err.count("\n") == 1


@pytest.mark.parametrize("kind", ["sky", get_args(BackdropKind)[-1]])
def test_a_picture_written_in_strips_is_the_whole_one(kind: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "_ROWS", 7)
    made: Frame = irrsplat.render(room(), (20, 24), **CHEAP, backdrop=kind)
    made.save(tmp_path / "x.png")
    written = np.asarray(Image.open(tmp_path / "x.png"))
    assert np.array_equal(written, files.dithered(made.picture))
