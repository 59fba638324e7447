"""The interface: what imgui draws stands where and as it should, what the user does arrives, and nothing stays behind."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any

import moderngl
import numpy as np
import pytest
from imgui_bundle import imgui
from moderngl_window.context.glfw.keys import Keys as KEYS
from moderngl_window.context.headless.keys import Keys as HEADLESS_KEYS

from irrsplat.app.viewer.ui import imgui_backend as module
from irrsplat.app.viewer.ui.imgui_backend import ImguiBackend

SIZE = (240, 160)
CLEAR = (0.0, 0.0, 0.0, 0.0)
BARE = imgui.WindowFlags_.no_decoration | imgui.WindowFlags_.no_saved_settings


class Screen:
    """An ImguiBackend and its target; `frame` runs one frame and returns the picture (H, W, 4) uint8, top row first."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int], density: float, scale: float) -> None:
        self.size, self.pixels = size, (round(size[0] * density), round(size[1] * density))
        self.texture = ctx.texture(self.pixels, 4)
        self.target = ctx.framebuffer([self.texture])
        self.backend = ImguiBackend(ctx, scale)
        self.released = False

    def frame(self, content: Callable[[], Any] = lambda: None, clear: tuple[float, float, float, float] = CLEAR) -> np.ndarray:
        self.backend.begin(self.size, self.pixels, 1 / 60)
        self.result = content()
        self.target.clear(color=clear)
        self.backend.draw(self.target)
        return np.frombuffer(self.target.read(components=4), "u1").reshape(self.pixels[1], self.pixels[0], 4)[::-1]

    def release(self) -> None:
        if not self.released:
            self.backend.release()
        self.released = True
        self.target.ctx.detect_framebuffer(0).use()  # moderngl would go on to bind a framebuffer that is gone
        self.target.release()
        self.texture.release()


@pytest.fixture
def screen(ctx: moderngl.Context) -> Iterator[Callable[..., Screen]]:
    """Makes screens, and releases them in the end."""
    made: list[Screen] = []

    def make(size: tuple[int, int] = SIZE, density: float = 1.0, scale: float = 1.0) -> Screen:
        made.append(Screen(ctx, size, density, scale))
        return made[-1]

    yield make
    for one in made:
        one.release()


def window(content: Callable[[], Any]) -> Callable[[], Any]:
    """A frame's content: a bare window that covers columns 40 to 190 and rows 30 to 130."""

    def show() -> Any:
        imgui.set_next_window_pos((40, 30))
        imgui.set_next_window_size((150, 100))
        imgui.begin("a", None, BARE)
        result = content()
        imgui.end()
        return result

    return show


def text(line: str) -> Callable[[], Any]:
    return window(lambda: imgui.text_unformatted(line))


def rect(content: Callable[[], Any]) -> Callable[[], tuple[Any, tuple[float, float]]]:
    """`content` and the middle of its widget, window coordinates."""

    def show() -> tuple[Any, tuple[float, float]]:
        result = content()
        low, high = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        return result, ((low.x + high.x) / 2, (low.y + high.y) / 2)

    return window(show)


def letters(picture: np.ndarray) -> np.ndarray:
    """Where text lies: the theme's windows are dark, their text is bright."""
    return picture[..., :3].min(-1) > 128


def test_a_window_covers_its_place_and_nothing_else(screen: Callable[..., Screen]) -> None:
    one = screen()
    one.frame(text("irradiance"))
    picture = one.frame(text("irradiance"), clear=(0.0, 0.0, 1.0, 1.0))
    inside = np.zeros(SIZE[::-1], bool)
    inside[30:130, 40:190] = True
    assert (picture[~inside] == (0, 0, 255, 255)).all()
    inner = picture[36:124, 46:184]  # without rounded corners and border
    assert (inner[..., 2] < 255).all()
    rows, columns = np.nonzero(letters(picture))
    assert len(rows) > 50 and rows.min() >= 30 and rows.max() < 60 and columns.max() < 130  # one line, at the top left


