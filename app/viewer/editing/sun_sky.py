"""A CIE sky with its sun by place, date and time, as the viewer sets it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime, timedelta, timezone

from irrsplat.scene.model import Light, Scene, sun_lights
from irrsplat.scene.stand_ins.up_axis import axes
from irrsplat.sky.cie import CIE_KINDS, GROUND, ROWS, TURBIDITY, CieKind, CieSky
from irrsplat.sky.environment import Environment, frame_of
from irrsplat.sky.sun_position import sun_position

QUICK = 96  # rows of the map while a slider is dragged
LAST_MINUTE = 24 * 60 - 1


@dataclass(frozen=True)
class SunSky:
    """A sky of one of CIE_KINDS. latitude, longitude, north: degrees, as in a `.scene`. day: of the year, from 1; minute: of that
    day, by a clock that is `zone` hours ahead of UTC. lux: the sky's own illuminance; None: as the sun's height has it."""

    kind: CieKind = "clear"
    latitude: float = 50.0
    longitude: float = 10.0
    year: int = 2026
    day: int = 172
    minute: int = 12 * 60
    zone: float = 1.0
    turbidity: float = TURBIDITY
    ground: float = GROUND
    lux: float | None = None
    north: float = 0.0

    @classmethod
    def of(cls, line: str) -> SunSky | None:
        """The sky that a line of a `.scene` says; None where that does not say place and time."""
        words = line.split()
        if words[:1] != ["cie"] or "at" not in words:
            return None
        kind = next(kind for kind in CIE_KINDS if kind == words[1])
        at = words.index("at")
        when = datetime.fromisoformat(words[at + 3])
        offset = when.utcoffset() or timedelta()
        given = {name: float(words[words.index(name) + 1]) for name in ("turbidity", "ground", "lux", "north") if name in words}
        return cls(
            kind,
            float(words[at + 1]),
            float(words[at + 2]),
            when.year,
            when.timetuple().tm_yday,
            60 * when.hour + when.minute,
            offset.total_seconds() / 3600.0,
            given.get("turbidity", TURBIDITY),
            given.get("ground", GROUND),
            given.get("lux"),
            given.get("north", 0.0),
        )

    @property
    def when(self) -> datetime:
        """The moment."""
        start = datetime(self.year, 1, 1, tzinfo=timezone(timedelta(hours=self.zone)))
        return start + timedelta(days=self.day - 1, minutes=self.minute)

    @property
    def sun(self) -> tuple[float, float]:
        """The sun's altitude and azimuth, degrees."""
        return sun_position(self.latitude, self.longitude, self.when)

    @property
    def line(self) -> str:
        """The words after `sky` in a `.scene`."""
        place = f"{self.latitude!r} {self.longitude!r} {self.when.isoformat(timespec='minutes')}"
        words = ["cie", self.kind, "at", place, "ground", repr(self.ground)]
        words += ["turbidity", repr(self.turbidity)] if self.kind in ("clear", "intermediate") else []
        words += ["lux", repr(self.lux)] if self.lux is not None else []
        return " ".join([*words, *(["north", repr(self.north)] if self.north else [])])

    def environment(self, up: tuple[float, float, float], rows: int = ROWS) -> Environment | None:
        """The sky over a scene with this `up`, as a map of so many rows; None while the sun is below the horizon."""
        altitude, azimuth = self.sun
        if altitude <= 0.0:
            return None
        about = f"CIE {self.kind}, sun at altitude {altitude:.1f}°, azimuth {azimuth:.1f}°"
        sky = CieSky(self.kind, altitude, azimuth, self.turbidity, self.ground, self.lux)
        return replace(sky.environment(about, self.line, rows), frame=frame_of(axes(up), self.north))


def with_sky(scene: Scene, environment: Environment | None) -> Scene:
    """The scene under this sky, or under none; its lights are left as they are."""
    nothing = (0.0, 0.0, 0.0)
    return replace(scene, environment=environment, sky=nothing, sky_gradient=nothing, own_sky=True)


def sun_of(environment: Environment | None, before: Light | None) -> Light:
    """The light that the sun of a sky is; where it has none, one that gives no light and stands where it stood before."""
    found = () if environment is None else sun_lights(environment)
    if found:
        return found[0]
    place = before.position if before is not None else (0.0, 1.0, 0.0)
    return Light(place, (0.0, 0.0, 0.0), directional=True, name="sun")


def is_sun_of(light: Light, environment: Environment | None) -> bool:
    """Return True if a light is one of a sky's suns."""
    return environment is not None and light in sun_lights(environment)
