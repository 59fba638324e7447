"""Films by `render`: what is in the file, and that it has the same bytes whole, split, and after a process was killed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import irrsplat
from irrsplat.app import cli
from irrsplat.app.film import video
from irrsplat.app.film.kept import KeptFrames
from irrsplat.app.film.words import QUALITIES
from tests.app.film.test_fill import RENDER
from tests.app.film.test_fill import filled as filled
from tests.app.film.test_fill import place as place

av = pytest.importorskip("av")
HANGS = """
import sys, time
from irrsplat.app import cli
from irrsplat.app.common.pictures import Pictures

def save(self, name, *rest, whole=Pictures.save):
    whole(self, name, *rest)
    time.sleep(60.0 if name.endswith("000002.png") else 0.0)

Pictures.save = save
cli.main(sys.argv[1:])
"""  # the command line, which gets no further than frame 2
COLOURS = [(255, 255, 255), (0, 0, 0), (128, 128, 128), (200, 40, 30), (40, 160, 60), (20, 30, 180)]  # of a frame each, sRGB


@pytest.fixture
def pictures(tmp_path: Path) -> list[Path]:
    """Six frames of odd size, each of one colour."""
    for number, colour in enumerate(COLOURS):
        Image.new("RGB", (51, 37), colour).save(tmp_path / f"{number}.png")
    return [tmp_path / f"{number}.png" for number in range(len(COLOURS))]


def decoded(path: Path) -> tuple[Any, list[np.ndarray]]:
    """What the film says of itself, and its frames as (H, W, 3) sRGB by the matrix and range that it names."""
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


def test_quality_is_bytes_against_error(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (48, 48, 3), np.uint8)
    Image.fromarray(noise).save(tmp_path / "0.png")
    sizes, errors = [], []
    for quality in QUALITIES:
        video.write(str(tmp_path / "a.mp4"), [tmp_path / "0.png"] * 2, video.Encoding(quality=quality))
        sizes.append((tmp_path / "a.mp4").stat().st_size)
        errors.append(np.abs(decoded(tmp_path / "a.mp4")[1][1].mean(2) - noise.mean(2)).mean())
    assert sizes[0] < sizes[1] < sizes[2] and errors[0] > errors[1] > errors[2]


def test_equal_pictures_give_equal_films(tmp_path: Path) -> None:
    """Whatever lies in the memory that the encoder asks for; glibc fills it with one byte or another."""
    rows, columns = np.mgrid[:240, :320]
    pictures = []
    for i in range(6):
        red, green, blue = np.sin((columns + 3 * i) / 19), np.cos((rows - 2 * i) / 17), np.sin(columns * rows / 900)
        Image.fromarray((128 + 100 * np.stack([red, green, blue], -1)).astype(np.uint8)).save(tmp_path / f"{i}.png")
        pictures.append(str(tmp_path / f"{i}.png"))
    program = (
        "import sys; from pathlib import Path; from irrsplat.app.film import video; "
        "[video.write(sys.argv[1] + e, [Path(p) for p in sys.argv[2:]], video.Encoding()) for e in video.ENDINGS]"
    )
    for fill in ("85", "170"):
        environment = os.environ | {"MALLOC_PERTURB_": fill}
        subprocess.run([sys.executable, "-c", program, str(tmp_path / fill), *pictures], check=True, env=environment)
    for ending in video.ENDINGS:
        assert (tmp_path / f"85{ending}").read_bytes() == (tmp_path / f"170{ending}").read_bytes(), ending


def test_a_film_appears_whole_or_not_at_all(pictures: list[Path], tmp_path: Path) -> None:
    Image.new("RGB", (20, 20)).save(pictures[3])
    (tmp_path / "a.mp4").write_bytes(b"before")
    with pytest.raises(irrsplat.IrrsplatError, match=r"3\.png: a frame of another size"):
        video.write(str(tmp_path / "a.mp4"), pictures, video.Encoding())
    pictures[3].write_bytes(pictures[2].read_bytes()[:60])
    with pytest.raises(irrsplat.IrrsplatError, match=r"3\.png: a damaged picture"):
        video.write(str(tmp_path / "a.mp4"), pictures, video.Encoding())
    assert (tmp_path / "a.mp4").read_bytes() == b"before" and len(list(tmp_path.iterdir())) == len(COLOURS) + 1


def test_a_film_is_the_same_whole_split_and_after_a_kill(place: Path) -> None:
    """In one go; of frames that two others rendered; and gone on with after kill -9 in the midst of it, by frames that stayed."""
    assert cli.main([*RENDER, "-o", "whole.mp4", "-o", "whole.gif"]) == 0
    assert not (place / "whole.mp4.frames").exists()
    for frames in ("4:8", "0:4"):
        assert cli.main([*RENDER, "--frames", frames, "-o", "s{frame}.png"]) == 0
    assert cli.main([*RENDER, "-o", "s{frame}.png", "-o", "split.mp4", "-o", "split.gif", "--resume", "--stats", "s.json"]) == 0
    assert json.loads((place / "s.json").read_text())["frames"] == []
    kept = place / "killed.mp4.frames"
    killed = subprocess.Popen([sys.executable, "-c", HANGS, *RENDER, "-o", "killed.mp4"])
    try:
        for _ in range(1200):
            if len(list(kept.glob("0*.png"))) == 3 or killed.poll() is not None:
                break
            time.sleep(0.05)
    finally:
        killed.kill()
        killed.wait()
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
    assert cli.main([*gathering, "--frames", "0:3", "-o", "r{frame}.png", "--stats", "r.json"]) == 0
    first = json.loads((place / "r.json").read_text())["frames"]
    mine = (place / "r0.png").read_bytes() + b"mine"
    (place / "r0.png").write_bytes(mine)
    (place / "r1.png").unlink()
    assert cli.main([*gathering, "--frames", "0:3", "-o", "r{frame}.png", "--resume", "--stats", "q.json"]) == 0
    (again,) = json.loads((place / "q.json").read_text())["frames"]
    assert again["frame"] == 1 and again["exposure"] == first[0]["exposure"]
    assert (place / "r0.png").read_bytes() == mine and (place / "r1.png").is_file()


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["-o", "x.mp4"], "a film needs a flight"),
        (["-o", "x.png", "--resume"], "--resume goes on with the frames of a flight"),
        (["--turntable", "4", "-o", "x{frame}.png", "--fps", "24"], "--fps is for a film"),
        (["--turntable", "4", "-o", "x.mp4", "--fps", "0"], "frames per second, 0.1 to 240"),
        (["--turntable", "4", "-o", "x{frame}.mp4"], "no {frame} in its name"),
        (["--turntable", "4", "-o", "x.gif", "--backdrop", "clear"], "films have no alpha"),
        (["--turntable", "1", "-o", "x.gif"], "2 to 999999"),
        (["--turntable", "4", "-o", "none/x.gif"], "does not exist"),
    ],
)
def test_what_cannot_be_a_film_is_refused(flags: list[str], said: str, place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["render", "room.scene", *flags]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1 and not list(place.glob("x*"))


def test_without_the_extra_it_is_said_which(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(video, "find_spec", lambda name: None)
    assert cli.main([*RENDER, "-o", "x.mp4"]) == 2
    assert capsys.readouterr().err == "irrsplat: x.mp4: to write films: pip install 'irrsplat[video]'\n"
