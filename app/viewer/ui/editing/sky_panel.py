"""The part of the lights' panel that sets the sky, and its sun by place, date and time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from imgui_bundle import imgui

from irrsplat.app.viewer.actions import Actions
from irrsplat.app.viewer.editing.sun_sky import LAST_MINUTE, SunSky
from irrsplat.app.viewer.ui.layout import accent
from irrsplat.sky.cie import CIE_KINDS

_HAZIEST = 10.0  # turbidity that the slider goes to
_QUARTERS = 4  # of an hour, that a clock may be ahead by


def draw_sky(actions: Actions, label: Callable[[str], str]) -> None:
    """Draw the widgets. label: makes the label of one."""
    editor = actions.editor
    if not imgui.collapsing_header("sun and sky"):
        return
    before = editor.sky
    if before is None:
        environment = actions.session.scene.environment
        plain = "the same all around" if any(actions.session.scene.sky) else "none"
        imgui.text_disabled(f"now: {plain if environment is None else environment.about}")
        if imgui.button("a clear sky by place and time"):
            actions.attempt(lambda: editor.set_sky(SunSky()))
        return
    after = _widgets(before, label)
    if after != before:
        actions.attempt(lambda: editor.set_sky(after))


def _widgets(sky: SunSky, label: Callable[[str], str]) -> SunSky:
    """The sky, with what the widgets have changed."""
    altitude, azimuth = sky.sun
    if altitude > 0.0:
        imgui.text_disabled(f"sun {altitude:.1f}° high, azimuth {azimuth:.1f}°")
    else:
        imgui.text_colored(accent(), f"night: the sun is {-altitude:.1f}° below the horizon")
    changed, kind = imgui.combo(label("sky"), CIE_KINDS.index(sky.kind), list(CIE_KINDS))
    sky = replace(sky, kind=CIE_KINDS[kind]) if changed else sky
    changed, minute = imgui.slider_int(label("time"), sky.minute, 0, LAST_MINUTE, f"{sky.minute // 60:02d}:{sky.minute % 60:02d}")
    sky = replace(sky, minute=min(max(minute, 0), LAST_MINUTE)) if changed else sky
    changed, day = imgui.slider_int(label("date"), sky.day, 1, 365, f"{sky.when.day} {sky.when:%b}")
    sky = replace(sky, day=min(max(day, 1), 365)) if changed else sky
    latitude = _angle(label("latitude"), sky.latitude, 90.0, "degrees north")
    longitude = _angle(label("longitude"), sky.longitude, 180.0, "degrees east")
    changed, zone = imgui.slider_float(label("clock"), sky.zone, -12.0, 14.0, "%+.2f h")
    imgui.set_item_tooltip("hours that it is ahead of UTC")
    sky = replace(sky, zone=min(max(round(_QUARTERS * zone) / _QUARTERS, -12.0), 14.0)) if changed else sky
    changed, turbidity = imgui.slider_float(label("turbidity"), sky.turbidity, 1.5, _HAZIEST, "%.2f")
    imgui.set_item_tooltip("of a clear or intermediate sky: 2 is clear, 6 hazy")
    sky = replace(sky, turbidity=float(f"{min(max(turbidity, 1.0), 20.0):.3g}")) if changed else sky
    north = _angle(label("north"), sky.north, 180.0, "degrees that north lies clockwise of the world's back")
    return replace(sky, latitude=latitude, longitude=longitude, north=north)


def _angle(label: str, degrees: float, most: float, help: str) -> float:
    """An angle as its slider has it, degrees."""
    changed, value = imgui.slider_float(label, degrees, -most, most, "%.1f°")
    imgui.set_item_tooltip(help)
    return float(f"{min(max(value, -most), most):.6g}") if changed else degrees
