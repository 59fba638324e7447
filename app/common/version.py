"""Installed version."""

from __future__ import annotations


def version() -> str:
    """Return the installed version."""
    from importlib import metadata

    try:
        return metadata.version("irrsplat")
    except metadata.PackageNotFoundError:
        return "(not installed)"
