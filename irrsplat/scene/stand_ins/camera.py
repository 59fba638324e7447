"""Default camera for a scene whose file has none: in front of an object, or in a room; and the subject that it shows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from irrsplat.core.vectors import vector
from irrsplat.scene.model import Camera, Mesh, Scene
from irrsplat.scene.stand_ins.surroundings import SurfacePoints, Surroundings, directions, surroundings

_OUTSIDE, _INSIDE = 45.0, 65.0  # degrees: vertical fields of view
_THREE_QUARTERS = np.array([0.48, 0.36, 0.8])  # right, up and front, unit: direction from an object to the camera
_FROM_ABOVE = np.array([0.33, 0.77, 0.546])  # the same for rooms without ceilings, past the nearer walls
_CLOSED_ROOM = 0.85  # least share of blocked directions in a closed room
_OPEN_SIDE = 0.7  # the same at the open side of a room that lacks a wall
_ANY_ROOM = 0.5  # the same anywhere in a room
_LEAST_FRONTS = 0.6  # least share of visible surfaces that are front-facing; inside a solid object only backs are visible
_LEAST_VOLUME = 0.2  # of the bounding box that is visible from inside; less is a cavity of an object
_EYE, _STOREY = 1.6, (1.9, 60.0)  # metres: eye height for ceilings in this range, in files whose unit is the metre
_EYE_SHARE = 0.45  # of the height of other rooms
_LEAST_CLEARANCE = 0.15  # of the median distance around the eye: least distance to obstacles
_PLACES, _STAGE_PLACES = 0.1, 0.6  # least share of tried points inside a closed room, and a room that may lack a wall
_ROOFLESS = 0.15  # least share of tried points between walls without a ceiling, in a building, bowl or pool without one
_GRID = 5  # tried points along each side of the floor
_HEIGHTS = 0.35, 0.65  # of the bounding box: heights of the tried points
_MOST_VERTICES = 200_000  # vertices that are examined
_OUTLIERS = 0.005  # of the vertices, at either end of each axis: those of a ground or backdrop
_SUBJECT_SIZE = 0.25  # of the scene's diagonal: a smaller part with nearly all vertices is the subject
_MARGIN = 0.5  # of the subject's diagonal: margin for objects that belong to it, such as walls around furniture
_SPLITS = 16  # at most; each halves the edges of a triangle that extends beyond the subject


@dataclass(frozen=True)
class RoomPlaces:
    """Points of a scene that may be inside a room.

    places: position (3,) and surroundings of each. roofless: True if walls without a ceiling surround much of the scene, as in a
    building without ceilings, or in a bowl.
    """

    places: tuple[tuple[np.ndarray, Surroundings], ...]
    roofless: bool = False

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


def room_places(scene: Scene, points: SurfacePoints, axes: np.ndarray) -> RoomPlaces:
    """Return the places in the bounding box that may be in a room. points: on the surfaces. axes: as in default_camera."""
    corners = scene.corners @ axes.T
    low, size = corners.min(0), np.ptp(corners, axis=0)
    least = _LEAST_VOLUME * float(np.prod(size))
    if not len(points.position) or least == 0.0:
        return RoomPlaces(())
    share = (np.arange(_GRID) + 0.5) / _GRID
    grid = np.stack(np.meshgrid(share, _HEIGHTS, share, indexing="ij"), -1).reshape(-1, 3)
    tried = [(at, surroundings(points, at, axes)) for at in (low + grid * size) @ axes]
    in_front = [place for place in tried if place[1].fronts >= _LEAST_FRONTS]
    roofless = sum(around.open_above for _, around in in_front) >= _ROOFLESS * len(tried)
    found = RoomPlaces(tuple(p for p in in_front if p[1].closed >= _ANY_ROOM and p[1].volume >= least), roofless)
    return found if found.stage or len(found.rooms) >= _PLACES * len(tried) else RoomPlaces((), roofless)


def default_camera(scene: Scene, points: SurfacePoints, axes: np.ndarray, room_places: RoomPlaces) -> tuple[Camera, bool]:
    """Return a camera for the scene, and True if it is in a closed room.

    It is in a closed room at eye height, where it shows most surface; in front of the open side of a room that lacks a wall; or
    in front of an object, from above to one side, and steeply from above if ceilings are missing. points: on the surfaces.
    axes: (3, 3) rows right, up and front of the world.
    """
    if room_places.stage and room_places.most_open.closed < _OPEN_SIDE:
        way = _way_out(room_places.most_open, axes)
        if way is not None:
            return _camera_in_front(scene, axes, way), False
    camera = _camera_in_room(points, axes, room_places.rooms) if room_places.rooms else None
    if camera is not None:
        return camera, True
    return _camera_in_front(scene, axes, _FROM_ABOVE if room_places.roofless else _THREE_QUARTERS), False


def enclosure_of_camera(scene: Scene, points: SurfacePoints, axes: np.ndarray, room_places: RoomPlaces) -> Surroundings | None:
    """Return the surroundings of the first camera if they are closed, or if it is in a scene that is a room; else None."""
    if not len(points.position):
        return None
    eye = np.asarray(scene.cameras[0].eye)
    around = surroundings(points, eye, axes)
    within = bool(((scene.bounds[0] <= eye) & (eye <= scene.bounds[1])).all())
    in_room = within and room_places.rooms and room_places.most_open.closed >= _OPEN_SIDE
    return around if around.closed >= _CLOSED_ROOM or in_room else None


def _camera_in_front(scene: Scene, axes: np.ndarray, way: np.ndarray) -> Camera:
    """Return the nearest camera in direction `way` (right, up and front) that sees every vertex; they are in mid-picture."""
    out = way @ axes
    centre = scene.bounds.mean(0)
    towards = Camera(vector(centre + out), vector(centre), vector(axes[1]), _OUTSIDE)
    slope = np.tan(np.radians(_OUTSIDE) / 2.0) / 1.08  # 8 % is the margin of the picture
    # on the sides x, y, -x, -y: the distance of a plane of the view from the centre, which is in view, too
    farthest = np.zeros(4)
    for points in (mesh.positions for mesh in scene.meshes if len(mesh.positions)):
        x, y, z = towards.axes.astype("f4") @ (points - centre.astype("f4")).T
        farthest = np.maximum(farthest, [(side + slope * z).max() for side in (x, y, -x, -y)])
    aside = 0.5 * (farthest[:2] - farthest[2:])  # equal distances to opposite planes
    reach = max(0.05 * scene.diagonal, float((farthest[:2] + farthest[2:]).max()) / (2.0 * slope))
    target = centre + aside @ towards.axes[:2]
    return Camera(vector(target + reach * out), vector(target), vector(axes[1]), _OUTSIDE)


def _way_out(around: Surroundings, axes: np.ndarray) -> np.ndarray | None:
    """Return a direction out of the open side, slightly raised, as right, up and front; None where that is not sideways."""
    ways = directions(axes)[~np.isfinite(around.distance)] @ axes.T
    mean = ways.mean(0)
    level = np.array([mean[0], 0.0, mean[2]])
    length = float(np.linalg.norm(level))
    if length < 0.45 or abs(mean[1]) > length:
        return None
    way = level / length + np.array([0.0, 0.06, 0.0])
    return np.asarray(way / np.linalg.norm(way))


def _camera_in_room(points: SurfacePoints, axes: np.ndarray, rooms: list[tuple[np.ndarray, Surroundings]]) -> Camera | None:
    """Return the camera at eye height, above or below one of these places, that shows most surface; None if no place is clear."""
    best, camera = 0.0, None
    rise, farthest = directions(axes) @ axes[1], float(np.ptp(points.position, axis=0).max())
    for at, around in rooms:
        heights = np.minimum(around.distance, farthest) * np.abs(rise)
        below, above = (float(np.quantile(heights[side], 0.75)) for side in (rise < -0.7, rise > 0.7))
        eye = _EYE if _STOREY[0] <= below + above <= _STOREY[1] else _EYE_SHARE * (below + above)
        at = at + (eye - below) * axes[1]
        around = surroundings(points, at, axes)
        level = np.minimum(around.distance, farthest)[np.abs(rise[:, 0]) < 0.25]
        if min(around.fronts, around.closed) < _LEAST_FRONTS or level.min() < _LEAST_CLEARANCE * np.median(level):
            continue
        shown = around.shown(points, at, axes)
        sector = int(np.argmax(shown))
        if shown[sector] > best:
            way = directions(axes)[:, sector].mean(0)
            way *= np.median(level[:, sector]) / np.linalg.norm(way)
            best, camera = float(shown[sector]), Camera(vector(at), vector(at + way), vector(axes[1]), _INSIDE)
    return camera


# ---- the subject ------------------------------------------------------------------------------------------------------


def subject(scene: Scene) -> Scene:
    """Return the scene cut to its subject: a small part with nearly all vertices, if there is one, else all of it."""
    count = sum(len(mesh.positions) for mesh in scene.meshes)
    if not count:
        return scene
    step = -(-count // _MOST_VERTICES)
    vertices = np.concatenate([mesh.positions[::step] for mesh in scene.meshes]).astype(float)
    low, high = np.quantile(vertices, (_OUTLIERS, 1.0 - _OUTLIERS), axis=0)
    size = float(np.linalg.norm(high - low))
    if size >= _SUBJECT_SIZE * scene.diagonal or size == 0.0:
        return scene
    vertices = np.concatenate([mesh.positions for mesh in scene.meshes])
    near = vertices[((vertices >= low - _MARGIN * size) & (vertices <= high + _MARGIN * size)).all(1)]
    meshes = tuple(_cut(mesh, near.min(0), near.max(0)) for mesh in scene.meshes)
    return replace(scene, meshes=tuple(mesh for mesh in meshes if len(mesh.faces)))


def _cut(mesh: Mesh, low: np.ndarray, high: np.ndarray) -> Mesh:
    """Return the mesh's triangles with their centre in a box, without vertex attributes; large triangles are split first."""
    corners = mesh.positions[mesh.faces]
    if ((corners >= low) & (corners <= high)).all():
        return mesh
    largest = 0.1 * float(np.linalg.norm(high - low))
    done = []
    for _ in range(_SPLITS):
        corners = corners[((corners.max(1) >= low) & (corners.min(1) <= high)).all(1)]
        out = ((corners < low) | (corners > high)).any((1, 2)) & (np.ptp(corners, axis=1).max(1) > largest)
        done.append(corners[~out])
        a, b, c = np.moveaxis(corners[out], 1, 0)
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        corners = np.concatenate([np.stack(three, 1) for three in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    corners = np.concatenate(done)
    middle = corners.mean(1)
    corners = corners[((middle >= low) & (middle <= high)).all(1)].reshape(-1, 3)
    faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return Mesh(corners, np.zeros_like(corners), faces, mesh.material, name=mesh.name)
