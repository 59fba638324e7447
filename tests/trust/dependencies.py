"""Dependencies of irrsplat: least and newest versions, licences, and the exact versions of CI.

    python tests/trust/dependencies.py oldest      run some tests with the least version of each in pyproject.toml
    python tests/trust/dependencies.py newest      run them with the newest versions, also in a new environment
    python tests/trust/dependencies.py lock        write .ci/constraints.txt: the versions installed here

Exit status: 0 if all is well; 1 if tests fail.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

from packaging.markers import Marker

ROOT = Path(__file__).resolve().parents[2]
LOCK = ROOT / ".ci/constraints.txt"
TESTED = (
    *("tests/core/test_settings.py", "tests/scene/test_scenes.py", "tests/scene/test_gltf.py", "tests/scene/test_obj.py"),
    *("tests/image/test_output.py", "tests/app/commands/test_cli_cache.py", "tests/trust/test_outputs.py"),
    *("tests/gather/test_embree.py", "tests/lighting/test_cie.py", "tests/app/viewer/interface/test_window.py"),
)
ALLOWED = ("MIT", "BSD", "Apache", "ISC", "PSF", "Python Software Foundation", "HPND", "Zlib", "Unlicense", "CC0", "0BSD", "MPL")
SILENT = {"alktx2": "names none; optional, for KTX2 images"}
SENTENCES = {  # phrases of licences, for packages that do not name theirs
    "Permission is hereby granted, free of charge": "MIT",
    "Redistribution and use in source and binary forms": "BSD",
    "Apache License": "Apache",
}
EXTRAS = ("gltf", "bake", "video", "docs", "dev")
_NAME = re.compile(r"[A-Za-z0-9._-]+")


def declared(extras: Sequence[str] = EXTRAS) -> list[str]:
    """Return the requirements of pyproject.toml and of some extras, by default those of CI."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [*project["dependencies"], *(one for extra in extras for one in project["optional-dependencies"][extra])]


def named(requirement: str) -> str:
    """Return a requirement's package name in its normalized form."""
    found = _NAME.match(requirement)
    assert found is not None, requirement
    return re.sub(r"[-_.]+", "-", found[0]).lower()


def least(requirement: str) -> str:
    """Return the least version of a requirement."""
    found = re.search(r">=\s*([\w.]+)", requirement.split(";")[0])
    assert found is not None, f"{requirement}: no least version is given"
    return found[1]


def needed(name: str = "irrsplat", extras: Sequence[str] = EXTRAS) -> Iterator[str]:
    """Yield the installed packages that a package needs, directly or indirectly, each once."""
    waiting: list[tuple[str, Sequence[str]]] = [(name, extras)]
    seen: set[str] = set()
    while waiting:
        package, requested = waiting.pop()
        for requirement in metadata.requires(package) or ():
            text, _, condition = requirement.partition(";")
            other = named(text)
            asked = not condition or any(Marker(condition).evaluate({"extra": extra}) for extra in ("", *requested))
            if asked and other not in seen and installed(other):
                seen.add(other)
                further = re.search(r"\[([\w, -]+)\]", text)
                waiting.append((other, further[1].replace(" ", "").split(",") if further else ()))
    yield from sorted(seen)


def installed(name: str) -> str:
    """Return the installed version of a package, or ""."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def licence(name: str) -> str:
    """Return a package's declared licence, else the licences of known phrases in its files."""
    about = metadata.metadata(name)
    kinds = [value.split(" :: ")[-1] for value in about.get_all("Classifier") or () if value.startswith("License ::")]
    stated = [value for field in ("License-Expression", "License") for value in about.get_all(field) or ()]
    for words in (*(about.get_all("License-Expression") or ()), ", ".join(kinds), *stated):
        if allowed(words.strip().partition("\n")[0]):
            return str(words).strip().partition("\n")[0]
    files = [file for file in metadata.files(name) or () if re.match(r"(?i)(licen[cs]e|copying)", file.name)]
    texts = [" ".join(Path(str(file.locate())).read_text(encoding="utf-8", errors="replace").split()) for file in files]
    return " and ".join(short for sentence, short in SENTENCES.items() if any(sentence in text for text in texts))


def allowed(words: str) -> bool:
    """True if a licence permits use together with MIT-licensed code without further duties."""
    return any(word.lower() in words.lower() for word in ALLOWED)


def lock() -> str:
    """Return the text of constraints: exact versions of all needed packages installed here."""
    lines = (f"{name}=={installed(name)}\n" for name in needed() if name != "irrsplat")
    return f"# Versions that CI uses, written by {Path(__file__).relative_to(ROOT)} lock\n" + "".join(lines)


def tried(constraints: str) -> int:
    """Return the exit status of some tests in a new environment restricted by `constraints`."""
    with tempfile.TemporaryDirectory() as folder:
        python, file = Path(folder) / "venv/bin/python", Path(folder) / "constraints.txt"
        subprocess.run([sys.executable, "-m", "venv", Path(folder) / "venv"], check=True)
        file.write_text(constraints)
        pip = [str(python), "-m", "pip", "--disable-pip-version-check"]
        subprocess.run([*pip, "install", "-q", "-c", file, "-e", f"{ROOT}[{','.join(EXTRAS)}]"], check=True)
        subprocess.run([*pip, "list"], check=True)
        return subprocess.run([python, "-m", "pytest", "-q", *TESTED], cwd=ROOT, check=False).returncode


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit status."""
    if arguments in (["oldest"], ["newest"]):
        return tried("".join(f"{named(one)}=={least(one)}\n" for one in declared(["gltf"])) if "oldest" in arguments else "")
    if arguments == ["lock"]:
        LOCK.write_text(lock(), encoding="utf-8")
        return 0
    print(__doc__, file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
