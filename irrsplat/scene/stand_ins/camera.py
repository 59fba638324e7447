"""Default camera for a scene whose file has none: in front of an object, or in a room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irrsplat.scene.model import Camera, Scene
from irrsplat.scene.stand_ins.surroundings import SurfacePoints, Surroundings, cells, directions, surroundings

_OUTSIDE, _INSIDE = 45.0, 65.0  # degrees: vertical fields of view
_THREE_QUARTERS = np.array([0.48, 0.36, 0.8])  # right, up and front, unit: direction from an object to the camera
_CLOSED_ROOM = 0.85  # least share of blocked directions in a closed room
_OPEN_SIDE = 0.7  # the same at the open side of a room that lacks a wall
_ANY_ROOM = 0.5  # the same anywhere in a room
_LEAST_FRONTS = 0.6  # least share of visible surfaces that are front-facing; inside a solid object only backs are visible
_LEAST_VOLUME = 0.2  # of the bounding box that is visible from inside; less is a cavity of an object
_EYE, _STOREY = 1.6, (1.9, 60.0)  # metres: eye height for ceilings in this range, in files whose unit is the metre
_EYE_SHARE = 0.45  # of the height of other rooms
_LEAST_CLEARANCE = 0.05  # of the floor's diagonal: least distance between the eye and obstacles
_PLACES, _STAGE_PLACES = 0.1, 0.6  # least share of tried points inside a closed room, and a room that may lack a wall
_EDGE = 5.0  # spacings of the points: a point this close to two sides of the bounding box lies on an edge
_NEAR = 0.15  # of the bounding box's diagonal: closer objects hide more than they show
_HIDDEN = 1.25  # times the nearest distance in a direction: farther points are hidden
_PICTURE_RISE, _PICTURE_SECTORS = 0.5, 4  # extent of a level picture: sine of the elevation, sectors to each side
_GRID = 5  # tried points along each side of the floor
_HEIGHTS = 0.35, 0.65  # of the bounding box: heights of the tried points


@dataclass(frozen=True)
class RoomPlaces:
    """Points of a scene that may be inside a room. places: position (3,) and surroundings of each."""

    places: tuple[tuple[np.ndarray, Surroundings], ...]

    @property
    def most_open(self) -> Surroundings:
        """The surroundings with most free directions."""
        return min((around for _, around in self.places), key=lambda around: around.closed)

    @property
    def stage(self) -> bool:
        """True if most of the bounding box is a room, closed or not; an object may have a cavity or two."""
        return len(self.places) >= _STAGE_PLACES * _GRID**2 * len(_HEIGHTS)

    @property
    def rooms(self) -> list[tuple[np.ndarray, Surroundings]]:
        """The places that are closed on all sides."""
        return [(at, around) for at, around in self.places if around.closed >= _CLOSED_ROOM]


@dataclass(frozen=True)
class Standpoint:
    """A camera. inside: True if it is in a closed room."""

    camera: Camera
    inside: bool


def room_places(scene: Scene, points: SurfacePoints, axes: np.ndarray) -> RoomPlaces:
    """Return the places in the bounding box that may be in a room. points: on the surfaces. axes: as in default_camera."""
    low, high = _extent(scene, axes)
    box = float(np.prod(high - low))
    if not len(points.position) or box == 0.0:
        return RoomPlaces(())
    seen = [(at, surroundings(points, at, axes)) for at in _grid(low, high, axes, _HEIGHTS)]
    found = RoomPlaces(tuple((at, it) for at, it in seen if _may_be_in_room(it, box)))
    return found if found.stage or len(found.rooms) >= _PLACES * len(seen) else RoomPlaces(())


def _may_be_in_room(around: Surroundings, box: float) -> bool:
    """True if a point with these surroundings, in a bounding box of `box` m³, may be in a room."""
    return around.closed >= _ANY_ROOM and around.fronts >= _LEAST_FRONTS and around.volume >= _LEAST_VOLUME * box


def default_camera(scene: Scene, points: SurfacePoints, axes: np.ndarray, room_places: RoomPlaces) -> Standpoint:
    """Return a camera for the scene.

    It is in a closed room at eye height, with a far view and much detail; in front of the open side of a room that lacks a wall;
    or in front of an object, from above to one side. points: on the surfaces. axes: (3, 3) rows right, up and front of the world.
    """
    if room_places.stage and room_places.most_open.closed < _OPEN_SIDE:
        way = _way_out(room_places.most_open, axes)
        if way is not None:
            return Standpoint(_camera_in_front(scene, axes, way), False)
    if room_places.rooms:
        middle = max(room_places.rooms, key=lambda room: room[1].volume)[0]
        camera = _camera_in_room(scene, points, axes, middle)
        if camera is not None:
            return Standpoint(camera, True)
    return Standpoint(_camera_in_front(scene, axes, _THREE_QUARTERS), False)


def enclosure_of_camera(scene: Scene, points: SurfacePoints, axes: np.ndarray, room_places: RoomPlaces) -> Surroundings | None:
    """Return the surroundings of the first camera if they are closed, or if it is in a scene that is a room; else None."""
    if not len(points.position):
        return None
    eye = np.asarray(scene.cameras[0].eye)
    around = surroundings(points, eye, axes)
    within = bool(((scene.bounds[0] <= eye) & (eye <= scene.bounds[1])).all())
    return (
        around
        if around.closed >= _CLOSED_ROOM or (within and room_places.rooms and room_places.most_open.closed >= _OPEN_SIDE)
        else None
    )


def _extent(scene: Scene, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (3,) the least and the greatest coordinates along right, up and front."""
    corners = scene.corners @ axes.T
    return corners.min(0), corners.max(0)


