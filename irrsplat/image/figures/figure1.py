"""Figure 1 of the paper, drawn to scale: a record's sphere becomes a quad on the eye's screen (Jones 2010, 3.5.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from PIL import Image

from irrsplat.image.figures.cutaway import Parallel, Surface, paint, surface
from irrsplat.image.figures.pen import Pen, legend_height, write_legend
from irrsplat.image.frame import Frame
from irrsplat.image.tonemap import tonemap
from irrsplat.records.weight import view_radius
from irrsplat.scene.model import Camera
from irrsplat.settings import Settings

LEAST = 160  # pixels: smallest picture with room for a diagram
_SUPER = 2  # pixels drawn per pixel shown, along each side
_UNSEEN = (0.80, 0.83, 0.87)
_CANDIDATES = 300  # records whose surroundings are examined
_INK, _GREY = (30, 30, 30), (110, 110, 110)
_SPHERE, _QUAD, _U, _V = (214, 118, 0), (0, 104, 184), (200, 40, 110), (0, 140, 90)


@dataclass(frozen=True)
class ShownRecord:
    """The record in the figure, world space: p_k and n_k (3,), R_k and its radius r for this eye, in metres.

    eye: (3,). u, v: (3,) unit vectors perpendicular to the eye vector that span the quad, as in shaders/indirect/splat.vert.
    """

    position: np.ndarray
    normal: np.ndarray
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

    @property
    def quad(self) -> np.ndarray:
        """(4, 3) corners of the quad, in order."""
        return np.array(
            [self.position + self.half_size * (x * self.u + y * self.v) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        )


def diagram(frame: Frame, eye: Camera, settings: Settings) -> np.ndarray:
    """Return (H, W, 3) display values 0..1 of the frame's size: an overview from the side, and the record's sphere and quad
    enlarged.

    Returns the plain picture if no record can be shown or there is no room for a diagram.
    """
    height, width = frame.depth.shape
    record = choose_record(frame, eye, settings)
    if record is None or min(width, height) < LEAST:
        return tonemap(frame.image, frame.exposure)
    seen = _tinted(surface(frame, eye.screen / height), record)
    axes = _side_axes(record, eye, seen)
    size = _SUPER * np.array([width, height])
    font = max(11.0, 0.031 * min(width, height)) * _SUPER
    sheet = Image.new("RGB", tuple(size), tuple(round(255 * c) for c in _UNSEEN))
    lines = _legend(record, settings)
    strip = legend_height(font, lines)
    room = size - (0, strip)
    whole = _overview(record, eye, seen, axes, room)
    if whole.scale * record.r > 0.1 * room[1]:  # large enough as it is
        sheet.paste(_panel(record, eye, seen, whole, room, font, "", None), (0, 0))
    else:
        side_by_side = width >= 1.4 * height
        first = room // (2, 1) if side_by_side else (room * (1.0, 0.48)).astype(int)
        second = room - first * ((1, 0) if side_by_side else (0, 1))
        whole = _overview(record, eye, seen, axes, first)
        scale = 0.3 * min(second) / record.r
        near = Parallel(axes, record.position, second / 2.0, scale)
        title = f"the same record, {_round(scale / whole.scale)} times nearer"
        window = second / scale * whole.scale
        sheet.paste(_panel(record, eye, seen, whole, first, font, "what the eye sees, looked at from beside", window), (0, 0))
        place = (int(first[0]), 0) if side_by_side else (0, int(first[1]))
        sheet.paste(_panel(record, eye, seen, near, second, font, title, None), place)
        edge = [place, (place[0], int(room[1]))] if side_by_side else [place, (int(size[0]), place[1])]
        Pen(sheet, font).line(np.array(edge), _GREY, 0.6, halo=False)
    write_legend(sheet, int(room[1]), font, lines)
    return np.asarray(sheet.resize((width, height), Image.Resampling.BOX), np.float32) / np.float32(255.0)


def choose_record(frame: Frame, eye: Camera, settings: Settings) -> ShownRecord | None:
    """Return a visible, large record near the picture's centre and facing the eye; None if none is visible."""
    position = np.asarray(frame.records_position, float)
    normal, R = np.asarray(frame.records_normal, float), np.asarray(frame.records_radius, float)
    if not len(position) or not np.isfinite(frame.depth).any():
        return None
    height, width = frame.depth.shape
    apart = np.asarray(eye.eye) - position
    d = np.maximum(np.linalg.norm(apart, axis=1), 1e-30)
    x, y, z = eye.axes @ -apart.T
    tangent = math.tan(math.radians(eye.fov) / 2.0)
    z = np.maximum(-z, 1e-30)
    x, y = x / (z * tangent * width / height), y / (z * tangent)
    column = np.clip((0.5 + 0.5 * x) * width, 0, width - 1).astype(int)
    row = np.clip((0.5 - 0.5 * y) * height, 0, height - 1).astype(int)
    hidden = np.abs(frame.depth[row, column] - z) > 0.02 * z
    r = view_radius(R, d, eye, (width, height), settings)
    size = np.minimum(r / d, 0.3)
    facing = np.einsum("ij,ij->i", apart, normal) / d
    lit = np.clip(0.5 - abs(tonemap(frame.image[row, column], frame.exposure).mean(axis=-1) - 0.5), 0.05, 0.3)
    slanted = np.clip(0.5 - abs(facing - 0.6), 0.05, 0.3)  # the sphere then cuts the surface in an ellipse for the eye
    score = size * slanted * lit * np.clip(1.0 - np.hypot(x, y), 0.0, 1.0)
    score[hidden] = 0.0
    order = np.argsort(-score, kind="stable")
    score[order[_CANDIDATES:]] = 0.0
    for i in order[:_CANDIDATES]:
        reach = 4.0 * r[i] / (z[i] * tangent) * height / 2.0  # pixels
        rows, columns = (slice(max(0, int(c - reach)), int(c + reach) + 1, 1 + int(reach) // 20) for c in (row[i], column[i]))
        off = frame.position[rows, columns] - position[i]
        around = (np.linalg.norm(off, axis=-1) < 8.0 * r[i]) & (abs(off @ normal[i]) < 0.5 * r[i])
        score[i] *= 0.01 + around.mean() ** 3  # prefer a continuous surface around the record
    best = int(np.argmax(score))
    if not score[best] > 0.0:
        return None
    axis = apart[best] / d[best]
    u = np.cross((0.0, 1.0, 0.0) if abs(axis[1]) < 0.9 else (1.0, 0.0, 0.0), axis)
    u /= np.linalg.norm(u)
    return ShownRecord(
        position[best], normal[best], float(R[best]), float(r[best]), np.array(eye.eye, float), u, np.cross(axis, u)
    )


def _side_axes(record: ShownRecord, eye: Camera, seen: Surface) -> np.ndarray:
    """Return (3, 3) axes of a view from the side of the eye vector: rows right, up, towards the viewer.

    Of 18 directions, choose the one with the most front-facing surfaces and nothing in front of the record.
    """
    axis = (record.eye - record.position) / record.d
    up = np.asarray(eye.up) / np.linalg.norm(eye.up)
    side = np.cross(up, axis)
    if np.linalg.norm(side) < 0.1:  # the eye points straight down
        up = eye.axes[1]
        side = np.cross(up, axis)
    side /= np.linalg.norm(side)
    ahead = np.cross(side, up)
    few = slice(None, None, max(1, len(seen.corners) // 20000))
    points, normals = seen.corners[few, 0] - record.position, seen.normals[few]
    risen = points @ record.normal > 0.4 * record.r  # above the record's own surface
    best, axes = -math.inf, np.eye(3)
    for azimuth in (55, -55, 70, -70, 40, -40):
        for elevation in (20, 35, 8):
            flat, rise = np.radians((azimuth, elevation))
            towards = np.cos(rise) * (np.cos(flat) * ahead + np.sin(flat) * side) + np.sin(rise) * up
            facing = normals @ towards > 0.1
            ahead_of = points @ towards
            across = (points**2).sum(-1) - ahead_of**2
            before = facing & risen & (ahead_of > 0.0) & (across < (1.5 * record.r) ** 2)
            score = facing.mean() + 0.3 * abs(np.sin(flat)) + min(record.normal @ towards, 0.5) - 1.0 * before.any()
            if score > best + 1e-9:
                right = np.cross(up, towards)
                right /= np.linalg.norm(right)
                best, axes = score, np.stack([right, np.cross(towards, right), towards])
    return axes


def _overview(record: ShownRecord, eye: Camera, seen: Surface, axes: np.ndarray, room: np.ndarray) -> Parallel:
    """Return a view of the eye, the sphere and the surfaces around them, in `room` (width, height) pixels."""
    points = seen.corners[:: max(1, len(seen.corners) // 20000), 0]
    points = points[np.linalg.norm(points - record.position, axis=1) < max(record.d, 4.0 * record.r)]
    ball = [record.position + s * record.r * a for s in (-1.0, 1.0) for a in axes[:2]]
    flat = np.concatenate([points, ball, [record.eye]]) @ axes.T
    low, high = flat.min(axis=0), flat.max(axis=0)
    scale = float((0.86 * room / np.maximum(high - low, 1e-9)[:2]).min())
    return Parallel(axes, (low + high) / 2.0 @ axes, room / 2.0, scale)


def _panel(
    record: ShownRecord,
    eye: Camera,
    seen: Surface,
    view: Parallel,
    size: np.ndarray,
    font: float,
    title: str,
    window: np.ndarray | None,
) -> Image.Image:
    """Return one view as an image of `size` (width, height); window: (width, height) in pixels of the enlarged part."""
    canvas = np.empty((size[1], size[0], 3), np.float32)
    canvas[:] = _UNSEEN
    paint(canvas, view, seen)
    image = Image.fromarray((np.clip(canvas, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8))
    pen = Pen(image, font, top=1.9 * font if title else 0.3 * font)
    detailed = window is None
    centre, eye_at = view.at(record.position), view.at(record.eye)
    _draw_eye(pen, record, eye, view)
    if not record.inside:
        for corner in view.at(record.quad):
            pen.line(np.array([eye_at, corner]), _QUAD, 0.5, halo=False)
    _draw_sphere(pen, record, view, front=False)
    if not record.inside:
        pen.polygon(view.at(record.quad), _QUAD, 50)
    _draw_sphere(pen, record, view, front=True)
    if detailed and not record.inside:
        for vector, colour, name in ((record.u, _U, "u"), (record.v, _V, "v")):
            tip = view.at(record.position + record.half_size * vector)
            pen.arrow(centre, tip, colour, 1.3)
            pen.label(name, tip, tip - centre, colour)
    pen.arrow(eye_at, centre, _INK, 1.3)
    pen.dot(centre, 2.6, _INK)
    if window is not None:
        low, high = centre - window / 2.0, centre + window / 2.0
        pen.line(np.array([low, (high[0], low[1]), high, (low[0], high[1]), low]), _GREY, 0.7)
    else:
        back = (eye_at - centre) / max(float(np.linalg.norm(eye_at - centre)), 1e-9)
        pen.label("p_k", centre, -back + (0.0, 0.6), _INK)
        pen.label("sphere", centre + view.scale * record.r * np.array([0.72, 0.72]), (1.0, 1.0), _SPHERE)
        if not record.inside:
            corners = view.at(record.quad)
            pen.label("quad", corners[np.argmax(corners @ (1.0, -1.0))], (1.0, -0.2), _QUAD)
        if not ((eye_at >= 0) & (eye_at < size)).all():
            edge = np.min((size / 2.0) / np.maximum(abs(back), 1e-9))
            pen.label("from the eye", centre + back * 0.8 * edge, (-0.3 * back[1], -1.0), _INK)
    if title:
        pen.text((0.6 * font, 0.4 * font), title, _GREY)
    return image


def _tinted(seen: Surface, record: ShownRecord) -> Surface:
    """Return the surfaces slightly paler, and tinted inside the sphere."""
    colours = 0.88 * seen.colours + 0.12
    reached = np.linalg.norm(seen.corners - record.position, axis=-1) < record.r
    tint = np.array(_SPHERE) / 255.0
    return Surface(seen.corners, np.where(reached[..., None], 0.45 * colours + 0.55 * tint, colours), seen.normals)


def _draw_eye(pen: Pen, record: ShownRecord, eye: Camera, view: Parallel) -> None:
    """Draw the eye as the tip of its view pyramid."""
    at = view.at(record.eye)
    if not ((at >= 0) & (at < pen.size)).all():
        return
    tangent = math.tan(math.radians(eye.fov) / 2.0)
    length = 0.09 * min(pen.size) / view.scale
    right, up, backward = eye.axes
    corners = [
        record.eye + length * (-backward + tangent * (x * right + y * up)) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]
    flat = view.at(np.array(corners))
    for corner in flat:
        pen.line(np.array([at, corner]), _INK, 0.8)
    pen.polygon(flat, _INK, 20, 0.8)
    pen.dot(at, 3.0, _INK)
    pen.label("eye", at, (0.0, 1.0), _INK)


def _draw_sphere(pen: Pen, record: ShownRecord, view: Parallel, front: bool) -> None:
    """Draw the front or back of the sphere: its disc and three great circles, one of them in the quad's plane."""
    centre, r = view.at(record.position), record.r * view.scale
    if front:
        pen.disc(centre, r, _SPHERE, 45, 1.2)
    axis = (record.eye - record.position) / record.d
    angle = np.linspace(0.0, 2.0 * np.pi, 97)[:, None]
    for a, b in ((record.u, record.v), (record.u, axis), (record.v, axis)):
        ring = record.position + record.r * (np.cos(angle) * a + np.sin(angle) * b)
        nearer = view.nearness(ring) > view.nearness(record.position)
        pen.dashes(view.at(ring), nearer == front, _SPHERE, 0.7 if front else 0.35)


def _legend(record: ShownRecord, settings: Settings) -> list[tuple[tuple[int, int, int], str]]:
    """Return the legend: colours, formulas and lengths."""
    requested, r = settings.a * record.radius, record.r
    sphere = f"sphere, r = a·R_k = {_metres(requested)}"
    if abs(r - requested) > 1e-3 * r:
        percent = settings.radius_max if r < requested else settings.radius_min
        sphere = f"sphere, a·R_k = {_metres(requested)}, kept to {percent:g}% of the view: r = {_metres(r)}"
    lines = [(_INK, f"eye vector, d = {_metres(record.d)}"), (_SPHERE, sphere)]
    if record.inside:
        return [*lines, (_QUAD, "quad = the whole screen: the eye is inside the sphere")]
    formula = f"quad, half size r·d / √{{d^2 - r^2}} = {_metres(record.half_size)}, spanned by u and v"
    return [*lines, (_QUAD, formula)]


def _round(factor: float) -> str:
    return f"{factor:.0f}" if factor >= 10 else f"{factor:.1f}"


def _metres(length: float) -> str:
    return f"{length:.3g} m"
