"""Inputs with the form of each format and odd content, by hypothesis: what blind changes of bytes seldom reach."""

from __future__ import annotations

import copy
import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st

from irrsplat.scene.io.lights import light_text
from irrsplat.scene.io.text import scene_text
from irrsplat.settings import SETTINGS
from tests.trust.fuzz import readers

_ODD_NUMBERS = (
    "0 1 -1 2 3 0.5 -0 90 180 1e15 1e16 -1e15 1e300 1e-300 1e999 nan inf -inf 1_0 0x1 ١ 1e 9007199254740993 4294967296 "
    + f"{'9' * 400} 0.{'0' * 400}1 1{'0' * 15}"
)
NUMBERS = st.one_of(
    st.sampled_from(_ODD_NUMBERS.split()),
    st.integers(-4, 9).map(str),
    st.floats(width=32).map(repr),
)
NAMES = st.one_of(
    st.sampled_from(
        ["t.obj", "l.light", "a.ies", "s.hdr", "p.png", "case.scene", "none", ".", "..", "/", "/dev/zero", "/etc/passwd", "../x"]
    ),
    st.sampled_from(
        ["a\0b", "\udc80", "x" * 300, "\u202e", "%2e%2e/", "T.OBJ", "C:\\t.obj", "p.png\\", "~", "|ls", "\r", "#", '"']
    ),
    st.text(max_size=8),
)
WORDS = st.one_of(NUMBERS, NAMES)
ENDS = st.sampled_from(["\n", "\n", "\n", "\r\n", "\r", "\n\n", " # note\n", "\v", "\f", "\x1c", ""])


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def _lines(name: str, usages: dict[str, str]) -> st.SearchStrategy[bytes]:
    """A seed of a reader with lines lost, added and spoiled: odd ones of known words."""

    wholes = [[one.decode() + "\n" for one in data.split(b"\n") if one] for data in readers.seeds(name)]

    def line(item: tuple[str, str]) -> st.SearchStrategy[str]:
        word, usage = item
        count = len(usage.split()) - 1
        kind = NAMES if "FILE" in usage or "NAME" in usage else NUMBERS
        fitting = st.lists(kind if count <= 1 else st.one_of(NUMBERS, NUMBERS, NUMBERS, WORDS), min_size=count, max_size=count)
        return st.tuples(st.one_of(fitting, fitting, fitting, st.lists(WORDS, max_size=12)), ENDS).map(
            lambda it: " ".join([word, *it[0]]) + it[1]
        )

    odd = st.sampled_from(sorted(usages.items())).flatmap(line)

    @st.composite
    def text(draw: st.DrawFn) -> bytes:
        lines = list(draw(st.sampled_from(wholes)))
        for _ in range(draw(st.integers(0, 4))):
            place, what = draw(st.integers(0, len(lines))), draw(st.integers(0, 3))
            if what == 0:
                lines[place:] = lines[place + 1 :]
            elif what == 1:
                lines.insert(place, draw(odd))
            elif what == 2 and place < len(lines):
                words = lines[place].split(" ")
                words[draw(st.integers(0, len(words) - 1))] = draw(WORDS)
                lines[place] = " ".join(words) + "\n"
            else:
                lines[place : place + 1] = [draw(odd)]
        return _encoded("".join(lines))

    return text()


