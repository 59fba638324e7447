"""Films by `render`: what is in the file, and that it appears whole or not at all."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

import irrsplat
from irrsplat.app import cli
from irrsplat.app.film import video
from irrsplat.app.film.background import FilmInBackground, FilmJob
from irrsplat.core.timing import other_process
from irrsplat.core.timing.clock import use_clock
from irrsplat.scene.camera_path import Path as CameraPath
from tests.app.film.test_fill import RENDER
from tests.app.film.test_fill import filled as filled
from tests.app.film.test_fill import place as place
from tests.support.counted_clock import RayClock

av = pytest.importorskip("av")
COLOURS = [(255, 255, 255), (0, 0, 0), (128, 128, 128), (200, 40, 30), (40, 160, 60), (20, 30, 180)]  # of a frame each, sRGB


@pytest.fixture
def pictures(tmp_path: Path) -> list[Path]:
    """Write six frames of odd size, each of one colour; return their files."""
    for number, colour in enumerate(COLOURS):
        Image.new("RGB", (51, 37), colour).save(tmp_path / f"{number}.png")
    return [tmp_path / f"{number}.png" for number in range(len(COLOURS))]


def decoded(path: Path) -> tuple[Any, list[np.ndarray]]:
    """Return the film's description, and its frames (H, W, 3) in sRGB, converted by the film's colour matrix and range."""
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        frames = list(file.decode(stream))
        about = stream.codec_context.color_primaries, stream.codec_context.color_trc, frames[0].colorspace, frames[0].color_range
        return (stream.average_rate, file.duration / 1e6, about), [frame.to_ndarray(format="rgb24") for frame in frames]


def test_a_film_has_its_colours_its_length_and_every_frame(pictures: list[Path], tmp_path: Path) -> None:
    """Flat colours come back to within the rounding of 8 bits of YUV at limited range. Twice the same pictures are the same
    bytes."""
    films = [tmp_path / f"{name}.mp4" for name in "ab"]
    for film in films:
        video.write(str(film), pictures, Fraction(10))
    (rate, seconds, about), frames = decoded(films[0])
    assert films[0].read_bytes() == films[1].read_bytes() and sorted(tmp_path.glob(".irr*")) == []
    assert rate == 10 and seconds == pytest.approx(0.6, abs=0.011)
    assert len(frames) == len(COLOURS)
    assert frames[0].shape == (38, 52, 3)
    assert about == (1, 13, 1, 1)  # BT.709, sRGB, BT.709, limited
    for frame, colour in zip(frames, COLOURS, strict=True):
        assert np.abs(frame.astype(int) - colour).max() <= 3


def test_a_failed_film_keeps_the_earlier_file(pictures: list[Path], tmp_path: Path) -> None:
    Image.new("RGB", (20, 20)).save(pictures[3])
    (tmp_path / "a.mp4").write_bytes(b"before")
    with pytest.raises(irrsplat.IrrsplatError, match=r"3\.png: a frame of another size"):
        video.write(str(tmp_path / "a.mp4"), pictures, Fraction(30))
    pictures[3].write_bytes(pictures[2].read_bytes()[:60])
    with pytest.raises(irrsplat.IrrsplatError, match=r"3\.png: a damaged picture"):
        video.write(str(tmp_path / "a.mp4"), pictures, Fraction(30))
    assert (tmp_path / "a.mp4").read_bytes() == b"before" and len(list(tmp_path.iterdir())) == len(COLOURS) + 1


def test_a_film_is_the_same_with_and_without_pictures_that_stay(place: Path) -> None:
    """Its temporary pictures are removed."""
    assert cli.main([*RENDER, "--frames", "0:3", "-o", "a.mp4"]) == 0
    assert cli.main([*RENDER, "--frames", "0:3", "-o", "s{frame}.png", "-o", "b.mp4"]) == 0
    assert (place / "a.mp4").read_bytes() == (place / "b.mp4").read_bytes()
    assert list(place.glob(".film-*")) == []


def test_a_film_estimates_its_time_by_the_frames_after_the_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first frame gathers most records. After it, 20 frames take a minute, so that 79 take about 4."""
    calling = SimpleNamespace(share=0.005, release=lambda: None, is_alive=lambda: True)
    monkeypatch.setattr(other_process, "Calling", lambda *job: calling)
    film, ticking, scene = FilmInBackground(), RayClock(1.0), irrsplat.load("cornell")
    with use_clock(ticking):
        film.begin(str(tmp_path / "film.mp4"), FilmJob(scene, CameraPath((scene.camera(),) * 2, 100), (33, 24), "preview", {}))
        ticking.advance(1000.0)
        for share, expected in ((0.005, "0 of 100"), (0.01, "1 of 100"), (0.21, "21 of 100, about 4 min left")):
            calling.share = share
            film.update(lambda text, topic: None)
            assert film.progress == f"film: frame {expected}"
            ticking.advance(60.0)
    film.release()


@pytest.mark.parametrize(("end", "last"), [("whole", "is written"), ("stopped", ""), ("failed", "the film failed (status 1: no")])
def test_a_film_in_the_background_is_complete_or_absent(
    end: str, last: str, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A separate process writes a film of three frames; a stopped or failed process leaves the folder empty."""
    monkeypatch.setattr(other_process, "_JOIN", None)  # without a limit: load may delay the end
    film, messages, scene = FilmInBackground(), [""], irrsplat.load(place / "room.scene")
    if end == "failed":
        monkeypatch.setattr(other_process, "code", lambda work: "raise SystemExit('no memory')")
    path = CameraPath((scene.camera(),) * 2, 3)
    film.begin(str(tmp_path / "film.mp4"), FilmJob(scene, path, (33, 24), "preview", {"bounces": 0}))
    if end == "stopped":
        film.release()
    try:
        while film.busy:
            film.update(lambda text, topic: messages.append(text))
    except irrsplat.IrrsplatError as error:
        messages.append(str(error))
    assert last in messages[-1] and [path.name for path in tmp_path.iterdir()] == ["film.mp4"] * (end == "whole")
    if end == "whole":
        with av.open(tmp_path / "film.mp4") as file:
            assert [frame.height for frame in file.decode(video=0)] == [24, 24, 24]