@pytest.mark.parametrize("density", [1.0, 1.5, 2.0])
def test_a_window_is_clipped_to_its_place_in_pixels(screen: Callable[..., Screen], density: float) -> None:
    """A rectangle far larger than the window fills the pixels whose centres lie in its clip rectangle (window coordinates)."""
    one = screen(density=density)
    left, top, right, bottom = 50.7, 40.4, 89.8, 59.3

    def flood() -> Any:
        draw = imgui.get_window_draw_list()
        draw.push_clip_rect((left, top), (right, bottom))
        draw.add_rect_filled((-999, -999), (999, 999), 0xFF00FF00)
        draw.pop_clip_rect()

    one.frame(window(flood))
    green = (one.frame(window(flood))[..., :3] == (0, 255, 0)).all(-1)
    y, x = (np.indices(green.shape) + 0.5) / density
    assert np.array_equal(green, (left <= x) & (x < right) & (top <= y) & (y < bottom))


def test_colours_are_blended_by_their_alpha(screen: Callable[..., Screen]) -> None:
    """Over a target (d, α_d): colour α·c + (1 - α)·d, as sRGB values; coverage α + (1 - α)·α_d."""
    one = screen()
    alpha, color, under, coverage = 102 / 255, np.array([255, 51, 0]), np.array([0.2, 0.4, 0.8]), 0.6
    packed = 102 << 24 | 51 << 8 | 255
    picture = one.frame(lambda: imgui.get_background_draw_list().add_rect_filled((10, 10), (20, 20), packed), (*under, coverage))
    expected = [*(alpha * color + (1 - alpha) * under * 255), (alpha + (1 - alpha) * coverage) * 255]
    assert np.abs(picture[10:20, 10:20] - np.array(expected)).max() <= 1  # the target's 8 bits
    assert np.abs(picture[20:, 20:] - np.array([*under, coverage]) * 255).max() <= 1


def test_more_vertices_than_16_bits_can_number(screen: Callable[..., Screen]) -> None:
    """Each pixel is a rectangle of its own colour: 4 · 240 · 160 = 153600 vertices, and then a second list over the first."""
    one = screen()
    width, height = SIZE
    colors = 0xFF000000 + np.arange(width * height).reshape(height, width) * 7

    def mosaic() -> None:
        below = imgui.get_background_draw_list()
        for (y, x), color in np.ndenumerate(colors):
            below.add_rect_filled((x, y), (x + 1, y + 1), int(color))
        white()

    def white() -> None:
        imgui.get_foreground_draw_list().add_rect_filled((3, 5), (4, 6), 0xFFFFFFFF)

    picture = one.frame(mosaic)
    expected = colors.astype("<u4").view("u1").reshape(height, width, 4).copy()  # imgui's colours: red in the lowest byte
    expected[5, 3] = 255
    assert np.array_equal(picture, expected)
    expected[...] = 0
    expected[5, 3] = 255
    assert np.array_equal(one.frame(white), expected)  # nothing is left of what was longer


def test_lists_and_vertex_offsets_are_one_numbering() -> None:
    """Index i of a command means vertex (vertices of earlier lists) + vtx_offset + i, whatever size imgui's indices have."""

    class Vector(np.ndarray):
        def data_address(self) -> int:
            return self.ctypes.data

    def commands(vertices: int, indices: list[int], *draws: tuple[int, int, int]) -> SimpleNamespace:
        vtx = np.full((vertices, imgui.VERTEX_SIZE), vertices, "u1").view(Vector)
        idx = np.array(indices, f"u{imgui.INDEX_SIZE}").view(Vector)
        reference = SimpleNamespace(get_tex_id=lambda: 7)
        cmd = [
            SimpleNamespace(tex_ref=reference, clip_rect=(0, 0, 1, 1), idx_offset=first, elem_count=count, vtx_offset=offset)
            for first, count, offset in draws
        ]
        return SimpleNamespace(vtx_buffer=vtx, idx_buffer=idx, cmd_buffer=cmd)

    vertices, indices, runs = module._flatten(
        [commands(9, [0, 1, 2, 0, 2, 1], (0, 3, 0), (3, 3, 6)), commands(4, [3, 2, 1], (0, 0, 0), (0, 3, 1))]
    )
    assert vertices.tolist() == [9] * 9 * imgui.VERTEX_SIZE + [4] * 4 * imgui.VERTEX_SIZE
    assert indices.dtype == "u4" and indices.tolist() == [0, 1, 2, 6, 8, 7, 9 + 1 + 3, 9 + 1 + 2, 9 + 1 + 1]
    assert [run[2:] for run in runs] == [(0, 3), (3, 3), (6, 3)]  # without the empty one, a user's callback


