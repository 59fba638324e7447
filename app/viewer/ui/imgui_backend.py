"""The interface's renderer: imgui's windows drawn by moderngl, and the window's events handed to imgui."""

from __future__ import annotations

import ctypes
from collections.abc import Hashable
from functools import cache
from importlib import resources
from typing import Any, NamedTuple, cast

import moderngl
import numpy as np
from imgui_bundle import imgui, implot
from moderngl_window.context.base.keys import BaseKeys

from irrsplat.gpu.program import Program
from irrsplat.gpu.resource import Owner, Resource

FONTS = ("Roboto/Roboto-Regular.ttf", "Inconsolata-Medium.ttf")  # the second for the arrows, which the first lacks
FONT_SIZE = 16.0  # window coordinates, at scale 1
SIZES: tuple[tuple[float | tuple[float, float], str], ...] = (  # window coordinates at scale 1; all others are imgui's own
    ((9, 8), "window_padding"),
    ((6, 3), "frame_padding item_inner_spacing"),
    (4.0, "window_rounding popup_rounding child_rounding"),
    (3.0, "frame_rounding grab_rounding tab_rounding"),
    (1.0, "separator_text_border_size"),
)
WHITE, ACCENT = (1.0, 1.0, 1.0), (0.98, 0.67, 0.30)
COLORS = (  # sRGB and opacity, over imgui's own, which are dark
    ((0.92, 0.92, 0.90, 1.0), "text"),
    ((0.58, 0.58, 0.57, 1.0), "text_disabled"),
    ((0.08, 0.085, 0.09, 0.9), "window_bg"),
    ((0.13, 0.135, 0.14, 0.97), "popup_bg title_bg title_bg_active title_bg_collapsed"),
    ((*WHITE, 0.08), "frame_bg checkbox_selected_bg tab tab_dimmed"),
    ((*WHITE, 0.12), "button header frame_bg_hovered tab_selected tab_dimmed_selected separator border resize_grip"),
    ((*WHITE, 0.19), "button_hovered header_hovered header_active frame_bg_active tab_hovered"),
    ((*ACCENT, 0.4), "docking_preview text_selected_bg button_active separator_hovered resize_grip_hovered"),
    ((*ACCENT, 0.85), "slider_grab plot_histogram plot_lines"),
    ((*ACCENT, 1.0), "slider_grab_active separator_active resize_grip_active check_mark tab_selected_overline nav_cursor"),
)

BLACK, OCHRE = (0.0, 0.0, 0.0), (0.72, 0.36, 0.0)
LIGHT_COLORS = (  # the same for a light theme
    ((0.10, 0.10, 0.10, 1.0), "text"),
    ((0.36, 0.36, 0.37, 1.0), "text_disabled"),
    ((0.95, 0.95, 0.94, 0.93), "window_bg"),
    ((0.98, 0.98, 0.97, 0.98), "popup_bg title_bg title_bg_active title_bg_collapsed menu_bar_bg"),
    ((*BLACK, 0.07), "frame_bg checkbox_selected_bg tab tab_dimmed"),
    ((*BLACK, 0.13), "button header frame_bg_hovered tab_selected tab_dimmed_selected separator border resize_grip"),
    ((*BLACK, 0.22), "button_hovered header_hovered header_active frame_bg_active tab_hovered"),
    ((*OCHRE, 0.35), "docking_preview text_selected_bg button_active separator_hovered resize_grip_hovered"),
    ((*OCHRE, 0.85), "slider_grab plot_histogram plot_lines"),
    ((*OCHRE, 1.0), "slider_grab_active separator_active resize_grip_active check_mark tab_selected_overline nav_cursor"),
)

MODIFIERS = ("shift", "ctrl", "alt", "super")
# moderngl-window's names of keys -> imgui's, where they differ by more than case
KEYS = {name: f"{name.lower()}_arrow" for name in ("LEFT", "RIGHT", "UP", "DOWN")}
KEYS |= {f"NUMBER_{i}": f"_{i}" for i in range(10)} | {f"NUMPAD_{i}": f"keypad{i}" for i in range(10)}
# glfw's numbers of the keys that moderngl-window has no name for
GLFW_KEYS = {39: "apostrophe", 96: "grave_accent", 335: "keypad_enter"}
GLFW_KEYS |= dict(enumerate((f"{side}_{name}" for side in ("left", "right") for name in MODIFIERS), start=340))


