"""Films by `render`: what is in the file, and that it has the same bytes whole, split, and after a process was killed."""

from __future__ import annotations

import json
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import irrsplat
from irrsplat.app import cli
from irrsplat.app.film import background, video
from irrsplat.app.film.background import FilmInBackground, FilmJob
from irrsplat.app.film.kept import KeptFrames
from irrsplat.scene.camera_path import Path as CameraPath
from tests.app.film.test_fill import RENDER
from tests.app.film.test_fill import filled as filled
from tests.app.film.test_fill import place as place

av = pytest.importorskip("av")
HANGS = """
import sys
from irrsplat.app import cli
from irrsplat.app.common.pictures import Pictures

def save(self, name, *rest, whole=Pictures.save):
    whole(self, name, *rest)
    if name.endswith("000002.png"):
        print("saved", flush=True)
        sys.stdin.read()

Pictures.save = save
cli.main(sys.argv[1:])
"""  # the command line, which waits for the end of its input after frame 2
COLOURS = [(255, 255, 255), (0, 0, 0), (128, 128, 128), (200, 40, 30), (40, 160, 60), (20, 30, 180)]  # of a frame each, sRGB


@pytest.fixture
def pictures(tmp_path: Path) -> list[Path]:
    """Six frames of odd size, each of one colour."""
    for number, colour in enumerate(COLOURS):
        Image.new("RGB", (51, 37), colour).save(tmp_path / f"{number}.png")
    return [tmp_path / f"{number}.png" for number in range(len(COLOURS))]


def decoded(path: Path) -> tuple[Any, list[np.ndarray]]:
    """Return the film's description, and its frames as (H, W, 3) sRGB by the matrix and range that it names."""
    with av.open(str(path)) as file:
        stream = file.streams.video[0]
        frames = list(file.decode(stream))
        about = stream.codec_context.color_primaries, stream.codec_context.color_trc, frames[0].colorspace, frames[0].color_range
        return (stream.average_rate, file.duration / 1e6, about), [frame.to_ndarray(format="rgb24") for frame in frames]


@pytest.mark.parametrize("ending", video.ENDINGS)
def test_a_film_has_its_colours_its_length_and_every_frame(ending: str, pictures: list[Path], tmp_path: Path) -> None:
    """Flat colours come back to within the rounding of 8 bits: of YUV at limited range, 2, and of a GIF's palette, 1. Twice the
    same pictures are the same bytes."""
    films = [tmp_path / f"{name}{ending}" for name in "ab"]
    for film in films:
        video.write(str(film), pictures, video.Encoding(Fraction(10), "best"))
    (rate, seconds, about), frames = decoded(films[0])
    assert films[0].read_bytes() == films[1].read_bytes() and sorted(tmp_path.glob(".irr*")) == []
    assert rate == 10 and seconds == pytest.approx(0.6, abs=0.011)
    assert len(frames) == len(COLOURS)
    assert frames[0].shape == ((38, 52, 3) if ending == ".mp4" else (37, 51, 3))
    assert about == ((2, 2, 2, 0) if ending == ".gif" else (1, 13, 1, 1))  # BT.709, sRGB, BT.709, limited
    for frame, colour in zip(frames, COLOURS, strict=True):
        assert np.abs(frame.astype(int) - colour).max() <= (1 if ending == ".gif" else 3)


def test_a_film_appears_whole_or_not_at_all(pictures: list[Path], tmp_path: Path) -> None:
    Image.new("RGB", (20, 20)).save(pictures[3])
    (tmp_path / "a.mp4").write_bytes(b"before")
    with pytest.raises(irrsplat.IrrsplatError, match=r"3\.png: a frame of another size"):
        video.write(str(tmp_path / "a.mp4"), pictures, video.Encoding())
    pictures[3].write_bytes(pictures[2].read_bytes()[:60])
    with pytest.raises(irrsplat.IrrsplatError, match=r"3\.png: a damaged picture"):
        video.write(str(tmp_path / "a.mp4"), pictures, video.Encoding())
    assert (tmp_path / "a.mp4").read_bytes() == b"before" and len(list(tmp_path.iterdir())) == len(COLOURS) + 1