def _grid(low: np.ndarray, high: np.ndarray, axes: np.ndarray, heights: tuple[float, ...]) -> np.ndarray:
    """Return (N, 3) points in world space, evenly over the floor, at these shares of the height."""
    share = (np.arange(_GRID) + 0.5) / _GRID
    x, y, z = np.meshgrid(share, heights, share, indexing="ij")
    shares = np.stack([x.ravel(), y.ravel(), z.ravel()], 1)
    points: np.ndarray = (low + shares * (high - low)) @ axes
    return points


def _camera_in_front(scene: Scene, axes: np.ndarray, way: np.ndarray) -> Camera:
    """Return the nearest camera in direction `way` (right, up and front) that sees every vertex."""
    out = way @ axes
    centre = scene.bounds.mean(0)
    towards = Camera(_point(centre + out), _point(centre), _point(axes[1]), _OUTSIDE)
    slope, reach = np.tan(np.radians(_OUTSIDE) / 2.0), 0.05 * scene.diagonal
    for points in (mesh.positions for mesh in scene.meshes if len(mesh.positions)):
        x, y, z = towards.axes.astype("f4") @ (points - centre.astype("f4")).T
        reach = max(reach, float((z + np.maximum(np.abs(x), np.abs(y)) / slope).max()))
    distance = 1.08 * reach
    return Camera(_point(centre + distance * out), _point(centre), _point(axes[1]), _OUTSIDE)


def _way_out(around: Surroundings, axes: np.ndarray) -> np.ndarray | None:
    """Return a direction out of the open side, slightly raised, as right, up and front; None where that is not sideways."""
    ways = directions(axes)[~np.isfinite(around.distance)] @ axes.T
    mean = ways.mean(0)
    level = np.array([mean[0], 0.0, mean[2]])
    length = float(np.linalg.norm(level))
    if length < 0.45 or abs(mean[1]) > length:
        return None
    way = level / length + np.array([0.0, 0.06, 0.0])
    unit: np.ndarray = way / np.linalg.norm(way)
    return unit