class ImguiBackend(Owner):
    """An imgui context of its own, drawn on `ctx`; between `begin` and `draw` it is the current one, for windows to be made.

    scale: how large text and widgets are, 1 for a plain monitor. Events may come at any time, whichever context is current.
    """

    def __init__(self, ctx: moderngl.Context, scale: float = 1.0) -> None:
        self.ctx = ctx
        self.program = Program(ctx, "viewer/gui")
        self._vertices, self._indices = (ctx.buffer(reserve=1 << 16, dynamic=True) for _ in range(2))
        self._array = self._vertex_array()
        self._textures: dict[int, moderngl.Texture] = {}  # by OpenGL's number: imgui's own, kept until it lets go of them
        self._pictures: dict[int, moderngl.Texture] = {}  # the caller's, for this frame
        self._pixels = (0, 0)
        self._pressed: set[imgui.Key] = set()

        self._context, self._plots = imgui.create_context(), implot.create_context()
        imgui.set_current_context(self._context)
        self._io = imgui.get_io()  # its methods work on its own context, whichever is current
        self._io.set_ini_filename(None)
        self._io.config_input_text_cursor_blink = False  # a window that rests is not drawn
        self._io.config_windows_move_from_title_bar_only = True  # a drag inside a window is for what lies there
        self._io.backend_flags |= imgui.BackendFlags_.renderer_has_textures | imgui.BackendFlags_.renderer_has_vtx_offset
        self._io.config_flags |= imgui.ConfigFlags_.docking_enable
        self._io.config_docking_with_shift = False
        platform = imgui.get_platform_io()
        platform.renderer_texture_max_width = platform.renderer_texture_max_height = ctx.info["GL_MAX_TEXTURE_SIZE"]
        for i, name in enumerate(FONTS):  # a glyph comes from the first font that has it
            config = imgui.ImFontConfig()
            config.merge_mode = i > 0
            with resources.as_file(resources.files("imgui_bundle") / "assets" / "fonts" / name) as path:
                self._io.fonts.add_font_from_file_ttf(str(path), FONT_SIZE, config)
        self._style = imgui.get_style()
        self.scale, self.light = scale, False
        self._color()
        self.resize_scale(scale)

    def _vertex_array(self) -> moderngl.VertexArray:
        content = [(self._vertices, "2f 2f 4f1", "in_position", "in_uv", "in_color")]
        return self.ctx.vertex_array(self.program.gl, content, self._indices, index_element_size=4, skip_errors=True)

    def _color(self) -> None:
        """Give the interface its colours: those of a light or of a dark theme."""
        imgui.set_current_context(self._context)
        (imgui.style_colors_light if self.light else imgui.style_colors_dark)(self._style)
        for color, names in LIGHT_COLORS if self.light else COLORS:
            for name in names.split():
                self._style.set_color_(imgui.Col_[name], color)

    def restyle(self, scale: float, light: bool) -> None:
        """Look by this scale, as `resize_scale` says, and this theme; nothing is done where it does already."""
        if light != self.light:
            self.light = light
            self._color()
        if scale != self.scale:
            self.resize_scale(scale)

    @property
    def windows(self) -> str:
        """Where the windows stand and how large they are, as imgui notes it; set it before the first frame."""
        imgui.set_current_context(self._context)
        return imgui.save_ini_settings_to_memory()

    @windows.setter
    def windows(self, notes: str) -> None:
        imgui.set_current_context(self._context)
        imgui.load_ini_settings_from_memory(notes)

    def resize_scale(self, scale: float) -> None:
        """Make text and widgets `scale` times as large as on a plain monitor; between frames."""
        self.scale = scale
        plain = imgui.Style()  # scaling rounds: it starts anew each time
        for size, names in SIZES:
            for name in names.split():
                setattr(plain, name, size)
        plain.scale_all_sizes(scale)
        plain.font_size_base, plain.font_scale_dpi = FONT_SIZE, scale
        for name in dir(plain):
            if isinstance(value := getattr(plain, name), (float, imgui.ImVec2)):
                setattr(self._style, name, value)

    def begin(self, size: tuple[int, int], framebuffer: tuple[int, int], dt: float) -> None:
        """Start a frame for a window of `size` (window coordinates) on `framebuffer` (pixels), `dt` seconds after the last."""
        imgui.set_current_context(self._context)
        implot.set_current_context(self._plots)
        self._pixels = framebuffer
        self._io.display_size = imgui.ImVec2(*size)
        if all(size) and all(framebuffer):  # not minimised
            self._io.display_framebuffer_scale = imgui.ImVec2(framebuffer[0] / size[0], framebuffer[1] / size[1])
        self._io.delta_time = max(dt, 1e-6)  # imgui takes no 0
        imgui.new_frame()

    def end(self) -> None:
        """End a pass that is not drawn."""
        imgui.set_current_context(self._context)
        imgui.end_frame()
        self._pictures.clear()

    def draw(self, framebuffer: moderngl.Framebuffer) -> None:
        """End the frame and draw it over what `framebuffer` holds: sRGB values, its first row the bottom one.

        Leaves scissor, blend and the like off. A texture shown by another way than `image` is a KeyError.
        """
        imgui.set_current_context(self._context)
        imgui.render()
        self._serve_textures()
        data = imgui.get_draw_data()
        vertices, indices, runs = _flatten(data.cmd_lists)
        if runs:
            for buffer, content in ((self._vertices, vertices), (self._indices, indices)):
                buffer.orphan(max(buffer.size, 1 << (content.nbytes - 1).bit_length()))  # what still draws from it goes on
                buffer.write(content)
            if self._array.program is not self.program.gl:  # its shaders were read again
                self._array.release()
                self._array = self._vertex_array()
            self.program.gl["window"].value = (*data.display_pos, *data.display_size)  # type: ignore[union-attr]
            framebuffer.viewport = (0, 0, *self._pixels)
            framebuffer.use()
            self.ctx.enable_only(moderngl.BLEND)
            self.ctx.blend_equation = moderngl.FUNC_ADD  # type: ignore[assignment]
            over = moderngl.ONE_MINUS_SRC_ALPHA
            self.ctx.blend_func = moderngl.SRC_ALPHA, over, moderngl.ONE, over  # type: ignore[assignment]
            self.ctx.wireframe = False
            textures = self._textures | self._pictures
            clips = (np.array([clip for _, clip, _, _ in runs]) - 2 * (*data.display_pos,)) * (2 * (*data.framebuffer_scale,))
            boxes = np.clip(np.rint(clips), 0, 2 * self._pixels).astype(int).tolist()
            for (texture, _, first, count), (left, top, right, bottom) in zip(runs, boxes, strict=True):
                textures[texture].use(0)
                framebuffer.scissor = left, self._pixels[1] - bottom, right - left, bottom - top
                self._array.render(moderngl.TRIANGLES, vertices=count, first=first)
            framebuffer.scissor = None  # type: ignore[assignment]
            self.ctx.enable_only(moderngl.NOTHING)
        self._pictures.clear()

    def image(self, texture: moderngl.Texture, size: tuple[float, float]) -> None:
        """A widget that shows `texture` (float or normalised, bottom row first) in `size`, window coordinates, by its own filter.

        The texture must live until `draw`. Where it has an alpha, it is blended by that.
        """
        self._pictures[texture.glo] = texture
        imgui.image(imgui.ImTextureRef(texture.glo), size, (0, 1), (1, 0))

    def background(self, texture: moderngl.Texture, box: tuple[float, float, float, float]) -> None:
        """Draw a texture (bottom row first) below all windows. box: left, top, right, bottom in window coordinates."""
        self._pictures[texture.glo] = texture
        imgui.get_background_draw_list().add_image(imgui.ImTextureRef(texture.glo), box[:2], box[2:], (0, 1), (1, 0))

    def key(self, key: int | str, pressed: bool, keys: type[BaseKeys]) -> None:
        """A key of the window's `keys` (moderngl-window's) went down or up; one that imgui does not know is ignored.

        So is Tab, unless a field is typed into: imgui takes it as the wish to type into its first field, even with its keyboard
        navigation off, and would get every key from then on.
        """
        found = _key_table(cast(Hashable, keys)).get(key)
        if found == imgui.Key.tab and pressed and not self.wants_keyboard:
            return
        if found is not None:
            (self._pressed.add if pressed else self._pressed.discard)(found)
            self._io.add_key_event(found, pressed)
            for name in MODIFIERS:
                held = {imgui.Key[f"left_{name}"], imgui.Key[f"right_{name}"]} & self._pressed
                self._io.add_key_event(imgui.Key[f"mod_{name}"], bool(held))

    def char(self, text: str) -> None:
        """Text was typed."""
        self._io.add_input_characters_utf8(text)

    def mouse_position(self, x: float, y: float) -> None:
        """The mouse is at (x, y), window coordinates from the top left corner; `wants_mouse` knows it at once."""
        self._io.add_mouse_pos_event(x, y)
        imgui.set_current_context(self._context)
        if imgui.get_frame_count():  # before the first frame there is nothing to point at
            imgui.internal.update_hovered_window_and_capture_flags(imgui.ImVec2(x, y))

    def mouse_button(self, button: int, pressed: bool) -> None:
        """A mouse button went down or up: 1 left, 2 right, 3 middle, as moderngl-window numbers them."""
        self._io.add_mouse_button_event(button - 1, pressed)

    def scroll(self, dx: float, dy: float) -> None:
        """The wheel turned, in its notches; dy > 0 is away from the user."""
        self._io.add_mouse_wheel_event(dx, dy)

    def focus(self, focused: bool) -> None:
        """The window gained or lost the keyboard: keys held while it goes are let go of, for their release is never seen."""
        self._pressed.clear()
        self._io.add_focus_event(focused)

    @property
    def wants_mouse(self) -> bool:
        """Whether the mouse is for the interface, as the windows were at the last `begin`: leave the camera alone."""
        return self._io.want_capture_mouse

    @property
    def wants_keyboard(self) -> bool:
        """Whether the keyboard is for the interface, as of the last `begin`."""
        return self._io.want_capture_keyboard

    def owned(self) -> tuple[Resource, ...]:
        """What this frees, besides imgui's context."""
        return (self._array, self._vertices, self._indices, self.program, *self._textures.values())

    def release(self) -> None:
        """Free the imgui context and every OpenGL object; nothing may be called after it."""
        super().release()
        implot.destroy_context(self._plots)
        imgui.destroy_context(self._context)

    def _serve_textures(self) -> None:
        """Make, update and free the textures that imgui asks for."""
        status = imgui.ImTextureStatus
        for wanted in imgui.get_platform_io().textures:
            if wanted.status == status.want_create:
                texture = self.ctx.texture((wanted.width, wanted.height), 4, wanted.get_pixels_array())
                texture.repeat_x = texture.repeat_y = False
                self._textures[texture.glo] = texture
                wanted.set_tex_id(texture.glo)
                wanted.set_status(status.ok)
            elif wanted.status == status.want_updates:
                pixels = wanted.get_pixels_array().reshape(wanted.height, wanted.width, 4)
                for r in wanted.updates:
                    part = pixels[r.y : r.y + r.h, r.x : r.x + r.w]
                    self._textures[wanted.tex_id].write(part.tobytes(), viewport=(r.x, r.y, r.w, r.h))
                wanted.set_status(status.ok)
            elif wanted.status == status.want_destroy and wanted.unused_frames > 0:
                self._textures.pop(wanted.tex_id).release()
                wanted.set_tex_id(0)
                wanted.set_status(status.destroyed)