@pytest.mark.long
def test_a_film_is_the_same_whole_split_and_after_a_kill(place: Path) -> None:
    """In one go; of frames that two others rendered; and gone on with after kill -9 in the midst of it, by frames that stayed."""
    assert cli.main([*RENDER, "-o", "whole.mp4", "-o", "whole.gif"]) == 0
    assert not (place / "whole.mp4.frames").exists()
    for frames in ("4:8", "0:4"):
        assert cli.main([*RENDER, "--frames", frames, "-o", "s{frame}.png"]) == 0
    assert cli.main([*RENDER, "-o", "s{frame}.png", "-o", "split.mp4", "-o", "split.gif", "--resume", "--stats", "s.json"]) == 0
    assert json.loads((place / "s.json").read_text())["frames"] == []
    kept = place / "killed.mp4.frames"
    command = [sys.executable, "-c", HANGS, *RENDER, "-o", "killed.mp4"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as killed:
        assert killed.stdout is not None and killed.stdout.readline() == "saved\n"
        killed.kill()
    assert len(list(kept.glob("0*.png"))) == 3 and not (place / "killed.mp4").exists()
    assert cli.main([*RENDER, "-o", "killed.mp4", "--resume", "--stats", "k.json"]) == 0
    assert [stats["frame"] for stats in json.loads((place / "k.json").read_text())["frames"]] == [3, 4, 5, 6, 7]
    assert not kept.exists()
    whole = (place / "whole.mp4").read_bytes()
    assert whole == (place / "split.mp4").read_bytes() == (place / "killed.mp4").read_bytes()
    assert (place / "whole.gif").read_bytes() == (place / "split.gif").read_bytes()


def test_frames_by_other_settings_are_not_gone_on_with(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nor are those that are there without --resume; and a folder of somebody else's stays."""
    two = [*RENDER, "--frames", "0:2", "-o", "o.webm"]
    assert cli.main(two) == 0
    film = (place / "o.webm").read_bytes()
    assert cli.main([*RENDER, "--frames", "0:2", "-o", "s{frame}.png"]) == 0
    assert cli.main([*RENDER, "--frames", "0:2", "-o", "s{frame}.png", "-o", "s.webm", "--resume", "--stats", "s.json"]) == 0
    assert json.loads((place / "s.json").read_text())["frames"] == [] and (place / "s.webm").read_bytes() == film
    for flags, said in ((["--resume"], "it begins anew"), ([], "")):
        kept = KeptFrames.beside("o.webm")
        kept.begin("another", resume=False)
        Image.new("RGB", (48, 48), (255, 0, 0)).save(kept.folder / "000000.png")
        assert cli.main([*two, *flags]) == 0
        err = capsys.readouterr().err
        assert said in err and err.count("\n") == (1 if said else 0)
        assert (place / "o.webm").read_bytes() == film and not kept.folder.exists()
    kept.folder.mkdir()
    (kept.folder / "mine").touch()
    assert cli.main(two) == 2
    assert "something else is in the way" in capsys.readouterr().err and (kept.folder / "mine").exists()


def test_resume_skips_pictures_that_are_there(place: Path) -> None:
    """Also without a frozen cache; the exposure is the first frame's all the same."""
    gathering = [word for word in RENDER if word not in ("--cache-mode", "frozen", "--cache", "film.cache")]
    assert cli.main([*gathering, "--frames", "0:2", "-o", "r{frame}.png", "--stats", "r.json"]) == 0
    first = json.loads((place / "r.json").read_text())["frames"]
    mine = (place / "r0.png").read_bytes() + b"mine"
    (place / "r0.png").write_bytes(mine)
    (place / "r1.png").unlink()
    assert cli.main([*gathering, "--frames", "0:2", "-o", "r{frame}.png", "--resume", "--stats", "q.json"]) == 0
    (again,) = json.loads((place / "q.json").read_text())["frames"]
    assert again["frame"] == 1 and again["exposure"] == first[0]["exposure"]
    assert (place / "r0.png").read_bytes() == mine and (place / "r1.png").is_file()


@pytest.mark.parametrize(("end", "last"), [("whole", "is written"), ("stopped", ""), ("failed", "the film failed (status 1: no")])
def test_a_film_in_the_background_is_whole_or_absent(
    end: str, last: str, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its own process makes three frames; stopped or failed, it leaves the folder empty."""
    film, said, scene = FilmInBackground(), [""], irrsplat.load(place / "room.scene")
    if end == "failed":
        monkeypatch.setattr(background, "_MAIN", "raise SystemExit('no memory')")
    path = CameraPath((scene.camera(),) * 2, 3)
    film.begin(str(tmp_path / "film.mp4"), FilmJob(scene, path, (33, 24), "preview", {"bounces": 0}))
    if end == "stopped":
        film.release()
    try:
        while film.busy:
            film.update(lambda text, topic: said.append(text))
    except irrsplat.IrrsplatError as error:
        said.append(str(error))
    assert last in said[-1] and [path.name for path in tmp_path.iterdir()] == ["film.mp4"] * (end == "whole")
    if end == "whole":
        with av.open(tmp_path / "film.mp4") as file:
            assert [frame.height for frame in file.decode(video=0)] == [24, 24, 24]
