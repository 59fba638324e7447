"""Structured inputs of each format with odd content, by hypothesis: cases that random byte changes rarely reach."""

from __future__ import annotations

import copy
import json
import re
import struct
from typing import Any

import numpy as np
from hypothesis import strategies as st

from irrsplat.scene.io.lights import light_text
from irrsplat.scene.io.text import scene_text
from irrsplat.settings import SETTINGS
from tests.trust.fuzz import readers

_ODD_NUMBERS = (
    "0 1 -1 2 3 0.5 -0 90 180 1e15 1e16 -1e15 1e300 1e-300 1e999 nan inf -inf 1_0 0x1 ١ 1e 9007199254740993 4294967296 16384 "
    + f"{'9' * 400} 0.{'0' * 400}1 1{'0' * 15}"
)
_ODD_NAMES = (
    "t.obj l.light a.ies s.hdr p.png case.scene none . .. / /dev/zero /etc ../x a\0b \udc80 \u202e %2e%2e/ T.OBJ C:\\t.obj "
    + f'p.png\\ ~ |ls \r # " {"x" * 300}'
)
NUMBERS = st.one_of(st.sampled_from(_ODD_NUMBERS.split()), st.integers(-4, 9).map(str), st.floats(width=32).map(repr))
NAMES = st.one_of(st.sampled_from(_ODD_NAMES.split(" ")), st.text(max_size=8))
WORDS = st.one_of(NUMBERS, NAMES)
ENDS = st.sampled_from(["\n", "\n", "\n", "\r\n", "\r", "\n\n", " # note\n", "\v", "\f", "\x1c", ""])
_FLAGS = "-o --size --eye --fov --frames --path --cache --buffers --stats --sky --allow --up-axis --help"
_GLTF = ("byteOffset", "byteStride", "sparse", "normalized", "extensions", "targets", "weights")  # keys of few objects
_OBJ = "v X Y Z;vn X Y Z;vt U V;f A B C;f A;o NAME;usemtl NAME;s N;mtllib FILE;g NAME"
_USAGES = {  # by reader: its lines, separated by `;`
    "scene": ";".join(
        (*scene_text.USAGE.values(), "brdf diffuse R G B A", "sky R G B", "sky cie clear sun A B", "sky FILE gain G")
    ),
    "light": ";".join(light_text.USAGE.values()),
    "obj": _OBJ,
    "obj-strict": _OBJ,
    "mtl": "newmtl NAME;Kd R G B;Ke R G B;d X;Tr X;illum N;Tf R G B;map_Kd FILE;map_d FILE;norm -bm X FILE;map_Kd -s X Y FILE",
    "path": "frames N;cam X Y Z X Y Z X Y Z",
    "ies": "N;TILT=NONE;TILT=INCLUDE;TILT=FILE;N N N",
    "ply": "element vertex N;element face N;property float NAME;property list uchar int NAME;format ascii N",
    "stl": "vertex X Y Z;facet normal X Y Z;endloop",
    "hdr": "EXPOSURE=N;VIEW=N;FORMAT=NAME",
    "command-line": ";".join((_FLAGS.replace(" ", "\nN;"), *(setting.flag + "\nN" for setting in SETTINGS.values()))),
}
_PLACE = re.compile(r"\b(?:FILE(?:\.\w+)?|NAME|[A-Z]|[ETU][XYZ]|DEG)\b")  # placeholders for a name or a number in a line
_ODD: st.SearchStrategy[Any] = st.one_of(
    st.sampled_from(
        [None, True, -1, 0, 1, 2, 3, 5126, 5123, 2**31, 2**63, 10**400, 1e308, 1e15, 1e16, 0.5, [], {}, [[]], [0] * 16]
    ),
    st.sampled_from(
        ["", "VEC3", "SCALAR", "../../etc/passwd", "/dev/zero", "data:", "data:;base64,AAAA", "data:;base64,!!", "p.png"]
    ),
    st.sampled_from(["\0", "\ud800", "x" * 200]),
    st.integers(-3, 8),
    st.floats(),
    st.lists(st.floats(), max_size=5),
)
_PREFERENCES = {"version": 2, "size": [800, 600], "recent": ["cornell", "/x"]}


@st.composite
def _lines(draw: st.DrawFn, name: str) -> bytes:
    """Draw a seed of a reader with removed, added and damaged lines."""
    usages = _USAGES[name].split(";")
    lines = [line + b"\n" for line in draw(st.sampled_from(readers.seeds(name))).split(b"\n") if line]

    def odd() -> bytes:
        usage = draw(st.sampled_from(usages))
        text = _PLACE.sub(lambda found: draw(NAMES if found[0][:4] in ("FILE", "NAME") else NUMBERS), usage)
        more = draw(st.lists(WORDS, max_size=3)) if draw(st.integers(0, 3)) == 0 else []
        return (" ".join([text, *more]) + draw(ENDS)).encode("utf-8", "surrogatepass")

    for _ in range(draw(st.integers(0, 4))):
        place, what = draw(st.integers(0, len(lines))), draw(st.integers(0, 3))
        if what == 2 and place < len(lines):
            spoiled = lines[place].split(b" ")
            spoiled[draw(st.integers(0, len(spoiled) - 1))] = draw(WORDS).encode("utf-8", "surrogatepass")
            lines[place] = b" ".join(spoiled) + b"\n"
        else:
            lines[place : place + (what != 1)] = [] if what == 0 else [odd()]
    return b"".join(lines)


