"""`irrsplat verify`: comparison of a rendering with a path-traced reference, as a table and as a picture."""

from __future__ import annotations

import os
import time
from argparse import Namespace

import numpy as np

from irrsplat.app.common.terminal import OnShare, out, progress, say
from irrsplat.core import files
from irrsplat.core.errors import InputError
from irrsplat.image.tonemap import BRIGHT, DARK, FULL, GREY, error_colours, tonemap
from irrsplat.reference.truth import NOTHING, Traced, compare, in_words, side_of, traced
from irrsplat.scene.model import Camera, Scene
from irrsplat.settings import preset

Row = tuple[str, str, str]


def check(args: Namespace) -> None:
    """Raise InputError for errors that show before any rendering."""
    if preset(args.preset, **args.values).bounces == 0:
        raise InputError("--bounces 0: there is no indirect light to verify; leave it out")
    side_of(args.samples)
    if args.output is not None:
        if os.path.splitext(args.output)[1].lower() != ".png":
            raise InputError("verify writes a .png", args.output)
        files.check_file(args.output)


def run(scene: Scene, camera: Camera, args: Namespace) -> int:
    """Render, compare, print the table and write the picture; return the exit status 0. args: as from grammar.parse.

    Raises InputError and IrrsplatError for invalid input; KeyboardInterrupt if the user interrupts.
    """
    scene = scene.recentred
    camera, scene = camera.shifted([-v for v in scene.origin]), scene.local
    for notice in scene.notices:
        say(f"notice: {notice}")
    import irrsplat

    with (
        irrsplat.Renderer(scene, size=tuple(args.size), preset=args.preset, tile_size=0, **args.values) as renderer,
        progress() as line,
    ):
        truth, origin = _trace(scene, camera, args, line)
        show = None if line is None else lambda now: line(now.coverage, f"rendering: {now.records} records")
        frame = renderer.render(camera, progress=show)
    stats = frame.stats
    if stats.get("interrupted"):
        raise KeyboardInterrupt
    if not stats.get("converged", True):
        say(f"notice: stopped after {stats.get('rounds')} rounds before every pixel was covered; raise --a")
    found, (width, height) = compare(frame, truth), args.size
    mean, mean_ref = (float(E[truth.valid].mean()) for E in (frame.irradiance, truth.irradiance))
    rows: list[Row] = [
        ("pixels compared", f"{int(truth.valid.sum()):,}", f"of {width * height:,}; without edges and background"),
        ("records", f"{stats.get('records', 0):,}", ""),
        ("relative RMSE", _percent(found["rmse"]), "of irradiance, relative to the mean of the reference"),
        ("noise of reference", _percent(truth.noise), "relative RMSE of the reference, from two independent halves"),
        ("RMSE without it", _percent(found["net"]), "error of the rendering without that noise"),
        ("bias of the mean", _percent(found["bias"], "+"), f"{mean:.4g} W/m², reference {mean_ref:.4g}"),
        ("off by > 30 %", _percent(found["outliers"]), "of the pixels, relative to the mean"),
        ("off by > 20 %", _percent(found["spots"]), "of the pixels, relative to the local mean of the reference: spots"),
        ("direct light RMSE", _percent(found["direct"]), "away from shadow edges"),
        ("albedo", f"{found['albedo']:.4f}", "median difference from the path tracer's texture lookup"),
        ("normal", f"{found['normal']:.2f} °", "median angle between the normals, with normal maps"),
        ("reference", f"{2 * side_of(args.samples) ** 2:,}", f"samples of each kind per pixel, {origin}"),
    ]
    bounces = in_words(preset(args.preset, **args.values).bounces)
    out(f"{scene.name}, {width} x {height}, preset {args.preset}, {bounces}, against a path-traced reference")
    for name, value, remark in rows:
        out(f"  {name:<18} {value:>10}  {remark}".rstrip())
    if args.output is not None:
        mixed = args.values.get("blend", 0.5) != 0.5  # direct against indirect light: the reference has both at full weight
        radiance = frame.direct + frame.indirect + frame.emission if mixed else frame.image
        # Outside surfaces, both show the renderer's background
        expected = np.where(truth.seen[..., None], truth.picture, radiance)
        shown = tonemap(expected, frame.exposure), tonemap(radiance, frame.exposure)
        _write(args.output, *shown, signed_error(frame.irradiance, truth))
    return 0


def _trace(scene: Scene, camera: Camera, args: Namespace, line: OnShare | None) -> tuple[Traced, str]:
    """Return the reference for the command line `args`, and its origin in words.

    line: a progress line, if any. Raises InputError without comparable pixels, IrrsplatError without a path tracer.
    """
    start = time.perf_counter()
    was_traced: list[float] = []

    def show(share: float) -> None:
        was_traced[:] = [share]
        if line is not None:
            line(share, "tracing the reference")

    bounces = preset(args.preset, **args.values).bounces
    truth = traced(scene, camera, tuple(args.size), bounces, args.samples, show, lambda words: say(f"notice: {words}"))
    if not truth.valid.any():
        raise InputError(NOTHING)
    return truth, f"traced in {time.perf_counter() - start:.0f} s" if was_traced else "traced before and kept"


def _percent(share: float | None, sign: str = "") -> str:
    """Return a share in percent, or "no light" for None."""
    return "no light" if share is None else f"{100.0 * share:{sign}.2f} %"


def signed_error(irradiance: np.ndarray, truth: Traced) -> np.ndarray:
    """Return display colours (H, W, 3) in 0..1 of the error of `irradiance` (H, W, 3), averaged over the channels.

    White is exact, red too bright, blue too dark, saturated at FULL of the reference's mean; grey is background.
    """
    mean = float(truth.irradiance[truth.valid].mean()) or 1.0
    error = (irradiance - truth.irradiance).mean(axis=-1) / (FULL * mean)
    return np.where(truth.seen[..., None], error_colours(error), np.array(GREY) / 255.0)


def _write(name: str, expected: np.ndarray, picture: np.ndarray, error: np.ndarray) -> None:
    """Write a .png with reference, picture and error (H, W, 3) side by side, and the scale of `signed_error` below."""
    from PIL import Image

    from irrsplat.image.false_colours import legend_height, write_legend

    share = f"{100.0 * FULL:g} % of the mean irradiance or more"
    lines = ((BRIGHT, f"too bright by {share}"), (DARK, f"too dark by {share}"), (GREY, "no surface; white is right"))
    strip = np.concatenate([expected, picture, error], axis=1)
    height, width = strip.shape[:2]
    font = min(max(width / 28.0, 9.0), 16.0)
    image = Image.new("RGB", (width, height + legend_height(font, lines)), (255, 255, 255))
    image.paste(Image.fromarray(files.eight_bits(strip)))
    write_legend(image, height, font, lines)
    files.write_picture(name, np.asarray(image) / 255.0)
