"""Arguments and files that are refused in one line, and what works without a home, without locks and without any vertex."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import irrsplat
from irrsplat.core import files, paths
from irrsplat.core.errors import InputError
from irrsplat.core.load_options import LoadOptions
from irrsplat.image.frame import check_writable


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: irrsplat.load(5), "load takes a path or the name of a bundled scene, not int"),  # type: ignore[arg-type]
        (lambda: irrsplat.load("cornell", photometric="lux"), "photometric is True or False, not 'lux'"),  # type: ignore[arg-type]
        (lambda: irrsplat.load("cornell", up_axis="w"), "up_axis is one of .*, not 'w'"),  # type: ignore[arg-type]
        (lambda: irrsplat.load("cornell", sky=1.0), "sky is a text such as .*, not 1.0"),  # type: ignore[arg-type]
        (lambda: LoadOptions(allow=["a"]), r"allow is a list of folders, not \['a'\]"),  # type: ignore[arg-type]
        (lambda: check_writable(""), "an output path is empty"),
        (lambda: check_writable("-"), "-: no output goes to stdout here; name a file or a folder"),
    ],
)
def test_what_an_argument_cannot_mean_is_told_in_a_line(call: Callable[[], object], says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_files_are_written_where_there_are_no_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows has no fcntl."""
    monkeypatch.setattr(files, "fcntl", None)
    files.write_text(tmp_path / "a", "text")
    assert (tmp_path / "a").read_text() == "text" and [file.name for file in tmp_path.iterdir()] == ["a"]


def test_folders_that_are_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bundled one is an error; the cache's is the user's own, where no variable names one."""
    with pytest.raises(FileNotFoundError, match="the bundled folder 'nowhere' is missing"):
        paths.folder("nowhere")
    monkeypatch.delenv("IRRSPLAT_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/var/a cache")
    found = paths.user_folder("cache")
    assert found is not None and found.name == "irrsplat"


@pytest.mark.skipif(not Path("/proc/version").is_file(), reason="only Linux has files that tell no size")
def test_a_file_that_tells_no_size_is_read_up_to_its_bound() -> None:
    assert paths.read_bytes(Path("/proc/version"))
    with pytest.raises(InputError, match="the file is larger than 0 MiB"):
        paths.read_bytes(Path("/proc/version"), 3)
