"""Figure 1 of the paper on the picture itself: a record's sphere and the quad that bounds it (Jones 2010, 3.5.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from irrsplat.image.false_colours import Colour, legend_height, write_legend
from irrsplat.image.frame import Frame
from irrsplat.image.tonemap import tonemap
from irrsplat.records.weight import bounded
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

LEAST = 160  # pixels: smallest picture with room for the figure
_SUPER = 2  # pixels drawn per pixel shown, along each side
_HIDDEN = 0.02  # of the depth: a record this far behind the visible surface is hidden
_INK, _SPHERE, _QUAD, _U, _V = (30, 30, 30), (214, 118, 0), (0, 104, 184), (200, 40, 110), (0, 140, 90)


@dataclass(frozen=True)
class ShownRecord:
    """The record in the figure, world space: p_k (3,), R_k and its radius r for this eye, in metres.

    eye: (3,). u, v: (3,) unit vectors perpendicular to the eye vector that span the quad, as in shaders/indirect/splat.vert.
    """

    position: np.ndarray
    radius: float
    r: float
    eye: np.ndarray
    u: np.ndarray
    v: np.ndarray

    @property
    def d(self) -> float:
        """Distance from the eye to p_k in metres."""
        return float(np.linalg.norm(self.eye - self.position))

    @property
    def inside(self) -> bool:
        """True if the eye lies in the sphere, so that the quad is the whole screen."""
        return self.d <= self.r

    @property
    def half_size(self) -> float:
        """Half the quad's side in metres: r·d/√(d² − r²) bounds the silhouette."""
        return self.r * self.d / math.sqrt(self.d**2 - self.r**2)

    def at(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return (N, 3) points of the quad's plane, at (N,) multiples of half its side along u and v."""
        return np.asarray(self.position + self.half_size * (u[:, None] * self.u + v[:, None] * self.v))

    @property
    def quad(self) -> np.ndarray:
        """(4, 3) corners of the quad, in order."""
        return self.at(np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0]))


def diagram(frame: Frame, eye: Camera, settings: Settings) -> np.ndarray:
    """Return (H, W, 3) display values 0..1: the picture with a record's sphere and quad, and their lengths.

    Returns the plain picture if no record can be shown or there is no room for the figure.
    """
    height, width = frame.depth.shape
    picture = tonemap(frame.image, frame.exposure)
    record = choose_record(frame, eye, settings)
    if record is None or min(width, height) < LEAST:
        return picture
    size = width * _SUPER, height * _SUPER
    sheet = Image.fromarray((picture * 255.0 + 0.5).astype(np.uint8)).resize(size)
    draw, line = ImageDraw.Draw(sheet, "RGBA"), max(2, min(size) // 200)

    def outline(points: np.ndarray, colour: Colour, alpha: int) -> None:
        path = [(float(x), float(y)) for x, y in _on_screen(points, eye, size)]
        draw.polygon(path, (*colour, alpha))
        draw.line([*path, path[0]], colour, line, "curve")

    font, lines = max(11.0, 0.031 * min(width, height)) * _SUPER, _legend(record, settings)
    x, y = _on_screen(record.position[None], eye, size)[0].tolist()
    if not record.inside:
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        outline(record.at(np.cos(angle), np.sin(angle)), _SPHERE, 90)
        outline(record.quad, _QUAD, 40)
        for (tip_x, tip_y), colour, name in zip(
            _on_screen(record.at(*np.eye(2)), eye, size).tolist(), (_U, _V), "uv", strict=True
        ):
            draw.line([x, y, tip_x, tip_y], colour, line)
            draw.text((tip_x, tip_y), name, colour, ImageFont.load_default(font), stroke_width=line, stroke_fill=(255, 255, 255))
    draw.ellipse([x - 2 * line, y - 2 * line, x + 2 * line, y + 2 * line], _INK)
    write_legend(sheet, size[1] - legend_height(font, lines), font, lines)
    return np.asarray(sheet.resize((width, height), Image.Resampling.BOX), np.float32) / np.float32(255.0)


def choose_record(frame: Frame, eye: Camera, settings: Settings) -> ShownRecord | None:
    """Return a visible, large record near the picture's centre and facing the eye; None if none is visible."""
    position, normal = np.asarray(frame.records_position, float), np.asarray(frame.records_normal, float)
    if not len(position) or not np.isfinite(frame.depth).any():
        return None
    height, width = frame.depth.shape
    apart = np.asarray(eye.eye) - position
    d = np.maximum(np.linalg.norm(apart, axis=1), 1e-30)
    z = np.maximum(apart @ eye.axes[2], 1e-30)  # along the view axis
    x, y = _on_screen(position, eye, (width, height)).T
    column, row = np.clip(x, 0, width - 1).astype(int), np.clip(y, 0, height - 1).astype(int)
    r = bounded(settings.a * np.asarray(frame.records_radius, float), eye.measure((width, height)) * d, settings)
    centred = np.clip(1.0 - np.hypot(2.0 * x / width - 1.0, 2.0 * y / height - 1.0), 0.0, 1.0)
    score = np.minimum(r / d, 0.3) * np.clip(np.einsum("ij,ij->i", apart, normal) / d, 0.0, 1.0) * centred
    score[np.abs(frame.depth[row, column] - z) > _HIDDEN * z] = 0.0
    best = int(np.argmax(score))
    if not score[best] > 0.0:
        return None
    axis = apart[best] / d[best]
    u = np.cross((0.0, 1.0, 0.0) if abs(axis[1]) < 0.9 else (1.0, 0.0, 0.0), axis)
    u /= np.linalg.norm(u)
    radius = float(frame.records_radius[best])
    return ShownRecord(position[best], radius, float(r[best]), np.array(eye.eye, float), u, np.cross(axis, u))


def _on_screen(points: np.ndarray, eye: Camera, size: tuple[int, int]) -> np.ndarray:
    """Return (N, 2) pixels, from the upper left corner of a picture of `size` (width, height), of points (N, 3)."""
    x, y, backward = eye.axes @ (points - np.asarray(eye.eye)).T
    step = np.maximum(-backward, 1e-30) * eye.screen / size[1]  # metres of a pixel
    return np.stack([0.5 * size[0] + x / step, 0.5 * size[1] - y / step], axis=1)


def _legend(record: ShownRecord, settings: Settings) -> list[tuple[Colour, str]]:
    """Return the legend: colours, formulas and lengths."""
    requested, r = settings.a * record.radius, record.r
    sphere = f"sphere, r = a R_k = {requested:.3g} m"
    if abs(r - requested) > 1e-3 * r:
        percent = settings.radius_max if r < requested else settings.radius_min
        sphere = f"sphere, a R_k = {requested:.3g} m, kept to {percent:g}% of the view: r = {r:.3g} m"
    lines = [(_INK, f"record p_k, at d = {record.d:.3g} m from the eye"), (_SPHERE, sphere)]
    if record.inside:
        return [*lines, (_QUAD, "quad = the whole screen: the eye is inside the sphere")]
    return [*lines, (_QUAD, f"quad, half size r d / sqrt(d^2 - r^2) = {record.half_size:.3g} m, spanned by u and v")]
