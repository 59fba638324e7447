"""The context of imgui. imgui's own OpenGL backend draws it, and it receives the window's events."""

from __future__ import annotations

import os
from collections.abc import Hashable
from functools import cache
from importlib import resources
from typing import cast

from imgui_bundle import hello_imgui, imgui, implot
from moderngl_window.context.base.keys import BaseKeys

FONTS = ("Roboto/Roboto-Regular.ttf", "Inconsolata-Medium.ttf")  # the second font has the arrows, which the first lacks
SYSTEM_FONTS = (  # with Chinese, Japanese and Korean glyphs, for names of files and objects; the first one that exists is used
    *(f"/usr/share/fonts/{folder}/NotoSansCJK-Regular.ttc" for folder in ("opentype/noto", "noto-cjk", "google-noto-cjk")),
    "/System/Library/Fonts/Hiragino Sans GB.ttc",
    "C:/Windows/Fonts/msyh.ttc",
)
FONT_SIZE = 16.0  # window coordinates at scale 1: the height of the font
_THEME = hello_imgui.ImGuiTheme_.photoshop_style
_QUIET = (0.66, 0.66, 0.66, 1.0)  # sRGB and opacity of secondary text
_GRAB, _DRAGGED = 0.5, 0.65  # opacity of a slider's grab, so that its white number stays readable; the second one while dragged

# moderngl-window's names of keys -> imgui's names, where these names differ by more than case
KEYS = {name: f"{name.lower()}_arrow" for name in ("LEFT", "RIGHT", "UP", "DOWN")}
_KEYPAD_ENTER = 335  # glfw's number; moderngl-window has no name for it
KEYS |= {f"NUMBER_{i}": f"_{i}" for i in range(10)} | {f"NUMPAD_{i}": f"keypad{i}" for i in range(10)}


class ImguiBackend:
    """An imgui context in the current OpenGL context. It is imgui's current context between `begin` and `draw`.

    scale: the scale of text and widgets, 1 on a plain monitor. io: the input of this context. It takes events at any time, also
    while another context is current. Its `want_capture_mouse` and `want_capture_keyboard` are true if the interface takes events.
    """

    def __init__(self) -> None:
        self._context, self._plots = imgui.create_context(), implot.create_context()
        imgui.set_current_context(self._context)
        self.io = imgui.get_io()  # its methods work on its own context, also while another one is current
        self.io.set_ini_filename(None)
        self.io.config_input_text_cursor_blink = False  # an idle window is not redrawn, so a cursor would stop blinking
        self.io.config_windows_move_from_title_bar_only = True  # a drag inside a window moves the widgets there
        imgui.backends.opengl3_init("#version 330")
        for i, name in enumerate(FONTS):  # imgui takes a glyph from the first font with this glyph
            config = imgui.ImFontConfig()
            config.merge_mode = i > 0
            with resources.as_file(resources.files("imgui_bundle") / "assets" / "fonts" / name) as path:
                self.io.fonts.add_font_from_file_ttf(str(path), FONT_SIZE, config)
        for font in [path for path in SYSTEM_FONTS if os.path.isfile(path)][:1]:
            self.io.fonts.add_font_from_file_ttf(font, FONT_SIZE, config)
        self._style = imgui.get_style()
        hello_imgui.apply_theme(_THEME)
        self._style.set_color_(imgui.Col_.text_disabled, _QUIET)
        red, green, blue, _ = tuple(self._style.color_(imgui.Col_.slider_grab_active))  # the theme's accent
        self._style.set_color_(imgui.Col_.slider_grab, (red, green, blue, _GRAB))
        self._style.set_color_(imgui.Col_.slider_grab_active, (red, green, blue, _DRAGGED))
        self.resize_scale(1.0)

    def resize_scale(self, scale: float) -> None:
        """Make text and widgets `scale` times as large as on a plain monitor. Call it between frames."""
        self.scale = scale
        plain = imgui.Style()  # scaling rounds sizes, so it starts from the plain ones each time
        plain.scale_all_sizes(scale)
        plain.font_size_base, plain.font_scale_dpi = FONT_SIZE, scale
        for name in dir(plain):
            if isinstance(value := getattr(plain, name), (float, imgui.ImVec2)):
                setattr(self._style, name, value)

    def begin(self, size: tuple[int, int], framebuffer: tuple[int, int], dt: float) -> None:
        """Start a frame of a window: `size` in window coordinates, `framebuffer` in pixels, `dt` seconds after the last one."""
        imgui.set_current_context(self._context)
        implot.set_current_context(self._plots)
        self.io.display_size = imgui.ImVec2(*size)
        if all(size) and all(framebuffer):  # not minimised
            self.io.display_framebuffer_scale = imgui.ImVec2(framebuffer[0] / size[0], framebuffer[1] / size[1])
        self.io.delta_time = max(dt, 1e-6)  # imgui refuses 0
        imgui.backends.opengl3_new_frame()
        imgui.new_frame()

    def draw(self) -> None:
        """End the frame, and draw it over the content of the bound framebuffer (sRGB values, bottom row first)."""
        imgui.render()
        imgui.backends.opengl3_render_draw_data(imgui.get_draw_data())

    def key(self, key: int | str, pressed: bool, keys: type[BaseKeys], ctrl: bool, shift: bool, alt: bool) -> None:
        """Send imgui a press or release of one of the window's `keys` (moderngl-window's). Ignore a key without a name in imgui.

        Tab is ignored, too, unless the user types into a field. imgui focuses its first field at Tab, even with keyboard
        navigation off, and would then take every further key.
        """
        for modifier, held in ((imgui.Key.mod_ctrl, ctrl), (imgui.Key.mod_shift, shift), (imgui.Key.mod_alt, alt)):
            self.io.add_key_event(modifier, held)
        found = _key_table(cast(Hashable, keys)).get(key)
        if found is not None and not (found == imgui.Key.tab and pressed and not self.io.want_capture_keyboard):
            self.io.add_key_event(found, pressed)

    def mouse_position(self, x: float, y: float) -> None:
        """Set the mouse position (x, y), window coordinates from the top left corner. Update `want_capture_mouse` at once."""
        self.io.add_mouse_pos_event(x, y)
        imgui.set_current_context(self._context)
        if imgui.get_frame_count():  # there are no windows before the first frame
            imgui.internal.update_hovered_window_and_capture_flags(imgui.ImVec2(x, y))

    def release(self) -> None:
        """Free the imgui context and its OpenGL objects. No method may be called afterwards."""
        imgui.set_current_context(self._context)
        imgui.backends.opengl3_shutdown()
        implot.destroy_context(self._plots)
        imgui.destroy_context(self._context)


@cache
def _key_table(keys: Hashable) -> dict[int | str, imgui.Key]:
    """Return imgui's key by the number of a window's key."""
    table = {getattr(keys, name): KEYS.get(name, name.lower()) for name in dir(keys) if name.isupper()}
    table[_KEYPAD_ENTER] = "keypad_enter"
    return {key: imgui.Key[name] for key, name in table.items() if name in imgui.Key.__members__ and key != "undefined"}
