"""irrsplat as a peer: the preset `preview`, also coarser, and the default one at several values of `a`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import cast

from irrsplat.app.bench import cases
from irrsplat.app.bench.peers.judging import Measurement, Series, fastest_first
from irrsplat.app.bench.peers.table import Notify
from irrsplat.reference.timed_levels import ENOUGH, SECONDS, JudgedView
from irrsplat.scene.model import Scene
from irrsplat.settings import PRESETS, SETTINGS, All, Settings, SettingValues

A = (0.8, 0.6, 0.5, 0.4, 0.3, 0.25)
# A record of half the radius has half the error tolerance and twice the gather resolution, so that the gather never limits.
_WITH_A = ("radius_min", "radius_max", "adapt", "spread")


def _scaled(a: float) -> SettingValues:
    """Return the settings that scale a record's radius to that of `a`."""
    base = Settings()
    factor = a / base.a
    found: dict[str, float] = {"a": a, "gather_size": 4 * round(base.gather_size / factor / 4)}
    found |= {name: getattr(base, name) * factor for name in _WITH_A}
    for name, value in found.items():
        low, high = SETTINGS[name].low, SETTINGS[name].high
        assert low is not None and high is not None
        found[name] = min(max(value, low), high)
    return cast(SettingValues, found)


LEVELS: dict[str, SettingValues] = {
    "preview of 16² rays, a 1.4": PRESETS["preview"] | {"a": 1.4, "gather_size": 16},
    "preview": PRESETS["preview"],
    **{f"a {a:.3g}": _scaled(a) for a in A},
}


def measure(
    scene: Scene, size: tuple[int, int], bounces: int | All, views: Sequence[JudgedView], notify: Notify
) -> Iterator[Series]:
    """Measure from an empty cache, then the further view with the kept records."""
    import irrsplat

    first, second = views
    found: list[Measurement] = []
    about = ""
    for name, values in LEVELS.items():
        with irrsplat.Renderer(scene, size=size, **(values | {"bounces": bounces})) as renderer:
            notify(f"irrsplat, {name}")
            one = bounces == 1
            cases.warm_up(renderer, first.camera, surface=one)
            # a first picture also chooses the sites of the surface cache, which a second one finds
            empty = cases.middle(cases.from_records(renderer, first.camera)) if one else cases.picture(renderer, first.camera)
            kept = cases.records_of(renderer)
            rmse = first.truth.error(renderer.render(first.camera).irradiance)
            further = cases.middle(cases.from_records(renderer, second.camera, kept))
            further_rmse = second.truth.error(renderer.render(second.camera).irradiance)
            about = f"from the loaded scene and compiled shaders, on {renderer.about['renderer']}"
        assert rmse is not None and further_rmse is not None
        quality = f"{name}, {empty.records} records"
        found.append(Measurement("irrsplat", quality, empty.processor, rmse, further.processor, further_rmse))
        if rmse <= ENOUGH / 2.0 or empty.processor >= SECONDS:
            break
    yield Series(fastest_first(found), about, (27, 94, 160))
