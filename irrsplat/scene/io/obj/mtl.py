"""Reader of the diffuse part of `.mtl` files: colours, emission, opacity and their textures."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from irrsplat.core.color import LUMINANCE, clip_color
from irrsplat.core.errors import InputError
from irrsplat.core.paths import MOST_IMAGE, read_bytes
from irrsplat.core.words import number, quote
from irrsplat.scene.io.images import find_file, read_images
from irrsplat.scene.io.lines import text_bytes
from irrsplat.scene.io.obj.text import decoded
from irrsplat.scene.model import AlphaMode, Image, Material, Texture, Wrap

_VALUES = {"kd": 3, "ke": 3, "ks": 3, "tf": 3, "d": 1, "tr": 1, "illum": 1}  # number of values of each
_MAPS = {"map_kd": "map_kd", "map_ke": "map_ke", "map_d": "map_d", "norm": "norm", "map_kn": "norm"}
_HEIGHT_MAPS = ("bump", "map_bump", "disp")
_OPTIONS = {  # of a texture, with their greatest number of arguments; those of -o, -s and -t are numbers, one to three
    **dict.fromkeys(("-o", "-s", "-t"), 3),
    **dict.fromkeys(("-blendu", "-blendv", "-bm", "-boost", "-cc", "-clamp", "-colorspace", "-imfchan", "-texres", "-type"), 1),
    "-mm": 2,
}
_GLASS = (4, 6, 7, 9)  # illumination models with transmission, and with mirror reflection
_MIRROR = (3, 5, 8)


@dataclass(frozen=True)
class _Map:
    """A texture in an .mtl: file and options."""

    file: str
    options: dict[str, list[str]]

    def numbers(self, option: str, default: float) -> list[float]:
        """Return the three values of -o or -s."""
        given = [_finite(word, default) for word in self.options.get(option, [])]
        return (given + [default] * 3)[:3]

    def texture(self, image: Image) -> Texture:
        """Return the texture of `image` with these options: (u, v), v upward, maps to -s·(u, v) + -o."""
        su, sv, _ = self.numbers("-s", 1.0)
        ou, ov, _ = self.numbers("-o", 0.0)
        wrap: Wrap = "clamp" if self.options.get("-clamp") == ["on"] else "repeat"
        return Texture(image, 0, (su, 0.0, ou, 0.0, sv, 1.0 - sv - ov), (wrap, wrap))


@dataclass
class _Entry:
    """Values and textures of one material."""

    values: dict[str, tuple[float, ...]] = field(default_factory=dict)
    maps: dict[str, _Map] = field(default_factory=dict)


@dataclass
class MaterialFiles:
    """Materials of `.mtl` files; each file and image is read once.

    notices: one line each. files: all files read.
    """

    notices: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    _images: dict[Path, Image | InputError] = field(default_factory=dict)
    _cut: dict[tuple[Image | None, Image, str], tuple[Image | None, AlphaMode]] = field(default_factory=dict)

    def read(self, path: Path, used: Iterable[str] | None = None) -> dict[str, Material]:
        """Return the materials in the file at `path`, by name; surfaces are double-sided.

        used: the names of used materials (None: all); the others are plain, and their images are not read.

        Kd (clipped to 0..1) times map_Kd; Ke times map_Ke; `norm`; d or Tr, times map_d or map_Kd's alpha, unless that hides a
        picture. An alpha with hardly any values between 0 and 1 is a mask. Kd or Ke 0 0 0 with a map counts as 1 1 1, as in most
        programs. Glass (by its illum, and with Kd 0 0 0) transmits Tf; a mirror or metal with Kd 0 0 0 reflects Ks. Invalid lines
        and images are left out with a notice. Raises InputError for an invalid file.
        """
        self.files.append(path)
        entries = self._entries(path)
        invisible = [entry for entry in entries.values() if _opacity(entry) == 0.0]
        if invisible and len(invisible) == len(entries):  # some exporters write d 0, or Tr 1, for opaque materials
            for entry in invisible:
                entry.values["d"] = (1.0,)
            self.notices.append(f"{path}: every material is fully transparent; all are drawn opaque")
        missing: list[str] = []
        found = dict.fromkeys(entries, Material())
        if used is not None:
            requested = {name.casefold() for word in used for name in (word, name_without_comment(word))}
            names = [name for name in entries if {name.casefold(), name_without_comment(name).casefold()} & requested]
            entries = {name: entries[name] for name in names}
        images = self._read_images(path.parent, entries.values())
        found |= {name: self._material(entry, images, missing) for name, entry in entries.items()}
        found = {name_without_comment(name): material for name, material in found.items()} | found
        missing = list(dict.fromkeys(missing))
        if missing:
            more = f" and {len(missing) - 1} more" * (len(missing) > 1)
            self.notices.append(f"{path}: {missing[0]}{more}; the colours are shown without it")
        return found

    def _entries(self, path: Path) -> dict[str, _Entry]:
        found: dict[str, _Entry] = {}
        current = _Entry()
        bad: list[tuple[int, str]] = []
        heights = 0
        for i, line in enumerate(text_bytes(path, strict=False).split(b"\n"), 1):
            words = decoded(line).split(None, 1)
            if not words or words[0].startswith("#"):
                continue
            key, rest = words[0].lower(), words[1].strip() if len(words) > 1 else ""
            try:
                if key == "newmtl":
                    current = found.setdefault(" ".join(rest.split()), _Entry())
                elif key in _VALUES:
                    current.values[key] = _numbers(rest, _VALUES[key])
                elif key in _MAPS:
                    current.maps[_MAPS[key]] = _map(rest)
                elif key in _HEIGHT_MAPS:
                    heights += 1
            except ValueError as error:
                bad.append((i, f"{words[0]}: {error}"))
        if bad:
            count = f"; {len(bad)} such lines are left out" if len(bad) > 1 else "; the line is left out"
            self.notices.append(f"{path}:{bad[0][0]}: {bad[0][1]}{count}")
        if heights:
            self.notices.append(f"{path}: {heights} height map{'s' * (heights > 1)} (bump, disp) not shown; norm would be")
        return found

    def _material(self, entry: _Entry, images: Mapping[str, Image | str], missing: list[str]) -> Material:
        """Return the material; append to `missing` why an image is missing. images: by written name, or the reason."""
        found = {key: images[one.file] for key, one in entry.maps.items()}
        missing += [reason for reason in found.values() if isinstance(reason, str)]
        textures = {key: entry.maps[key].texture(image) for key, image in found.items() if isinstance(image, Image)}
        color = textures.get("map_kd")
        albedo = entry.values.get("kd", (1.0,) * 3 if color else (0.5,) * 3)
        emission = tuple(max(value, 0.0) for value in entry.values.get("ke", (0.0,) * 3))
        transmission, illum = 0.0, entry.values.get("illum", (2.0,))[0]
        if not any(albedo):
            filtered, mirrored = entry.values.get("tf", (1.0,) * 3), entry.values.get("ks", (0.0,) * 3)
            if color:
                albedo = (1.0,) * 3
            elif "map_kd" in entry.maps:
                albedo = (0.5,) * 3
            elif illum in _GLASS and any(filtered):
                albedo, transmission = filtered, 1.0
            elif illum in _MIRROR:
                albedo = mirrored
        if not any(emission) and "map_ke" in textures:
            emission = (1.0,) * 3
        opacity = _opacity(entry)
        mode: AlphaMode = "opaque"
        cut = textures.get("map_d")
        if cut is not None and (color is None or cut.image is not color.image):
            color, mode = self._with_alpha(color, cut, entry.maps["map_d"].options.get("-imfchan", [""])[-1])
        elif color is not None and (cut is not None or not _alpha_is_no_opacity(color.image.pixels)):
            mode = _mode(color.image.pixels[..., 3])
        if opacity < 1.0:
            mode = "blend"
        bend = entry.maps["norm"].options.get("-bm", ["1"])[-1] if "norm" in textures else "1"
        return Material(
            clip_color(albedo),
            (emission[0], emission[1], emission[2]),
            color,
            textures.get("map_ke"),
            textures.get("norm"),
            _finite(bend, 1.0),
            opacity,
            mode,
            transmission=transmission,
        )

    def _read_images(self, folder: Path, entries: Iterable[_Entry]) -> dict[str, Image | str]:
        """Return the images of these materials by written name, decoded in parallel; the reason for a missing one."""
        names = dict.fromkeys(one.file for entry in entries for one in entry.maps.values())
        files = {name: find_file(folder, name) for name in names}
        for name in [name for name, file in files.items() if file is None and name_without_comment(name) != name]:
            files[name] = find_file(folder, name_without_comment(name))
        encoded: dict[Path, tuple[bytes, str]] = {}
        for file in files.values():
            if file is not None and file not in self._images and file not in encoded:
                self.files.append(file)
                try:
                    encoded[file] = read_bytes(file, MOST_IMAGE), file.name
                except InputError as error:
                    self._images[file] = error
        self._images |= zip(encoded, read_images(list(encoded.values())), strict=True)
        found = {name: f"there is no image {quote(name)}" if file is None else self._images[file] for name, file in files.items()}
        return {name: one if isinstance(one, Image) else str(one) for name, one in found.items()}

    def _with_alpha(self, color: Texture | None, cut: Texture, channel: str) -> tuple[Texture | None, AlphaMode]:
        """Return the texture (None: white) with the alpha of another one, `cut`, and the mode of that alpha."""
        image = color.image if color else None
        key = image, cut.image, channel
        if key not in self._cut:
            alpha = _alpha_channel(cut.image.pixels, channel)
            mode = _mode(alpha)
            self._cut[key] = None if mode == "opaque" else _image_with_alpha(image, alpha, cut.image.name), mode
        combined, mode = self._cut[key]
        place = color or cut
        return color if combined is None else Texture(combined, 0, place.transform, place.wrap), mode


def find_libraries(folder: Path, written: str) -> Iterator[tuple[str, Path | None]]:
    """Yield the files of an `mtllib` line, one name with blanks or several, with None for missing files."""
    for name in dict.fromkeys((written, written.replace("\\ ", " "), name_without_comment(written))):
        whole = find_file(folder, name)
        if whole is not None:
            yield name, whole
            return
    text = name_without_comment(written)
    ends = [0, *(found.end() for found in re.finditer(r"\.mtl(?=\s|$)", text, re.IGNORECASE))]
    for name in (*(text[a:b].strip() for a, b in itertools.pairwise(ends)), *text[ends[-1] :].split()):
        yield name, find_file(folder, name)


def name_without_comment(name: str) -> str:
    """Return a name up to a # after a blank; names may contain this, so look up the whole name first."""
    return re.split(r"\s#", name, maxsplit=1)[0].rstrip()