def test_a_texture_stands_upright_in_its_own_colours(ctx: moderngl.Context, screen: Callable[..., Screen]) -> None:
    one = screen()
    rows = np.array([[[10, 20, 30], [250, 128, 3]], [[0, 255, 0], [77, 0, 201]], [[1, 2, 3], [255, 255, 255]]], "u1")  # top first
    shown = [ctx.texture((2, 3), 3, np.ascontiguousarray(rows[::-1]).tobytes(), alignment=1)]  # OpenGL's first row: the bottom
    shown[0].filter = moderngl.NEAREST, moderngl.NEAREST
    picture = one.frame(rect(lambda: one.backend.image(shown[0], (20, 30))))
    left, top = (round(middle - half) for middle, half in zip(one.result[1], (10, 15), strict=True))
    assert np.array_equal(picture[top : top + 30, left : left + 20, :3], rows.repeat(10, 0).repeat(10, 1))
    shown[0].release()
    kept = weakref.ref(shown.pop())
    assert kept() is None  # a later texture may get its number


def test_a_click_presses_a_button_once(screen: Callable[..., Screen]) -> None:
    one = screen()
    show = rect(lambda: imgui.button("Gather"))
    one.frame(show)
    pressed = []
    for event in (
        lambda: one.backend.mouse_position(*one.result[1]),
        lambda: one.backend.mouse_button(1, True),
        lambda: one.backend.mouse_button(1, False),
        lambda: one.backend.mouse_button(2, True),
        lambda: one.backend.mouse_button(2, False),
        lambda: None,
    ):
        event()
        one.frame(show)
        pressed.append(one.result[0])
    assert pressed == [False, False, True, False, False, False]  # where the left button is let go of


def test_other_buttons_and_the_wheel_arrive(screen: Callable[..., Screen]) -> None:
    one = screen()
    seen: list[Any] = []
    for button in (2, 3):
        one.backend.mouse_button(button, True)
        one.frame(lambda: seen.append([imgui.is_mouse_down(i) for i in range(3)]))
    assert seen == [[False, True, False], [False, True, True]]  # imgui counts left, right, middle
    one.backend.scroll(-1.0, 2.0)
    one.frame(lambda: seen.append((imgui.get_io().mouse_wheel_h, imgui.get_io().mouse_wheel)))
    assert seen[-1] == (-1.0, 2.0)


def test_the_mouse_is_wanted_over_a_window_only(screen: Callable[..., Screen]) -> None:
    one = screen()
    one.frame(text("a"))
    for place, wanted in (((100, 80), True), ((5, 5), False)):
        one.backend.mouse_position(*place)
        one.frame(text("a"))
        one.frame(text("a"))
        assert one.backend.wants_mouse is wanted
    assert not one.backend.wants_keyboard


class Field:
    """A screen with one text field, which has the keyboard."""

    def __init__(self, one: Screen) -> None:
        self.one, self.value = one, ""
        one.frame(self.show)
        one.backend.mouse_position(*one.result[1])
        for pressed in (True, False):
            one.backend.mouse_button(1, pressed)
            one.frame(self.show)

    def show(self) -> Any:
        def field() -> None:
            _, self.value = imgui.input_text("##field", self.value)

        return rect(field)()

    def tap(self, *keys: int) -> None:
        """Press the keys one after the other, and let them go the other way round."""
        for key, pressed in [(k, True) for k in keys] + [(k, False) for k in keys[::-1]]:
            self.one.backend.key(key, pressed, KEYS)
            self.one.frame(self.show)

    def type(self, line: str) -> str:
        for character in line:
            self.one.backend.char(character)
        for _ in range(2):
            self.one.frame(self.show)
        return self.value