class _Run(NamedTuple):
    """A draw: its texture's number, its clip rectangle (left, top, right, bottom; window coordinates), and its indices."""

    texture: int
    clip: tuple[float, ...]
    first_index: int
    index_count: int


def _flatten(lists: Any) -> tuple[np.ndarray, np.ndarray, list[_Run]]:
    """imgui's draw lists as one: vertices (bytes), indices into them (uint32), and the draws in their order.

    moderngl has no base vertex, so each list's indices are raised by the number of vertices before it.
    """
    vertices, indices = [np.empty(0, "u1")], [np.empty(0, "u4")]
    runs: list[_Run] = []
    vertex = first = 0
    for one in lists:
        vertices.append(_memory(one.vtx_buffer, imgui.VERTEX_SIZE, "u1"))
        moved = _memory(one.idx_buffer, imgui.INDEX_SIZE, f"u{imgui.INDEX_SIZE}").astype("u4") + np.uint32(vertex)
        for command in one.cmd_buffer:
            start, count = command.idx_offset, command.elem_count
            moved[start : start + count] += np.uint32(command.vtx_offset)
            if count:  # a user's callback has none
                runs.append(_Run(command.tex_ref.get_tex_id(), tuple(command.clip_rect), first + start, count))
        indices.append(moved)
        vertex, first = vertex + len(one.vtx_buffer), first + len(moved)
    return np.concatenate(vertices), np.concatenate(indices), runs


def _memory(vector: Any, size: int, dtype: str) -> np.ndarray:
    """What an ImVector with elements of `size` bytes holds, not copied: valid until imgui's next frame."""
    return np.frombuffer(memoryview((ctypes.c_char * (len(vector) * size)).from_address(vector.data_address())), dtype)


@cache
def _key_table(keys: Hashable) -> dict[int | str, imgui.Key]:
    """A window's numbers of keys -> imgui's keys."""
    table = {getattr(keys, name): KEYS.get(name, name.lower()) for name in dir(keys) if name.isupper()}
    table |= GLFW_KEYS if getattr(keys, "ESCAPE", None) == 256 else {}  # which is glfw's number
    return {key: imgui.Key[name] for key, name in table.items() if name in imgui.Key.__members__ and key != "undefined"}
