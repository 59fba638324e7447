"""A short run of the fuzzing, and the inputs that once broke a reader, as small as they were found."""

from __future__ import annotations

import numpy as np
import pytest

from tests.trust.fuzz import readers

FOUND = [
    ("hdr", b"#?RADIANCE\nEXPOSURE=...\n\n-Y 1 +X 1\n\1\2\3\x80"),
    ("hdr", b"#?RADIANCE\nEXPOSURE=1e15\nEXPOSURE=1e15\nEXPOSURE=1e15\n\n-Y 1 +X 1\n\1\2\3\x80"),
    ("hdr", b"#?RADIANCE\n\n-Y 99999 +X 99\n\1\2\3\x80" + b"\1\1\1\xff" * 4),  # a run of 10^9 pixels
    ("obj-strict", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nvn 0 0 1\nf 1\x19//1 2//1 3//1\n"),  # a control character is a blank
    ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 " + b"3" * 400 + b"\n"),
    ("scene", b"sky 1 1 " + b"9" * 400 + b"\nobj t.obj\n"),
    ("scene", "obj a\ud800.obj\n".encode("utf-8", "surrogatepass")),
    ("gltf", b'{"asset": {"version": "2.0"}, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": [0]}]}]}'),
    ("ies", b"IESNA91\nTILT=" + b"x" * 300 + b"\n"),  # a name that no file system takes
    ("settings", b"placement=\x85"),
    ("command-line", b"render\n\x85\x1c\n\n"),
    ("cache", readers.npz({**readers.cache_arrays(), "about": np.array("[" * 9999)})),
    (
        "cache",
        readers.npz({**readers.cache_arrays(), "about": np.array('{"key": {"geometry": 1, "lights": 1, "settings": 3}}')}),
    ),
    ("cache", readers.npz({**readers.cache_arrays(), "position": np.array(["x"] * 3)})),
]


@pytest.mark.parametrize(("name", "data"), FOUND)
def test_what_once_broke_a_reader_breaks_it_no_more(name, data):
    assert readers.judge(name, data) in ("read", "refused")


@pytest.mark.parametrize("name", readers.READERS)
def test_seeds_are_read(name):
    found = {readers.judge(name, data) for data in readers.seeds(name)}
    assert "read" in found


@pytest.mark.parametrize("name", readers.READERS)
def test_odd_input_is_read_or_refused(name):
    pytest.importorskip("hypothesis", reason="pip install '.[dev]'")
    from tests.trust.fuzz import run

    tally = run.Tally(name, None)
    run.structured(name, 40, 1, tally)
    assert not tally.places
