"""Short and long fuzzing runs, and minimal inputs that once broke a reader.

IRRSPLAT_CASES: cases per reader in the long form (2000). IRRSPLAT_SEED: their seed (1). With -s, counts are printed.
"""

from __future__ import annotations

import os
import traceback
from collections import Counter

import numpy as np
import pytest

from tests.trust.fuzz import readers

CASES = int(os.environ.get("IRRSPLAT_CASES", "2000"))
SEED = int(os.environ.get("IRRSPLAT_SEED", "1"))
FOUND = [
    ("hdr", b"#?RADIANCE\nEXPOSURE=...\n\n-Y 1 +X 1\n\1\2\3\x80"),
    ("hdr", b"#?RADIANCE\nEXPOSURE=1e15\nEXPOSURE=1e15\nEXPOSURE=1e15\n\n-Y 1 +X 1\n\1\2\3\x80"),
    ("hdr", b"#?RADIANCE\n\n-Y 99999 +X 99\n\1\2\3\x80" + b"\1\1\1\xff" * 4),  # a run of 10^9 pixels
    ("obj-strict", b"v 0 0 0\nv 1 0 0\nv 1 1 0\nvn 0 0 1\nf 1\x19//1 2//1 3//1\n"),  # a control character is a blank
    ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 " + b"3" * 400 + b"\n"),
    ("scene", b"sky 1 1 " + b"9" * 400 + b"\nobj t.obj\n"),
    ("scene", "obj a\ud800.obj\n".encode("utf-8", "surrogatepass")),
    ("gltf", b'{"asset": {"version": "2.0"}, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": [0]}]}]}'),
    ("ies", b"IESNA91\nTILT=" + b"x" * 300 + b"\n"),  # a name too long for any file system
    ("settings", b"placement=\x85"),
    ("command-line", b"render\n\x85\x1c\n\n"),
    ("cache", {"about": np.array("[" * 9999)}),
    ("cache", {"about": np.array('{"key": {"geometry": 1, "lights": 1, "settings": 3}}')}),
    ("cache", {"position": np.array(["x"] * 3)}),
]


@pytest.mark.parametrize(("name", "data"), FOUND)
def test_inputs_of_past_faults_are_read_or_refused(name: str, data: bytes | dict[str, np.ndarray]) -> None:
    whole = data if isinstance(data, bytes) else readers.npz({**readers.cache_arrays(), **data})
    assert readers.judge(name, whole) in ("read", "refused")


@pytest.mark.parametrize("name", readers.READERS)
def test_seeds_are_read_and_mutations_are_read_or_refused(name: str) -> None:
    assert "read" in {readers.judge(name, data) for data in readers.seeds(name)}
    cut = [
        data[:end] for data in readers.seeds(name) for end in range(0, len(data), len(data) // 30 + 1)
    ]  # as an editor writes it
    assert {readers.judge(name, data) for data in cut} <= {"read", "refused"}
    fuzz(name, 25)


@pytest.mark.long
@pytest.mark.parametrize("name", readers.READERS)
def test_many_mutations_are_read_or_refused(name: str) -> None:
    fuzz(name, CASES)


def fuzz(name: str, cases: int) -> None:
    """Feed a reader with hypothesis' inputs; fail with one input for each place of an unexpected error."""
    hypothesis = pytest.importorskip("hypothesis", reason="pip install '.[dev]'")
    from tests.trust.fuzz.structures import inputs

    counts, broken = Counter[str](), dict[str, tuple[str, bytes]]()

    def feed(data: bytes) -> None:
        try:
            counts[readers.judge(name, data)] += 1
        except Exception as error:
            frames = traceback.extract_tb(error.__traceback__)
            ours = [frame for frame in frames if "/irrsplat/" in frame.filename or "/app/" in frame.filename] or list(frames)
            broken.setdefault(f"{ours[-1].filename}:{ours[-1].lineno}", (repr(error)[:120], data))

    for first in range(0, cases, 2000):  # hypothesis keeps its history: a limited number at a time
        settings = hypothesis.settings(
            max_examples=min(2000, cases - first), database=None, deadline=None, phases=[hypothesis.Phase.generate],
            suppress_health_check=list(hypothesis.HealthCheck),
        )  # fmt: skip
        hypothesis.seed(SEED + first)(settings(hypothesis.given(inputs(name))(feed)))()
    print(f"\n{name}: {dict(counts)}")
    assert broken == {}
