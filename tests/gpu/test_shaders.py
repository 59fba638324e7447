"""Shader text and programs: includes once, errors by file and line, uniforms as a call's signature."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import moderngl
import pytest

from irrsplat.core import paths
from irrsplat.gpu import program, shader_source
from irrsplat.gpu.program import Program
from irrsplat.gpu.shader_source import ShaderError
from irrsplat.gpu.target import Target, float_texture

MAIN = '#include "lib/a.glsl"\n#include "lib/b.glsl"\nout vec4 color;\nvoid main() { color = vec4(a() + b()); }\n'
A = "float a() { return 1.0; }\n"
B = '// b needs a\n#include "lib/a.glsl"\nfloat b() { return a(); }\n'


@pytest.fixture
def bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The bundled shaders are those of a folder of the test's own, with the vertex shader that fills the target."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "fullscreen.vert").write_text((paths.folder("shaders") / "lib" / "fullscreen.vert").read_text())
    monkeypatch.setattr(shader_source, "folder", lambda name: tmp_path)
    return tmp_path


@pytest.fixture
def root(bundle: Path) -> Path:
    """The folder of `bundle` with main.frag, which includes a and b. b includes a as well."""
    for name, text in {"main.frag": MAIN, "lib/a.glsl": A, "lib/b.glsl": B}.items():
        (bundle / name).write_text(text)
    return bundle


def test_a_file_is_included_once(root: Path) -> None:
    text = shader_source.load("main.frag").text
    assert text.count("float a()") == 1 and text.count("float b()") == 1
    assert text.index("float a()") < text.index("float b()") < text.index("void main")
    assert text.startswith("#version 330"), "and nothing stands before the version"


def compiler_s_place(source: shader_source.Source, part: str) -> tuple[int, int]:
    """The source number and line that a compiler gives to the line of `source.text` that contains `part`."""
    for line, text in enumerate(source.text.splitlines(), start=1):
        if part in text:
            return 0, line
    raise AssertionError(f"no line contains {part!r}")


def test_a_missing_file_is_named_with_who_asked_for_it(root: Path) -> None:
    (root / "lib" / "b.glsl").write_text('\n\n#include "lib/nowhere.glsl"\n')
    with pytest.raises(ShaderError, match=r"^lib/b\.glsl:3: .*lib/nowhere\.glsl"):
        shader_source.load("main.frag")
    with pytest.raises(ShaderError, match="absent"):
        shader_source.load("absent.frag")


def test_uniforms_are_read_from_the_text(root: Path) -> None:
    (root / "main.frag").write_text(
        '#include "lib/a.glsl"\n'
        "uniform float x;  // metres\n"
        "// uniform float commented;\n"
        "/* uniform vec2\n uniform float gone; */\n"
        "uniform vec4 rows[8 * 2];\n"
        "  uniform sampler2D picture ;\n"
        "#if EXTRA\nuniform vec3 extra;\n#else\nuniform vec2 plain;\n#endif\n"
        "#if EXTRA\n#if DEEP\nuniform int deep;\n#endif\n#endif\n"
        "#ifdef OTHER\nuniform int other;\n#endif\n"
        "void main() {}\n"
    )
    with_extra = shader_source.load("main.frag", {"EXTRA": 1, "DEEP": 0}).uniforms
    assert with_extra == {"x": "float", "rows": "vec4", "picture": "sampler2D", "extra": "vec3", "other": "int"}
    without = shader_source.load("main.frag", {"EXTRA": 0, "DEEP": 1}).uniforms
    assert without == {"x": "float", "rows": "vec4", "picture": "sampler2D", "plain": "vec2", "other": "int"}


@pytest.mark.parametrize(
    "log",
    [
        "{number}:{line}(3): error: `foo' undeclared",  # Mesa
        "0:{line}(3): error: `foo' undeclared",  # Mesa, once the text is parsed: it forgets the number then
        "{number}({line}) : error C1008: undefined variable foo",  # NVIDIA
        "ERROR: {number}:{line}: 'foo' : undeclared identifier",  # Apple, Intel
    ],
)
@pytest.mark.parametrize(
    ("part", "place"), [("float a()", "lib/a.glsl:1: "), ("float b()", "lib/b.glsl:3: "), ("void main", "main.frag:4: ")]
)
def test_every_compiler_s_complaint_is_one_line_with_its_place(root: Path, log: str, part: str, place: str) -> None:
    source = shader_source.load("main.frag")
    number, line = compiler_s_place(source, part)
    message = shader_source.explain(
        f"GLSL Compiler failed\n\nfragment_shader\n=====\n{log.format(number=number, line=line)}\n", source
    )
    assert message.startswith(place) and "\n" not in message and "foo" in message


@pytest.mark.parametrize("where", ["own", "included", "after"])
def test_a_broken_shader_names_file_and_line(ctx: moderngl.Context, bundle: Path, where: str) -> None:
    wrong = "float x = nowhere;\n"
    (bundle / "lib" / "part.glsl").write_text("// one\n// two\n" + (wrong if where == "included" else ""))
    (bundle / "broken.frag").write_text(
        (wrong if where == "own" else "// first\n")
        + '#include "lib/part.glsl"\n'
        + (wrong if where == "after" else "// third\n")
        + "out vec4 color;\nvoid main() { color = vec4(1.0); }\n"
    )
    place = {"own": "broken.frag:1: ", "included": "lib/part.glsl:3: ", "after": "broken.frag:3: "}[where]
    with pytest.raises(ShaderError) as error:
        _ = Program(ctx, "broken", "lib/fullscreen").gl
    assert str(error.value).startswith(place) and "nowhere" in str(error.value) and "\n" not in str(error.value)
    ctx.clear_errors()


def test_a_broken_vertex_shader_is_not_blamed_on_the_fragment_shader(ctx: moderngl.Context, bundle: Path) -> None:
    (bundle / "v.vert").write_text("// one\nvoid main() { gl_Position = vec4(nowhere); }\n")
    (bundle / "v.frag").write_text("out vec4 color;\nvoid main() { color = vec4(1.0); }\n")
    with pytest.raises(ShaderError, match=r"^v\.vert:2: "):
        _ = Program(ctx, "v").gl
    ctx.clear_errors()


@pytest.fixture
def tint(ctx: moderngl.Context, bundle: Path) -> Program:
    """color = scale·tint + picture; `unused` is declared, and the compiler removes it."""
    (bundle / "tint.frag").write_text(
        "uniform vec3 tint;\nuniform float scale;\nuniform float unused;\nuniform sampler2D picture;\n"
        "#if EXTRA\nuniform float extra;\n#endif\nout vec4 color;\n"
        "void main() { color = vec4(scale * tint, 0.0) + texelFetch(picture, ivec2(0), 0); }\n"
    )
    return Program(ctx, "tint", "lib/fullscreen", {"EXTRA": 0})


def test_missing_and_unknown_uniforms_are_named(ctx: moderngl.Context, tint: Program) -> None:
    target, picture = Target(ctx, (2, 2), (4,)), float_texture(ctx, (1, 1))
    with pytest.raises(TypeError, match=r"'tint'.*missing.*\['scale', 'unused'\].*unknown.*\['scael'\]"):
        tint(target, tint=(1.0, 2.0, 3.0), scael=0.5, picture=picture)
    with pytest.raises(TypeError, match="extra"):
        tint(target, tint=(1.0, 2.0, 3.0), scale=0.5, unused=0.0, picture=picture, extra=1.0)


def test_one_draw_s_state_is_not_the_next_one_s(ctx: moderngl.Context, tint: Program) -> None:
    """After a blended, scissored, clamped draw a plain one fills the whole target and adds nothing to the old content."""
    target, picture = Target(ctx, (4, 4), (4,)), float_texture(ctx, (1, 1))
    picture.write(b"\0" * 16)
    target.clear(1.0)
    values: dict[str, Any] = {"tint": (1.0, 1.0, 1.0), "scale": 1.0, "unused": 0.0, "picture": picture}
    state = program.DrawState(blend="add", depth_clamp=True)
    tint(target, state=state, scissor=(0, 0, 2, 2), viewport=(0, 0, 4, 4), **values)
    assert target.read()[..., 0].sum() == 16 + 4, "it added within the scissor"
    tint(target, **values)
    assert (target.read()[..., :3] == 1.0).all()


def test_the_whole_bundle_is_read() -> None:
    """Every file of the bundled shaders is a stage's own, or included by one: none lies there unused."""
    folder = paths.folder("shaders")
    stages = [str(path.relative_to(folder)) for path in folder.rglob("*") if path.suffix in (".vert", ".frag")]
    texts = (path.read_text() for path in folder.rglob("*") if path.suffix in (".glsl", ".vert", ".frag"))
    switches = {name: 1 for text in texts for line in re.findall("#if (.*)", text) for name in re.findall("[A-Z_]+", line)}
    used = {file for stage in stages for on in ({}, switches) for file, _ in shader_source.load(stage, on).places}
    present = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.suffix in (".glsl", ".vert", ".frag")}
    assert present - used <= {"lib/fullscreen.vert"}
