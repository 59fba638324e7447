"""`irrsplat verify`: a rendering held against the truth of a path tracer, as a table and as pictures."""

from __future__ import annotations

import os
import time
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from irrsplat import output
from irrsplat.app.terminal import progress, say
from irrsplat.display import tonemap
from irrsplat.errors import InputError, IrrsplatError
from irrsplat.reference.process import INSTALL
from irrsplat.reference.traced import NOTHING, Traced, compare, errors, side_of, traced

if TYPE_CHECKING:
    from irrsplat.output import Frame
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera, Scene

FULL = 0.2  # of the mean irradiance: the error that is shown in full colour
BRIGHT, DARK, GREY = (178, 24, 43), (33, 102, 172), (120, 120, 120)  # too much, too little, no surface
PIXELS_PER_DEGREE = 67.0  # of FLIP: a screen 0.7 m wide with 3840 pixels, seen from 0.7 m
GATHERED, SECONDS = 1000, 60.0  # of --truth gather: pixels, and the time after which fewer must do

Row = tuple[str, str, str]


def run(scene: Scene, camera: Camera, args: Namespace) -> int:
    """Render, compare, print the table and write the pictures; args: as parser.parse gives them. Returns the exit status 0.

    Raises InputError and IrrsplatError, one line, for what cannot be; KeyboardInterrupt where the user ended it.
    """
    check(args)
    import irrsplat

    for notice in scene.notices:
        say(f"notice: {notice}")
    with irrsplat.Renderer(scene, size=tuple(args.size), preset=args.preset, **args.values) as renderer:
        by_trace = args.truth == "trace"
        frame, rows = (_against_trace if by_trace else _against_gather)(renderer, scene, camera, args)
    stats = frame.stats
    if stats.get("interrupted"):
        raise KeyboardInterrupt
    if not stats.get("converged", True):
        say(f"notice: stopped after {stats.get('rounds')} rounds before every pixel was served; raise --max-rounds or --a")
    width, height = args.size
    truth = "path-traced truth" if by_trace else "a fine gather without interpolation"
    print(f"{scene.name}, {width} x {height}, preset {args.preset}, one indirect bounce, against {truth}")
    rows.insert(1, ("records", f"{stats.get('records', 0):,}", ""))
    for name, value, remark in rows:
        print(f"  {name:<18} {value:>10}  {remark}".rstrip())
    return 0


def check(args: Namespace) -> None:
    """Raises InputError for what can be told to be wrong before anything is rendered."""
    if args.values.get("bounces") == 0:
        raise InputError("--bounces 0: there is no indirect light to verify; leave it out")
    side_of(args.samples)
    if args.output is None:
        return
    if args.truth == "gather":
        raise InputError("--truth gather knows some pixels only, which make no picture; leave -o out, or take --truth trace")
    ending = os.path.splitext(args.output)[1].lower()
    if ending in output.ENDINGS and ending != ".png":
        raise InputError("verify writes a .png or a folder of them (no ending)", args.output)
    output.check_writable(args.output)


def _silent(share: float, words: str) -> None:
    """Progress where nobody watches."""


def _against_trace(renderer: Renderer, scene: Scene, camera: Camera, args: Namespace) -> tuple[Frame, list[Row]]:
    start, (width, height) = time.perf_counter(), args.size
    was_traced: list[float] = []
    with progress() as told:
        tell = told or _silent

        def show(share: float) -> None:
            was_traced[:] = [share]
            tell(share, "tracing the truth")

        said = lambda line: say(f"notice: {line}")  # noqa: E731
        try:
            truth = traced(scene, camera, (width, height), args.samples, show, said)
        except InputError:
            raise
        except IrrsplatError as error:
            raise IrrsplatError(f"{error}; or compare with --truth gather, which does without") from error
        seconds = time.perf_counter() - start
        if not truth.valid.any():
            raise InputError(NOTHING)
        frame = renderer.render(camera, progress=lambda now: tell(now.coverage, f"rendering: {now.records} records"))
    found = compare(frame, truth)
    shown = tonemap(truth.picture, frame.exposure), tonemap(frame.direct + frame.indirect + frame.emission, frame.exposure)
    flip = _flip(*shown)
    count = int(truth.valid.sum())
    rows = [
        ("pixels compared", f"{count:,}", f"of {width * height:,}; edges and what is no surface are left out"),
        *_table(found, float(frame.irradiance[truth.valid].mean()), float(truth.irradiance[truth.valid].mean())),
        ("direct light RMSE", _percent(found["direct"]), "away from shadow edges"),
        ("truth", f"{2 * side_of(args.samples) ** 2:,}", "samples of each kind per pixel, " + _origin(was_traced, seconds)),
    ]
    rows.insert(3, ("noise of the truth", _percent(truth.noise), "its own relative RMSE, by two independent halves"))
    if flip is not None:
        rows.insert(-1, ("FLIP", f"{flip[1]:.4f}", f"of the tone-mapped pictures, {PIXELS_PER_DEGREE:g} pixels a degree"))
    if args.output is not None and not frame.stats.get("interrupted"):
        _write(args.output, shown, signed_error(frame.irradiance, truth), None if flip is None else flip[0])
    if flip is None:
        say(f"notice: FLIP is left out; run: {INSTALL}")
    return frame, rows