_SCENE = {**scene_text.USAGE, "brdf diffuse": "brdf R G B A", "brdf emission": "emission R G B", "sky cie clear": "sky sun A B"}
_OBJ = {
    "v": "v X Y Z", "vn": "vn X Y Z", "vt": "vt U V", "f": "f A B C", "f 1 2": "f A", "o": "o NAME", "usemtl": "usemtl NAME",
    "s": "s N",
    "mtllib": "mtllib FILE", "g": "g NAME", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1/1": "f A B",
}  # fmt: skip
_MTL = {
    "newmtl": "newmtl NAME", "Kd": "Kd R G B", "Ke": "Ke R G B", "d": "d X", "Tr": "Tr X", "illum": "illum N",
    "Tf": "Tf R G B", "Ks": "Ks R G B",
    "map_Kd": "map_Kd FILE", "map_d": "map_d FILE", "map_Ke": "map_Ke FILE", "norm -bm": "norm X FILE",
    "map_Kd -s": "map_Kd X Y FILE",
}  # fmt: skip
_PATH = {
    "frames": "frames N", "cam": "cam X Y Z X Y Z X Y Z", "mesh": "mesh NAME N X Y Z", "mesh 0 1": "mesh X Y Z D X Y Z",
    "light 0 1 color": "light R G B", "light 0 2 position": "light X Y Z", "mesh a 1": "mesh " + "X " * 12,
}  # fmt: skip
_ODD: st.SearchStrategy[Any] = st.one_of(
    st.sampled_from(
        [
            None,
            True,
            -1,
            0,
            1,
            2,
            3,
            5126,
            5123,
            2**31,
            2**63,
            10**400,
            1e308,
            1e15,
            1e16,
            0.5,
            [],
            {},
            "",
            "VEC3",
            "SCALAR",
            "VEC2",
        ]
    ),
    st.sampled_from(
        [
            "../../etc/passwd",
            "/dev/zero",
            "data:",
            "data:;base64,AAAA",
            "data:;base64,!!",
            "p.png",
            "\0",
            "\ud800",
            "x" * 200,
            [[]],
            [0] * 16,
        ]
    ),
    st.integers(-3, 8),
    st.floats(),
    st.lists(st.floats(), max_size=5),
)


def _changed(draw: st.DrawFn, tree: Any, times: int) -> Any:
    """A tree of JSON with other values, lost ones, and ones too many, at so many places."""
    tree = copy.deepcopy(tree)
    for _ in range(times):
        at, key = tree, None
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
        elif what == 2 and isinstance(above, dict):
            above[
                draw(st.sampled_from(["byteOffset", "byteStride", "sparse", "normalized", "extensions", "targets", "weights"]))
            ] = copy.deepcopy(draw(_ODD))
        else:
            above[key] = copy.deepcopy(draw(_ODD))
    return tree


def _dumped(tree: Any) -> bytes:
    return json.dumps(tree).encode()


@st.composite
def _gltf(draw: st.DrawFn) -> bytes:
    return _dumped(_changed(draw, readers.gltf_tree(), draw(st.integers(1, 5))))


@st.composite
def _glb(draw: st.DrawFn) -> bytes:
    chunk = draw(st.binary(max_size=40))
    data = readers.glb_bytes(_dumped(_changed(draw, readers.gltf_tree(), draw(st.integers(0, 3)))), chunk)
    if draw(st.booleans()):
        place = draw(st.integers(0, 24))
        data = data[:place] + struct.pack("<I", draw(st.sampled_from([0, 1, 2, 255, 2**31, 2**32 - 1]))) + data[place + 4 :]
    return data


@st.composite
def _ply(draw: st.DrawFn) -> bytes:
    kinds = ["char", "uchar", "short", "ushort", "int", "uint", "float", "double", "int8", "float32", "list", "string"]
    form = draw(st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian", "x"]))
    head = f"ply\nformat {form} 1.0\n"
    for name in draw(st.lists(st.sampled_from(["vertex", "face", "tristrips", "edge"]), min_size=1, max_size=3)):
        head += f"element {name} {draw(st.sampled_from(['0', '1', '3', '4', '-1', '1000000000', '9' * 30, 'x']))}\n"
        for one in draw(
            st.lists(
                st.sampled_from(
                    ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "u", "v", "vertex_indices", "texcoord"]
                ),
                max_size=7,
            )
        ):
            if one in ("vertex_indices", "texcoord"):
                head += f"property list {draw(st.sampled_from(kinds))} {draw(st.sampled_from(kinds))} {one}\n"
            else:
                head += f"property {draw(st.sampled_from(kinds))} {one}\n"
    if draw(st.booleans()):
        head += f"comment TextureFile {draw(NAMES)}\n"
    body = draw(st.one_of(st.binary(max_size=200), st.lists(NUMBERS, max_size=40).map(lambda it: _encoded(" ".join(it)))))
    return _encoded(head + "end_header\n") + body