def test_typed_text_arrives(screen: Callable[..., Screen]) -> None:
    field = Field(screen())
    assert field.one.backend.wants_keyboard
    assert field.type("a = 0.3 ρπ") == "a = 0.3 ρπ"
    field.tap(KEYS.BACKSPACE)
    assert field.value == "a = 0.3 ρ"
    field.tap(KEYS.HOME)
    field.tap(KEYS.DELETE)
    field.tap(KEYS.RIGHT)
    assert field.type("é") == " é= 0.3 ρ"


@pytest.mark.parametrize("control", [KEYS.LEFT_CTRL, 345])  # glfw.KEY_RIGHT_CONTROL: moderngl-window has no name for it
def test_modifiers_arrive(screen: Callable[..., Screen], control: int, monkeypatch: pytest.MonkeyPatch) -> None:
    field = Field(screen())
    field.one.backend._io.config_mac_osx_behaviors = False  # there, the Cmd key selects all
    field.type("old")
    field.tap(control, KEYS.A)
    assert field.type("new") == "new"  # all was selected
    field.tap(KEYS.LEFT_SHIFT, KEYS.LEFT)
    assert field.type("t") == "net"


def test_a_modifier_holds_until_both_its_keys_are_up_or_the_window_is_left(screen: Callable[..., Screen]) -> None:
    one = screen()
    gui, held = one.backend, []

    def look() -> None:
        held.append(imgui.get_io().key_shift)

    for key, pressed in ((KEYS.LEFT_SHIFT, True), (KEYS.RIGHT_SHIFT, True), (KEYS.LEFT_SHIFT, False), (KEYS.RIGHT_SHIFT, False)):
        gui.key(key, pressed, KEYS)
        one.frame(look)
    assert held == [True, True, True, False]
    gui.key(KEYS.LEFT_SHIFT, True, KEYS)
    one.frame(look)
    gui.focus(False)
    one.frame(look)
    gui.focus(True)
    one.frame(look)
    assert held[4:] == [True, False, False]
    for pressed in (True, False):
        gui.key(KEYS.RIGHT_SHIFT, pressed, KEYS)
        one.frame(look)
    assert held[7:] == [True, False]  # the left one is not thought to be down any more


def test_every_key_of_the_window_is_known() -> None:
    named = {name: getattr(KEYS, name) for name in dir(KEYS) if name.isupper() and not name.startswith("ACTION")}
    table = module._key_table(KEYS)
    assert set(named.values()) <= set(table)
    assert [table[key] for key in (KEYS.NUMBER_7, KEYS.NUMPAD_0, KEYS.UP)] == [
        imgui.Key._7,
        imgui.Key.keypad0,
        imgui.Key.up_arrow,
    ]
    assert len(set(table.values())) == len(table)  # no two keys are one


def test_the_headless_windows_keys_are_passed_over(screen: Callable[..., Screen]) -> None:
    assert module._key_table(HEADLESS_KEYS) == {}  # all of them are called "undefined"
    screen().backend.key(HEADLESS_KEYS.A, True, HEADLESS_KEYS)


@pytest.mark.parametrize("character", "Σρπ²·°×→")
def test_the_font_has_our_letters(screen: Callable[..., Screen], character: str) -> None:
    one = screen()
    blank, unknown, known = (one.frame(text(c)) for c in ("", "\uffff", character))
    assert not letters(blank).any()
    assert letters(known).any() and not np.array_equal(known, unknown)


def height(picture: np.ndarray) -> int:
    rows = np.nonzero(letters(picture).any(1))[0]
    return int(rows[-1] - rows[0] + 1)


def test_scale_makes_text_larger_and_can_be_changed(screen: Callable[..., Screen]) -> None:
    """The stem of an H scales with its font; its rows are whole pixels, so each of the heights is off by one at most."""
    plain, large = screen(), screen(scale=2.0)
    small, big = (one.frame(text("H")) for one in (plain, large))
    assert height(small) > 8 and abs(height(big) - 2 * height(small)) <= 2
    plain.backend.resize_scale(2.0)
    assert np.array_equal(plain.frame(text("H")), big)
    plain.backend.resize_scale(1.0)
    assert np.array_equal(plain.frame(text("H")), small)


