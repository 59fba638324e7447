"""Settings without effect in the viewer while others are as they are, and why."""

from __future__ import annotations

from irrsplat.settings import SETTINGS, Settings

_OF_RENDERS = ("samples", "quality", "max_rounds")
_OF_DERIVATIVES = ("second_order", "radius")
_OF_INDIRECT_LIGHT = ("fill_holes", "viewer_quality", "coarse")
_INDIRECT = ("gather", "splat", "examine")  # stages that are left out without bounces
_ALWAYS = ("bounces", "seed")


def why_idle(name: str, settings: Settings) -> str | None:
    """Why the setting `name` changes nothing that the viewer shows while the others are as in `settings`; None: it does."""
    if name in _OF_RENDERS:
        return "irrsplat render alone goes by it"
    concerned = SETTINGS[name].stage in _INDIRECT and name not in _ALWAYS
    if settings.most_bounces == 0 and (concerned or name in _OF_INDIRECT_LIGHT):
        return "bounces is 0: there is no indirect light"
    if name in _OF_DERIVATIVES and not settings.gradients:
        return "gradients is off: records know no derivatives"
    if name == "warmup" and settings.placement == "tiles":
        return "placement is tiles: there is no random warm-up"
    if name == "viewer_quality" and settings.placement == "scan":
        return "placement is scan: what the paper's order has placed is not refined"
    return None