def _changed(draw: st.DrawFn, tree: Any, times: int) -> Any:
    """Draw a JSON tree with `times` changed, removed or added values."""
    tree = copy.deepcopy(tree)
    for _ in range(times):
        at: Any = tree
        key: Any = None
        while isinstance(at, (dict, list)) and at:
            above, keys = at, list(at) if isinstance(at, dict) else list(range(len(at)))
            key = draw(st.sampled_from(keys))
            at = at[key]
            if draw(st.integers(0, 5)) == 0:
                break
        if key is None:
            return tree
        what = draw(st.integers(0, 6))
        if what == 0:
            above.pop(key)
        elif what == 1 and isinstance(above, list):
            above.extend(copy.deepcopy(above) * draw(st.integers(1, 3)))
        else:
            if what == 2 and isinstance(above, dict):
                key = draw(st.sampled_from(_GLTF))
            above[key] = copy.deepcopy(draw(_ODD))
    return tree


@st.composite
def _json(draw: st.DrawFn, tree: Any, glb: bool = False) -> bytes:
    data = json.dumps(_changed(draw, tree, draw(st.integers(1, 5)))).encode()
    return readers.glb_bytes(data, draw(st.binary(max_size=40))) if glb else data


@st.composite
def _bytes_changed(draw: st.DrawFn, name: str) -> bytes:
    """Draw a seed with changed, removed or repeated bytes."""
    data = bytearray(draw(st.sampled_from(readers.seeds(name))))
    for _ in range(draw(st.integers(1, 6))):
        place, what, count = draw(st.integers(0, max(len(data) - 1, 0))), draw(st.integers(0, 3)), draw(st.integers(1, 40))
        if what == 0:
            data[place : place + 1] = bytes([draw(st.integers(0, 255))])
        elif what == 1:
            number = draw(st.sampled_from([0, 1, 2, 255, 65535, 10**6, 2**31 - 1, 2**31, 2**32 - 1]))
            data[place : place + 4] = struct.pack(draw(st.sampled_from("<>")) + "I", number)
        elif what == 2:
            del data[place : place + count]
        else:
            data[place:place] = data[place : place + count]
    return bytes(data)


@st.composite
def _cache(draw: st.DrawFn) -> bytes:
    arrays = dict(readers.cache_arrays())
    for name in draw(st.lists(st.sampled_from(sorted(arrays)), min_size=1, max_size=3, unique=True)):
        old, what = arrays[name], draw(st.integers(0, 3))
        if what == 0:
            arrays.pop(name)
        elif what == 1:
            arrays[name] = old.reshape(-1)[: draw(st.integers(0, 4))]
        elif what == 2:
            arrays[name] = np.zeros(old.shape, draw(st.sampled_from(["U9", "S3", "c8", "f2", "i1", "M8[s]", "?"])))
        elif name == "about":
            odd = draw(st.sampled_from(["", "[]", "{}", "[" * 9999, "NaN", '{"key": 3}', '{"key": {}, "about": []}']))
            changed = json.dumps(_changed(draw, json.loads(str(old)), draw(st.integers(1, 3))))
            arrays[name] = np.array(draw(st.sampled_from([odd, changed, changed])))
        elif old.dtype.kind in "fi":
            value = draw(st.sampled_from([0, -1, 2**30, 7])) if old.dtype.kind == "i" else draw(st.floats(width=32))
            arrays[name] = np.full(old.shape, value).astype(old.dtype)  # wraps on overflow
    return readers.npz(arrays)


def inputs(name: str) -> st.SearchStrategy[bytes]:
    """Return the inputs of a reader: structured ones, and seeds with changed bytes."""
    changed = _bytes_changed(name)
    if name in _USAGES:
        made = _lines(name)
    elif name in ("gltf", "glb"):
        made = _json(readers.gltf_tree(), name == "glb")
    elif name == "preferences":
        made = _json(_PREFERENCES)
    elif name == "cache":
        made = _cache()
    elif name == "settings":
        value = st.one_of(WORDS, st.sampled_from(["auto", "all", "on", "off", "None", "True"]))
        made = st.tuples(st.integers(0, len(SETTINGS) - 1), value).map(
            lambda it: f"{it[0]}={it[1]}".encode("utf-8", "surrogatepass")
        )
    else:
        return changed
    return st.one_of(made, made, changed)