def _numbers(text: str, count: int) -> tuple[float, ...]:
    """Return the numbers at the start of a line; one applies to three. Raise ValueError for other counts."""
    words = text.split("#")[0].split()
    if count == 1 and words[:1] == ["-halo"]:
        words = words[1:]
    values = tuple(number(word) for word in words[:count])
    if len(values) == 1:
        return values * count
    if len(values) < count:
        raise ValueError(f"{len(values)} values; expected {count}")
    return values


def _map(text: str) -> _Map:
    """Return a texture's options and file; raise ValueError without a file."""
    options: dict[str, list[str]] = {}
    rest = text
    while True:
        word, _, behind = rest.partition(" ")
        most = _OPTIONS.get(word.lower())
        if most is None:
            break
        rest = behind.lstrip()
        args: list[str] = []
        while len(args) < most:
            arg, _, behind = rest.partition(" ")
            if most > 1 and not re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", arg):
                break
            args.append(arg.lower())
            rest = behind.lstrip()
        options[word.lower()] = args
    if not rest:
        raise ValueError("no file is named")
    return _Map(rest, options)


def _finite(word: str, default: float) -> float:
    try:
        return number(word)
    except ValueError:
        return default


def _opacity(entry: _Entry) -> float:
    value = entry.values["d"][0] if "d" in entry.values else 1.0 - entry.values.get("tr", (0.0,))[0]
    return min(max(value, 0.0), 1.0)


