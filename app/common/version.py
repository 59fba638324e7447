"""Installed version and a digest of its code."""

from __future__ import annotations

from functools import cache


def version() -> str:
    """Return the installed version."""
    from importlib import metadata

    try:
        return metadata.version("irrsplat")
    except metadata.PackageNotFoundError:
        return "(not installed)"


@cache
def software() -> str:
    """Return the version and a digest of code and shaders: equal digests give equal pictures with one driver."""
    import hashlib
    from pathlib import Path

    from irrsplat.core import paths

    package, app, shaders = Path(paths.__file__).parents[1], Path(__file__).parents[1], paths.folder("shaders")
    core = [path for path in package.rglob("*.py") if not path.is_relative_to(app)]
    found = {f"core/{path.relative_to(package).as_posix()}": path for path in core}
    found |= {f"app/{path.relative_to(app).as_posix()}": path for path in app.rglob("*.py")}
    found |= {
        f"shaders/{path.relative_to(shaders).as_posix()}": path
        for path in shaders.rglob("*.*")
        if path.is_file() and ".py" not in path.suffix
    }
    digest = hashlib.sha256()
    for name, path in sorted(found.items()):
        digest.update(f"{name}\n".encode() + hashlib.sha256(path.read_bytes()).digest())
    return f"{version()}, code {digest.hexdigest()[:12]}"