def _camera_in_room(scene: Scene, points: SurfacePoints, axes: np.ndarray, room: np.ndarray) -> Camera | None:
    """Return a camera at eye height in the room around `room`, with a far view and much detail; None where no point is clear."""
    low, high = _extent(scene, axes)
    around = surroundings(points, room, axes)
    height = float(room @ axes[1])
    rise = directions(axes) @ axes[1]
    below, above = rise < -0.7, rise > 0.7
    floor = height - float(np.median(np.where(np.isfinite(around.distance), around.distance * -rise, np.inf)[below]))
    ceiling = height + float(np.median(np.where(np.isfinite(around.distance), around.distance * rise, np.inf)[above]))
    floor, ceiling = max(floor, float(low[1])), min(ceiling, float(high[1]))
    tall = ceiling - floor
    eye = floor + (_EYE if _STOREY[0] <= tall <= _STOREY[1] else _EYE_SHARE * tall)
    share = (eye - low[1]) / max(high[1] - low[1], 1e-30)
    level = np.abs(rise) < 0.25
    clear = _LEAST_CLEARANCE * float(np.hypot(*(high - low)[[0, 2]]))
    detail = points.detail()
    margin = _EDGE * points.spacing
    near_sides = ((detail @ axes.T < low + margin) | (detail @ axes.T > high - margin)).sum(1)
    detail = detail[near_sides < 2]  # excludes the edges between walls, floor and ceiling
    near = _NEAR * float(np.linalg.norm(high - low))
    best, camera = 0.0, None
    for at in [*_grid(low, high, axes, (float(share),)), room + (eye - height) * axes[1]]:
        around = surroundings(points, at, axes)
        if around.closed < _CLOSED_ROOM - 0.1 or around.fronts < _LEAST_FRONTS:
            continue
        distance = np.where(np.isfinite(around.distance), around.distance, 0.0)
        if distance[level & np.isfinite(around.distance)].min(initial=np.inf) < clear:
            continue
        ahead = distance[level].reshape(-1, distance.shape[1]).mean(0)
        view = sum(np.roll(ahead, step) * weight for step, weight in ((-2, 0.5), (-1, 1.0), (0, 1.0), (1, 1.0), (2, 0.5))) / 4.0
        worth = np.sqrt(view) * (1.0 + _seen_detail(detail, around, at, axes, near))
        sector = int(np.argmax(worth))
        if worth[sector] > best:
            way = directions(axes)[:, sector].mean(0)
            way = way - (way @ axes[1]) * axes[1]
            way = way / np.linalg.norm(way)
            best = float(worth[sector])
            camera = Camera(_point(at), _point(at + float(view[sector]) * way), _point(axes[1]), _INSIDE)
    return camera


def _seen_detail(detail: np.ndarray, around: Surroundings, at: np.ndarray, axes: np.ndarray, near: float) -> np.ndarray:
    """Return (SECTORS,) the weighted number of `detail` points (M, 3) that a level picture from `at` towards each sector shows.

    Points in the middle weigh most, and points nearer than `near` metres less, because they hide others.
    """
    distance, ring, sector = cells(detail - at, axes)
    level = np.abs(ring + 0.5 - 0.5 * around.distance.shape[0]) < _PICTURE_RISE * 0.5 * around.distance.shape[0]
    seen = level & (distance < _HIDDEN * around.distance[ring, sector])
    sectors = around.distance.shape[1]
    weight = np.minimum(distance[seen] / near, 1.0) ** 2
    counts = np.bincount(sector[seen], weight, minlength=sectors)
    steps = np.arange(-_PICTURE_SECTORS, _PICTURE_SECTORS + 1)
    share = np.cos(0.5 * np.pi * steps / (_PICTURE_SECTORS + 1))  # the middle weighs most
    found: np.ndarray = sum((w * np.roll(counts, int(step)) for step, w in zip(steps, share, strict=True)), np.zeros(sectors))
    return found


def _point(values: np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