def _against_gather(renderer: Renderer, scene: Scene, camera: Camera, args: Namespace) -> tuple[Frame, list[Row]]:
    """The renderer's own fine gather at random pixels as the truth: it tells of placement and interpolation alone."""
    from irrsplat import exact, paper

    with progress() as told:
        tell = told or _silent
        frame = renderer.render(camera, progress=lambda now: tell(now.coverage, f"rendering: {now.records} records"))
    view, _ = renderer.frame(camera, gather=False)
    seen = paper.read_back(view.gbuffer)
    size = renderer.settings.shadow_size
    truth = exact.gather(renderer.ctx, scene, renderer.geometry, seen, size, GATHERED, SECONDS)
    if not len(truth.pixels):
        raise InputError(NOTHING)
    E = frame.irradiance[tuple(truth.pixels.T)]
    rows = [
        ("pixels compared", f"{len(E):,}", "at random, away from edges"),
        *_table(errors(E, truth.irradiance), float(E.mean()), float(truth.irradiance.mean())),
        ("truth", f"{6 * exact.SIDE**2 // 2:,}", "directions a pixel, by the renderer's own shadow maps and rasters"),
    ]
    return frame, rows


def _table(found: dict[str, float | None], mean: float, mean_ref: float) -> list[Row]:
    return [
        ("relative RMSE", _percent(found["rmse"]), "of irradiance, over the truth's mean"),
        ("bias of the mean", _percent(found["bias"], "+"), f"{mean:.4g} W/m² where {mean_ref:.4g} is true"),
        ("off by > 30 %", _percent(found["outliers"]), "of the pixels, measured by the mean"),
    ]


def _percent(share: float | None, sign: str = "") -> str:
    return "no light" if share is None else f"{100.0 * share:{sign}.2f} %"


def _origin(was_traced: list[float], seconds: float) -> str:
    return f"traced in {seconds:.0f} s" if was_traced else "traced before and kept"


def _flip(truth: np.ndarray, picture: np.ndarray) -> tuple[np.ndarray, float] | None:
    """FLIP (Andersson et al. 2020) of two (H, W, 3) display images 0..1: its map as (H, W, 3) colours, and its mean.

    None where the package `flip-evaluator` is missing.
    """
    try:
        import flip_evaluator
    except ImportError:
        return None
    one, other = (np.ascontiguousarray(it, np.float32) for it in (truth, picture))
    shown, mean, _ = flip_evaluator.evaluate(one, other, "LDR", parameters={"ppd": PIXELS_PER_DEGREE})
    return np.asarray(shown), float(mean)


# ---- pictures ------------------------------------------------------------------------------------------------------------


def signed_error(irradiance: np.ndarray, truth: Traced) -> np.ndarray:
    """(H, W, 3) display colours 0..1 of the error of `irradiance` (H, W, 3), averaged over the channels: white where it is
    right, red where it is too bright and blue where too dark, in full at FULL of the truth's mean; grey where nothing is seen.
    """
    mean = float(truth.irradiance[truth.valid].mean()) or 1.0
    error = (irradiance - truth.irradiance).mean(axis=-1, keepdims=True) / (FULL * mean)
    end = np.where(error > 0.0, np.array(BRIGHT) / 255.0, np.array(DARK) / 255.0)
    colour = 1.0 + np.clip(np.abs(error), 0.0, 1.0) * (end - 1.0)
    return np.where(truth.seen[..., None], colour, np.array(GREY) / 255.0)


def _write(name: str, shown: tuple[np.ndarray, np.ndarray], error: np.ndarray, flip: np.ndarray | None) -> None:
    """A .png with truth, picture and error side by side, or a folder with one of each, and FLIP's map."""
    if output.check_writable(name):
        output.write_picture(name, _with_legend(np.concatenate([*shown, error], axis=1)))
        return
    pictures = {"truth": shown[0], "picture": shown[1], "error": _with_legend(error)} | ({} if flip is None else {"flip": flip})
    try:
        Path(name).mkdir(exist_ok=True)
    except OSError as failed:
        raise IrrsplatError(f"{name}: cannot write: {failed.strerror or failed}") from failed
    for stem, picture in pictures.items():
        output.write_picture(Path(name) / f"{stem}.png", picture)


def _with_legend(picture: np.ndarray) -> np.ndarray:
    """(H', W, 3): the scale of `signed_error` in words below a picture."""
    from PIL import Image

    from irrsplat.pen import legend_height, write_legend

    share = f"{100.0 * FULL:g} % of the mean irradiance or more"
    lines = ((BRIGHT, f"too bright by {share}"), (DARK, f"too dark by {share}"), (GREY, "no surface; white is right"))
    height, width = picture.shape[:2]
    font = min(max(width / 28.0, 9.0), 16.0)
    image = Image.new("RGB", (width, height + legend_height(font, lines)), (255, 255, 255))
    image.paste(Image.fromarray(np.round(picture * 255.0).astype(np.uint8)))
    write_legend(image, height, font, lines)
    return np.asarray(image) / 255.0
