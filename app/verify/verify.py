"""`irrsplat verify`: comparison of a rendering with a path-traced reference, as a table and as pictures."""

from __future__ import annotations

import os
from argparse import Namespace
from typing import TYPE_CHECKING

import numpy as np

from irrsplat.app.common.terminal import out, progress, say
from irrsplat.app.verify import error_image
from irrsplat.app.verify.measure import gather, percent, silent, trace
from irrsplat.core.errors import InputError
from irrsplat.image import frame as output
from irrsplat.image.tonemap import tonemap
from irrsplat.reference.truth import compare, errors, in_words, side_of
from irrsplat.reference.worker import INSTALL
from irrsplat.settings import preset

if TYPE_CHECKING:
    from irrsplat.image.frame import Frame
    from irrsplat.renderer import Renderer
    from irrsplat.scene.model import Camera, Scene

Row = tuple[str, str, str]


def run(scene: Scene, camera: Camera, args: Namespace) -> int:
    """Render, compare, print the table and write the pictures; return the exit status 0. args: as from grammar.parse.

    Raises InputError and IrrsplatError for invalid input; KeyboardInterrupt if the user interrupts.
    """
    check(args)
    scene = scene.recentred
    camera, scene = camera.shifted([-v for v in scene.origin]), scene.local
    for notice in scene.notices:
        say(f"notice: {notice}")
    import irrsplat

    with irrsplat.Renderer(scene, size=tuple(args.size), preset=args.preset, tile_size=0, **args.values) as renderer:
        frame, rows = (_against_trace if args.truth == "trace" else _against_gather)(renderer, scene, camera, args)
    stats = frame.stats
    if stats.get("interrupted"):
        raise KeyboardInterrupt
    if not stats.get("converged", True):
        say(f"notice: stopped after {stats.get('rounds')} rounds before every pixel was covered; raise --a")
    out(heading(scene, args))
    rows.insert(1, ("records", f"{stats.get('records', 0):,}", ""))
    for name, value, remark in rows:
        out(f"  {name:<18} {value:>10}  {remark}".rstrip())
    return 0


def heading(scene: Scene, args: Namespace) -> str:
    """Return one line that names the rendering and its reference."""
    truth = "a path-traced reference" if args.truth == "trace" else "a fine gather without interpolation"
    bounces = in_words(preset(args.preset, **args.values).bounces)
    return f"{scene.name}, {args.size[0]} x {args.size[1]}, preset {args.preset}, {bounces}, against {truth}"


def check(args: Namespace) -> None:
    """Raise InputError for errors that show before any rendering."""
    bounces = preset(args.preset, **args.values).bounces
    if bounces == 0:
        raise InputError("--bounces 0: there is no indirect light to verify; leave it out")
    if args.truth == "gather" and bounces != 1:
        raise InputError(f"--truth gather supports one bounce only, not {bounces}; add --bounces 1, or take --truth trace")
    side_of(args.samples)
    if args.output is None:
        return
    if args.truth == "gather":
        raise InputError("--truth gather computes single pixels, not a picture; leave -o out, or take --truth trace")
    ending = os.path.splitext(args.output)[1].lower()
    if ending in output.ENDINGS and ending != ".png":
        raise InputError("verify writes a .png or a folder of them (no ending)", args.output)
    output.check_writable(args.output)


def _against_trace(renderer: Renderer, scene: Scene, camera: Camera, args: Namespace) -> tuple[Frame, list[Row]]:
    width, height = args.size
    with progress() as line:
        notify = line or silent
        truth, origin = trace(scene, camera, args, notify)
        frame = renderer.render(camera, progress=lambda now: notify(now.coverage, f"rendering: {now.records} records"))
    found = compare(frame, truth)
    mixed = args.values.get("blend", 0.5) != 0.5  # direct against indirect light: the reference has both at full weight
    radiance = frame.direct + frame.indirect + frame.emission if mixed else frame.image
    # Outside surfaces, both show the renderer's background
    expected = np.where(truth.seen[..., None], truth.picture, radiance)
    shown = tonemap(expected, frame.exposure), tonemap(radiance, frame.exposure)
    flip = error_image.flip(*shown)
    rows = [
        ("pixels compared", f"{int(truth.valid.sum()):,}", f"of {width * height:,}; without edges and background"),
        *_table(found, float(frame.irradiance[truth.valid].mean()), float(truth.irradiance[truth.valid].mean())),
        ("off by > 20 %", percent(found["spots"]), "of the pixels, relative to the local mean of the reference: spots"),
        ("fine part of RMSE", percent(found["fine"]), "error minus its local mean: grain, rims, edges"),
        ("direct light RMSE", percent(found["direct"]), "away from shadow edges"),
        ("albedo", f"{found['albedo']:.4f}", "median difference from the path tracer's texture lookup"),
        ("normal", f"{found['normal']:.2f} °", "median angle between the normals, with normal maps"),
        ("reference", f"{2 * side_of(args.samples) ** 2:,}", f"samples of each kind per pixel, {origin}"),
    ]
    noise = ("noise of reference", percent(truth.noise), "relative RMSE of the reference, from two independent halves")
    rows[2:2] = [noise, ("RMSE without it", percent(found["net"]), "error of the rendering without that noise")]
    if flip is not None:
        remark = f"of the tone-mapped pictures, {error_image.PIXELS_PER_DEGREE:g} pixels per degree"
        rows.insert(-1, ("FLIP", f"{flip[1]:.4f}", remark))
    if args.output is not None and not frame.stats.get("interrupted"):
        error = error_image.signed_error(frame.irradiance, truth)
        error_image.write(args.output, shown, error, None if flip is None else flip[0])
    if flip is None:
        say(f"notice: FLIP is left out; run: {INSTALL}")
    return frame, rows


def _against_gather(renderer: Renderer, scene: Scene, camera: Camera, args: Namespace) -> tuple[Frame, list[Row]]:
    """Compare with a fine gather at random pixels: it shows the errors of placement and interpolation alone."""
    from irrsplat.reference import fine_gather

    with progress() as line:
        notify = line or silent
        frame = renderer.render(camera, progress=lambda now: notify(now.coverage, f"rendering: {now.records} records"))
    truth = gather(renderer, camera)
    E = frame.irradiance[tuple(truth.pixels.T)]
    rows = [
        ("pixels compared", f"{len(E):,}", "at random, away from edges"),
        *_table(errors(E, truth.irradiance), float(E.mean()), float(truth.irradiance.mean())),
        ("reference", f"{fine_gather.SIDE**2:,}", "directions per pixel, by the renderer's own gather"),
    ]
    return frame, rows


def _table(found: dict[str, float | None], mean: float, mean_ref: float) -> list[Row]:
    return [
        ("relative RMSE", percent(found["rmse"]), "of irradiance, relative to the mean of the reference"),
        ("bias of the mean", percent(found["bias"], "+"), f"{mean:.4g} W/m², reference {mean_ref:.4g}"),
        ("off by > 30 %", percent(found["outliers"]), "of the pixels, relative to the mean"),
    ]