def _mode(alpha: np.ndarray) -> AlphaMode:
    """Return the mode of an alpha channel (H, W) uint8: a mask with hardly any intermediate values; all 0 means unused."""
    count = np.bincount(alpha.reshape(-1), minlength=256)
    absent, present = int(count[:16].sum()), int(count[240:].sum())
    between = alpha.size - absent - present
    if present == alpha.size or absent == alpha.size:
        return "opaque"
    return "mask" if between <= min(0.1 * alpha.size, absent) else "blend"


def _alpha_is_no_opacity(pixels: np.ndarray) -> bool:
    """True if colours (H, W, 4) vary where alpha is 0 as elsewhere; such an alpha is not an opacity, but gloss for example."""
    some = pixels[:: max(1, len(pixels) // 512)]
    change = np.abs(np.diff(some[..., :3].astype(float).sum(2), axis=1))
    alpha = some[..., 3]
    absent = (alpha[:, 1:] < 16) & (alpha[:, :-1] < 16)
    present = (alpha[:, 1:] >= 240) & (alpha[:, :-1] >= 240)
    if not (absent.any() and present.any()):
        return False
    return bool(change[absent].mean() > max(0.5 * change[present].mean(), 1.0))


def _alpha_channel(pixels: np.ndarray, channel: str) -> np.ndarray:
    """Return (H, W) uint8: the channel of -imfchan, else the alpha unless it is constant, else the luminance."""
    if channel in ("r", "g", "b", "m"):
        return np.asarray(pixels[..., "rgbm".index(channel)])
    if channel != "l" and pixels[..., 3].min() < 255:
        return np.asarray(pixels[..., 3])
    return np.asarray(np.rint(pixels[..., :3] @ LUMINANCE), np.uint8)


def _image_with_alpha(image: Image | None, alpha: np.ndarray, name: str) -> Image:
    """Return the image (None: white) with another alpha; both at the larger of their sizes."""
    import PIL.Image

    height, width = alpha.shape
    rgb = np.full((height, width, 3), 255, np.uint8) if image is None else image.pixels[..., :3]
    height, width = max(height, rgb.shape[0]), max(width, rgb.shape[1])
    planes = [
        np.asarray(PIL.Image.fromarray(np.ascontiguousarray(plane)).resize((width, height), PIL.Image.Resampling.BILINEAR))
        for plane in (rgb, alpha)
    ]
    return Image(np.dstack(planes), name if image is None else image.name)