@st.composite
def _stl(draw: st.DrawFn) -> bytes:
    if draw(st.booleans()):
        text = "solid " + draw(NAMES) + "\n"
        for _ in range(draw(st.integers(0, 3))):
            text += "facet normal 0 0 1\nouter loop\n"
            for _ in range(draw(st.sampled_from([3, 3, 3, 2, 4]))):
                text += "vertex " + " ".join(draw(st.lists(NUMBERS, min_size=3, max_size=3))) + "\n"
            text += "endloop\nendfacet\n"
        return _encoded(text + draw(st.sampled_from(["endsolid\n", "", "end"])))
    count = draw(st.integers(0, 3))
    data = np.array(draw(st.lists(st.floats(width=32), min_size=12 * count, max_size=12 * count)), "<f4")
    rows = b"".join(row.tobytes() + draw(st.sampled_from([b"\0\0", b"\0\x80"])) for row in data.reshape(-1, 12))
    said = draw(st.sampled_from([count, count, count, 0, 2**32 - 1, 10**6]))
    return bytes(80) + struct.pack("<I", said) + rows


@st.composite
def _ies(draw: st.DrawFn) -> bytes:
    tilt = draw(st.sampled_from(["NONE", "INCLUDE\n1\n2\n0 90\n1 1", "INCLUDE", "a.ies", "", "/dev/zero", "INCLUDE\n1 99999 0"]))
    vertical, horizontal = draw(st.integers(0, 4)), draw(st.integers(0, 4))
    numbers = [
        "1",
        "1000",
        draw(NUMBERS),
        str(vertical),
        str(horizontal),
        draw(st.sampled_from("1230")),
        "2",
        "0",
        "0",
        "0",
        "1",
        "1",
        "50",
    ]
    numbers += sorted(
        draw(st.lists(st.sampled_from(["0", "45", "90", "180", "270", "360", "-90"]), min_size=vertical, max_size=vertical)),
        key=float,
    )
    numbers += sorted(
        draw(st.lists(st.sampled_from(["0", "45", "90", "180", "270", "360", "-90"]), min_size=horizontal, max_size=horizontal)),
        key=float,
    )
    numbers += draw(st.lists(NUMBERS, min_size=vertical * horizontal, max_size=vertical * horizontal + draw(st.integers(0, 1))))
    for _ in range(draw(st.integers(0, 2))):
        numbers[draw(st.integers(0, len(numbers) - 1))] = draw(WORDS)
    return _encoded(f"{draw(st.sampled_from(['IESNA:LM-63-2002', 'IESNA91', 'x']))}\nTILT={tilt}\n" + " ".join(numbers))


@st.composite
def _hdr(draw: st.DrawFn) -> bytes:
    head = draw(
        st.sampled_from(
            ["#?RADIANCE\n", "#?RGBE\nEXPOSURE=2\n", "#?RADIANCE\nEXPOSURE=1e999\nEXPOSURE=0\n", "#?RADIANCE\nEXPOSURE=...\n"]
        )
    )
    size = [draw(st.sampled_from([0, 1, 1, 2, 2, 3, 4, 4, 5, 8, 8, 9, 9, 12, 16384, 999999])) for _ in "yx"]
    signs = [draw(st.sampled_from("+-")) for _ in "yx"]
    rows = draw(
        st.one_of(
            st.binary(max_size=160), st.integers(0, 4).map(lambda n: bytes([2, 2, 0, 8, 136, 5, 136, 5, 136, 5, 136, 5]) * n)
        )
    )
    runs = draw(st.sampled_from([b"", bytes([1, 1, 1, 255]) * 6, bytes([9, 9, 9, 128]) + bytes([1, 1, 1, 200]) * 3]))
    return head.encode() + f"\n{signs[0]}Y {size[0]} {signs[1]}X {size[1]}\n".encode() + runs + rows


@st.composite
def _bytes_changed(draw: st.DrawFn, name: str) -> bytes:
    """A seed with some bytes changed, lost or doubled."""
    data = bytearray(draw(st.sampled_from(readers.seeds(name))))
    for _ in range(draw(st.integers(1, 6))):
        if not data:
            break
        place = draw(st.integers(0, len(data) - 1))
        what = draw(st.integers(0, 3))
        if what == 0:
            data[place] = draw(st.integers(0, 255))
        elif what == 1:
            data[place : place + 4] = struct.pack(
                draw(st.sampled_from("<>")) + "I", draw(st.sampled_from([0, 1, 65535, 2**31 - 1, 2**31, 2**32 - 1]))
            )
        elif what == 2:
            del data[place : place + draw(st.integers(1, 40))]
        else:
            data[place:place] = data[place : place + draw(st.integers(1, 40))]
    return bytes(data)