def test_scale_makes_widgets_larger(screen: Callable[..., Screen]) -> None:
    """A button is as high as its font and its padding twice, at scale s each s times: both are whole numbers at 1 and at 2."""

    def button() -> float:
        imgui.button("H")
        return imgui.get_item_rect_size().y

    heights = []
    for scale in (1.0, 2.0):
        one = screen(scale=scale)
        one.frame(window(button))
        heights.append(one.result)
    assert heights == [16 + 2 * 3, 2 * (16 + 2 * 3)]


def test_a_dense_framebuffer_gets_finer_text_in_the_same_place(screen: Callable[..., Screen]) -> None:
    """As on macOS: window coordinates stay, pixels double. Text is drawn finer, not stretched: not all 2x2 blocks are even."""
    sparse, dense = screen().frame(text("Hg")), screen(density=2.0).frame(text("Hg"))
    assert abs(height(dense) - 2 * height(sparse)) <= 2
    assert not np.array_equal(dense, dense[::2, ::2].repeat(2, 0).repeat(2, 1))
    covered = np.nonzero(dense[..., 3].any(1))[0]
    assert (covered[0], covered[-1]) == (60, 259)  # the window's rows, 30 to 130


def test_glyphs_that_come_later_are_drawn_as_well(screen: Callable[..., Screen], monkeypatch: pytest.MonkeyPatch) -> None:
    """They reach the atlas as updates of parts of it; the picture is that of an ImguiBackend which had them from the start."""
    updates: list[dict[str, Any]] = []
    write = moderngl.Texture.write

    def watched(self: moderngl.Texture, data: Any, **options: Any) -> None:
        updates.append(options)
        write(self, data, **options)

    monkeypatch.setattr(moderngl.Texture, "write", watched)
    late, early = screen(), screen()
    late.frame(text("abc"))
    before = len(updates)
    late.frame(text("XYZ"))
    assert len(updates) > before and all(u["viewport"][2] < 512 for u in updates)  # a part, not all
    assert np.array_equal(late.frame(text("XYZ")), early.frame(text("XYZ")))


