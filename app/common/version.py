"""The version that is installed."""

from __future__ import annotations


def version() -> str:
    """The installed version."""
    from importlib import metadata

    try:
        return metadata.version("irrsplat")
    except metadata.PackageNotFoundError:
        return "(not installed)"