@st.composite
def _cache(draw: st.DrawFn) -> bytes:
    arrays = dict(readers.cache_arrays())
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(sorted(arrays)))
        what = draw(st.integers(0, 5))
        if what == 0:
            arrays.pop(name)
        elif what == 1:
            arrays[name] = arrays[name].reshape(-1)[: draw(st.integers(0, 4))]
        elif what == 2:
            arrays[name] = np.zeros(arrays[name].shape, draw(st.sampled_from(["U9", "S3", "c8", "f2", "i1", "M8[s]", "?"])))
        elif what == 3 and name == "about":
            about = json.loads(str(readers.cache_arrays()["about"]))
            arrays[name] = np.array(json.dumps(_changed(draw, about, draw(st.integers(1, 3)))))
        elif what == 4 and name == "about":
            arrays[name] = np.array(
                draw(st.sampled_from(["", "[]", "{}", "[" * 9999, "NaN", '{"key": 3}', '{"key": {}, "about": []}']))
            )
        elif arrays[name].dtype.kind in "fi":
            value = draw(st.sampled_from([0, -1, 2**30, 7])) if arrays[name].dtype.kind == "i" else draw(st.floats(width=32))
            arrays[name] = np.full(arrays[name].shape, value).astype(arrays[name].dtype)  # wraps where it is too much
        if name not in arrays or not len(arrays):
            break
    return readers.npz(arrays)


def _words() -> st.SearchStrategy[bytes]:
    flags = [setting.flag for setting in SETTINGS.values()]
    flags += [
        "-o",
        "--size",
        "--eye",
        "--target",
        "--up",
        "--fov",
        "--frames",
        "--path",
        "--cache",
        "--buffers",
        "--stats",
        "--sky",
        "--allow",
        "--time",
        "--up-axis",
        "--help",
        "--quick",
    ]
    word = st.one_of(st.sampled_from(flags), WORDS)
    command = st.sampled_from(["render", "view", "info", "measure", "bench", "verify", "doctor", "completion", "x"])
    return st.tuples(command, st.lists(word, max_size=8)).map(lambda it: _encoded("\n".join([it[0], *it[1]])))


_PREFERENCES = {
    "version": 1, "preset": "default", "values": {"a": 0.3, "bounces": "all"}, "size": [800, 600], "recent": ["cornell", "/x"],
    "scenes": {"cornell": [{"name": "a", "eye": [0, 0, 1], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 45}]},
    "panel": True, "speed": 1.5,
}  # fmt: skip


@st.composite
def _preferences(draw: st.DrawFn) -> bytes:
    return _dumped(_changed(draw, _PREFERENCES, draw(st.integers(1, 4))))


_SETTING = st.tuples(
    st.integers(0, len(SETTINGS) - 1), st.one_of(WORDS, st.sampled_from(["auto", "all", "on", "off", "None", "True"]))
).map(lambda it: _encoded(f"{it[0]}={it[1]}"))
_MADE: dict[str, Callable[[], st.SearchStrategy[bytes]]] = {
    "scene": lambda: _lines("scene", _SCENE),
    "light": lambda: _lines("light", light_text.USAGE),
    "obj": lambda: _lines("obj", _OBJ),
    "obj-strict": lambda: _lines("obj-strict", _OBJ),
    "mtl": lambda: _lines("mtl", _MTL),
    "gltf": _gltf,
    "glb": _glb,
    "ply": _ply,
    "stl": _stl,
    "path": lambda: _lines("path", _PATH),
    "ies": _ies,
    "hdr": _hdr,
    "cache": _cache,
    "settings": lambda: _SETTING,
    "preferences": _preferences,
    "command-line": _words,
}


def inputs(name: str) -> st.SearchStrategy[bytes]:
    """Inputs for a reader: of the format's structure, and seeds with changed bytes."""
    changed = _bytes_changed(name)
    made = _MADE.get(name)
    return changed if made is None else st.one_of(made(), made(), changed)