class Watch:
    """Keeps what a moderngl context makes while it is patched."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made: list[tuple[str, Any]] = []
        for kind in ("texture", "buffer", "vertex_array", "program", "framebuffer", "external_texture", "sampler"):
            monkeypatch.setattr(moderngl.Context, kind, self._watched(kind, getattr(moderngl.Context, kind)))

    def _watched(self, kind: str, make: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*arguments: Any, **options: Any) -> Any:
            self.made.append((kind, make(*arguments, **options)))
            return self.made[-1][1]

        return watched

    def alive(self) -> list[str]:
        return [kind for kind, one in self.made if not isinstance(one.mglo, moderngl.InvalidObject)]


def test_release_leaves_nothing_behind(screen: Callable[..., Screen], monkeypatch: pytest.MonkeyPatch) -> None:
    one = screen()
    other = screen()
    watch = Watch(monkeypatch)
    gui, one.backend = one.backend, ImguiBackend(one.backend.ctx)
    for _ in range(3):
        one.frame(text("abc"))
    assert sorted(set(watch.alive())) == ["buffer", "program", "texture", "vertex_array"]
    one.backend.release()
    assert watch.alive() == []
    assert imgui.get_current_context() is None
    one.backend = gui
    assert letters(one.frame(text("abc"))).any() and letters(other.frame(text("abc"))).any()  # theirs are untouched


def test_an_atlas_that_imgui_outgrew_is_freed(screen: Callable[..., Screen], monkeypatch: pytest.MonkeyPatch) -> None:
    watch = Watch(monkeypatch)
    one = screen()

    def sizes(points: int) -> None:
        imgui.push_font(None, points)
        imgui.text_unformatted("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
        imgui.pop_font()

    for points in range(40, 120, 8):
        one.frame(window(partial(sizes, points)))
    assert len([kind for kind, _ in watch.made if kind == "texture"]) >= 4  # the target's, and one atlas after another
    for _ in range(4):
        picture = one.frame(text("abc"))
    assert watch.alive().count("texture") == 2  # the target's and the atlas
    assert letters(picture).any()


def test_a_draw_states_its_state_and_leaves_none(ctx: moderngl.Context, screen: Callable[..., Screen]) -> None:
    """A picture after a hostile draw is that after none; and what is drawn next, stating nothing, covers the whole target."""
    one = screen()
    one.frame(text("abc"))
    expected = one.frame(text("abc"))
    ctx.enable(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
    ctx.depth_func, ctx.cull_face, ctx.front_face = "<", "front_and_back", "cw"
    ctx.blend_func, ctx.wireframe = (moderngl.ZERO, moderngl.ONE), True
    ctx.blend_equation = moderngl.FUNC_REVERSE_SUBTRACT  # type: ignore[assignment]
    one.target.viewport = (0, 0, 3, 3)
    assert np.array_equal(one.frame(text("abc")), expected)
    assert not ctx.wireframe and one.target.scissor in (None, (0, 0, *SIZE))
    program = ctx.program(
        vertex_shader="#version 330 core\n"
        "void main() { gl_Position = vec4(ivec2(gl_VertexID & 1, gl_VertexID >> 1) * 4 - 1, 0, 1); }",
        fragment_shader="#version 330 core\nout vec4 color; void main() { color = vec4(1, 0, 1, 0.5); }",
    )
    array = ctx.vertex_array(program, [])
    array.render(vertices=3)
    picture = np.frombuffer(one.target.read(components=4), "u1").reshape(-1, 4)
    assert (picture[:, :3] == (255, 0, 255)).all() and (np.abs(picture[:, 3] - 127.5) <= 0.5).all()
    ctx.cull_face, ctx.front_face = "back", "ccw"
    array.release()
    program.release()


def test_two_backends_are_independent(screen: Callable[..., Screen]) -> None:
    """Each has its own context: events reach the one that they were meant for, though the other's is current."""
    one, other = screen(), screen()
    show = rect(lambda: imgui.button("Gather"))
    for _ in range(2):
        one.frame(show)
        other.frame(show)
    for event in (lambda: one.backend.mouse_position(*one.result[1]), lambda: one.backend.mouse_button(1, True)):
        event()
        one.frame(show)
        other.frame(show)
    one.backend.mouse_button(1, False)
    other.frame(show)
    one.frame(show)
    assert one.result[0] and not other.result[0]
    assert one.backend.wants_mouse and not other.backend.wants_mouse
    expected = [each.frame(text(line)) for each, line in ((one, "abc"), (other, "XYZ"))]
    for each, line in ((one, "abc"), (other, "XYZ")):  # frames that overlap
        each.backend.begin(SIZE, SIZE, 1 / 60)
        text(line)()
    for each, picture in zip((one, other), expected, strict=True):
        each.target.clear()
        each.backend.draw(each.target)
        assert np.array_equal(np.frombuffer(each.target.read(components=4), "u1").reshape(picture.shape)[::-1], picture)


def test_a_minimised_window_draws_nothing(ctx: moderngl.Context, screen: Callable[..., Screen]) -> None:
    one = screen()
    one.frame(text("abc"))
    for _ in range(2):
        one.backend.begin((0, 0), (0, 0), 0.0)
        text("XYZ")()
        one.backend.draw(one.target)
    assert letters(one.frame(text("XYZ"))).any()  # its glyphs came while nothing was drawn


def test_no_settings_file_is_written(screen: Callable[..., Screen], tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    one = screen()
    one.backend.begin(SIZE, SIZE, 10.0)  # imgui saves some seconds after a change, and when its context ends
    imgui.begin("a window that moves")
    imgui.set_window_pos((1, 1))
    imgui.end()
    one.backend.draw(one.target)
    one.release()
    assert not list(tmp_path.iterdir())
