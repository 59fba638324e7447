"""Where the windows of the interface stand, and how they look: what they share so that they do not overlap."""

from __future__ import annotations

from dataclasses import dataclass, field

from imgui_bundle import imgui

from irrsplat.app.viewer.buffers.tiles import Margins
from irrsplat.app.viewer.editing.picking import on_screen
from irrsplat.scene.model import Camera

MARGIN = 8.0  # window coordinates around what stands over the picture
MENU_BAR = 30.0  # window coordinates at scale 1 that the menu bar takes
STATISTICS_WIDTH = 212.0  # at least, of times and numbers
PANELS = ("settings", "lights", "object", "scale of light")
PANEL_WIDTH = 338.0  # of the panels, window coordinates at scale 1
_IN_FRONT = 4.0  # how much worse it is to lie behind the numbers than before another panel
_FREE = 0.35  # of the window's width that must stay free for what stands clear of the panels
_BAND, _LINE = 80.0, 260.0  # window coordinates at scale 1: height that messages take, and the least width for them
_LEAST_PICTURE = 32.0  # window coordinates: in a smaller area the picture fills the window
WIDGET_WIDTH = 128.0  # of a slider, window coordinates at scale 1
AMBER, RED, WHITE = (0.98, 0.67, 0.30, 1.0), (0.75, 0.2, 0.15, 0.92), (1.0, 1.0, 1.0, 1.0)
PLAIN = (  # a window without a frame, that cannot be moved and never takes the keyboard
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_saved_settings
    | imgui.WindowFlags_.no_focus_on_appearing
    | imgui.WindowFlags_.no_nav
    | imgui.WindowFlags_.no_move
    | imgui.WindowFlags_.no_docking
)
NO_SCROLLBAR = int(imgui.WindowFlags_.no_scrollbar)
DIALOG = imgui.WindowFlags_.no_collapse | imgui.WindowFlags_.no_docking  # a window that is about the whole, and soon closed
Box = tuple[float, float, float, float]  # left, top, right, bottom; window coordinates


@dataclass
class Layout:
    """The room that windows took in the last frame, window coordinates; others keep clear of it. scale: of text and widgets.

    area: the part of the window that docked panels and the menu bar leave; numbers, legends and messages are in it. picture: the
    part that the picture takes, which is the area where it is fitted, and all of the window otherwise.
    """

    scale: float = 1.0
    area: Box = (0.0, 0.0, 0.0, 0.0)
    picture: Box = (0.0, 0.0, 0.0, 0.0)
    legend_height: float = 0.0
    panel_right: float = 0.0  # where the settings' panel ends, while it is not docked
    legend_right: float = 0.0  # where the left side's legend ends
    statistics_size: tuple[float, float] = (0.0, 0.0)
    _boxes: dict[str, Box] = field(default_factory=dict)  # of the panels in the last frame, and so far in this one
    _drawn: dict[str, Box] = field(default_factory=dict)
    _moved: set[str] = field(default_factory=set)  # panels that are to go to where they stand at first
    _restoring: int = 0  # frames until all of them are

    def start(self, scale: float, hidden: bool, fitted: bool) -> None:
        """Start a frame: let panels dock at the window's edges. hidden: no panel is drawn; docked panels stay docked. fitted: the
        picture is fitted into the area, unless that is too small."""
        self.scale, self._boxes, self._drawn = scale, self._drawn, {}
        if self._restoring == 2:
            imgui.internal.clear_ini_settings()
        elif self._restoring == 1:  # now the area is all of the window again
            self._moved = set(PANELS)
        self._restoring = max(self._restoring - 1, 0)
        flags = imgui.DockNodeFlags_.passthru_central_node | imgui.DockNodeFlags_.no_docking_over_central_node
        ground = imgui.dock_space_over_viewport(0, None, flags | (imgui.DockNodeFlags_.keep_alive_only if hidden else 0))
        view = imgui.get_main_viewport()
        self.area = (0.0, min(MENU_BAR * scale, view.size.y), view.size.x, view.size.y)
        self.picture = (0.0, 0.0, view.size.x, view.size.y)
        node = imgui.internal.dock_builder_get_central_node(ground)
        if node is not None and not hidden:
            left, top = max(node.pos.x, 0.0), max(node.pos.y, self.area[1])
            self.area = (left, top, max(min(node.pos.x + node.size.x, view.size.x), left), max(node.pos.y + node.size.y, top))
            if fitted and min(self.area[2] - left, self.area[3] - top) >= _LEAST_PICTURE:
                self.picture = (left, max(node.pos.y, 0.0), self.area[2], self.area[3])

    @property
    def picture_size(self) -> tuple[float, float]:
        """Width and height of the picture, window coordinates."""
        return self.picture[2] - self.picture[0], self.picture[3] - self.picture[1]

    def seen(self, camera: Camera, point: tuple[float, float, float]) -> tuple[float, float] | None:
        """Return where a world point is in the window, window coordinates; None behind the eye."""
        found = on_screen(camera, self.picture_size, point)
        return None if found is None else (found[0] + self.picture[0], found[1] + self.picture[1])

    def pixels(self, density: float, size: tuple[int, int]) -> tuple[int, int, int, int]:
        """Return the picture's part of a window of `size` pixels: left, top, width, height. density: pixels per coordinate."""
        if self.picture[:2] == (0.0, 0.0):  # it fills the window, or nothing was drawn yet
            return 0, 0, *size
        left, top, right, bottom = (round(density * x) for x in self.picture)
        return left, top, max(min(right, size[0]) - left, 1), max(min(bottom, size[1]) - top, 1)

    def restore(self) -> None:
        """Put all panels back to where they stand at first, docked nowhere."""
        self._restoring = 2

    def margins(self, panel: bool, numbers: bool, hidden: bool) -> Margins:
        """What docked panels, the settings' `panel`, the `numbers`, the menu bar and the legend take of the window, where they
        are open: so that what fills the picture can stand clear of them. Where that leaves too little, it is the height alone."""
        if hidden:
            return Margins()
        (x, y), (width, height), view = self.picture[:2], self.picture_size, imgui.get_main_viewport().size
        left, top = self.area[0] - x, self.area[1] - y
        right, bottom = self.picture[2] - self.area[2], self.picture[3] - self.area[3]
        free = left, right
        if panel and left < self.panel_right - x < 0.5 * width:
            left = self.panel_right - x + MARGIN
        right += self.statistics_size[0] + 2.0 * MARGIN if numbers else 0.0
        legend = self.legend_right - x, self.legend_height - (view.y - self.picture[3])
        beside = left > legend[0]
        if width - max(left, legend[0]) - right < _FREE * width:
            (left, right), beside = free, False
        return Margins(left / width, right / width, top / height, (bottom if beside else legend[1]) / height)

    def place_panel(self, name: str, width: float, height: float, tall: bool = False, numbers: bool = False) -> None:
        """Place the next window, the panel of this name, where it stands at first, and keep it above the legends: in the first
        column from the left, or below others, where it covers neither a panel nor the numbers.

        width, height: about what it takes, window coordinates at scale 1. tall: it takes all the height that there is, until the
        user makes it another. numbers: those stand at the right.
        """
        view, (left, top, right, _) = imgui.get_main_viewport(), self.area
        when = imgui.Cond_.always if name in self._moved else imgui.Cond_.first_use_ever
        self._moved.discard(name)
        most = max(view.size.y - top - self.legend_height, 40.0)
        least = (120.0, 40.0) if tall else (0.0, 0.0)
        imgui.set_next_window_size_constraints(least, (max(min(2.0 * PANEL_WIDTH * self.scale, view.size.x), 120.0), most))
        if not tall:
            imgui.set_next_window_pos(self._free_place(name, width * self.scale, height * self.scale, numbers), when)
            return
        imgui.set_next_window_pos((left + MARGIN * self.scale, top), when)
        beside = right - left - 2.0 * MARGIN - (STATISTICS_WIDTH * self.scale + MARGIN if numbers else 0.0)
        imgui.set_next_window_size((min(width * self.scale, max(beside, 0.3 * view.size.x)), most), when)

    def _free_place(self, name: str, width: float, height: float, numbers: bool) -> tuple[float, float]:
        """Where a panel covers nothing, or as little as can be."""
        left, top, right, bottom = self.area
        boxes = [(1.0, box) for other, box in (self._boxes | self._drawn).items() if other != name]
        if numbers:
            wide, high = self.statistics_size
            boxes.append((_IN_FRONT, (right - wide - MARGIN, top, right, top + high)))
        gap = MARGIN * self.scale
        ends = (right - width, max(bottom - self.legend_height - height, top))
        beside = [x for _, box in boxes for x in (box[2] + gap, box[0] - width - gap)]
        lefts = [left + gap, *sorted(beside), ends[0] - gap]
        tops = [top, *sorted(box[3] + gap for _, box in boxes), ends[1]]
        found = [(x, y) for x in lefts for y in tops if left <= x <= ends[0] and y <= ends[1]]
        boxed = [(sum(cost * _shared((x, y, x + width, y + height), box) for cost, box in boxes), x, y) for x, y in found]
        _, x, y = min(boxed, default=(0.0, max(ends[0], 0.0), top), key=lambda one: one[0])
        return x, y

    def free_span(self, numbers: bool) -> tuple[float, float]:
        """Left and right end of the longest stretch below the menu bar that neither panels nor the numbers take; of all of the
        area where that is too short for a line of text. numbers: those stand at the right."""
        left, top, right, _ = self.area
        taken = [(box[0], box[2]) for box in self._drawn.values() if box[1] < top + _BAND * self.scale]
        if numbers:
            taken.append((right - MARGIN - self.statistics_size[0], right))
        spans, start = [], left
        for first, last in sorted([*taken, (right, right)]):
            spans.append((min(first, right) - start, start, first))
            start = max(start, last)
        length, first, last = max(spans)
        return (first, last) if length >= _LINE * self.scale else (left, right)

    def keep_inside(self, name: str) -> bool:
        """Move the present window, the panel of this name, back where a part of it stands outside of the main one, which may be
        smaller than last time; whether it floats. One that is docked is inside."""
        if imgui.is_window_docked():
            return False
        view, place, size = imgui.get_main_viewport(), imgui.get_window_pos(), imgui.get_window_size()
        top = MENU_BAR * self.scale
        x = max(min(place.x, view.size.x - size.x), 0.0)
        y = max(min(place.y, view.size.y - size.y), min(top, place.y) if place.y >= 0.0 else 0.0)
        if (x, y) != (place.x, place.y):
            imgui.set_window_pos((x, y))
        self._drawn[name] = (x, y, x + size.x, y + size.y)
        return True


def _shared(one: Box, other: Box) -> float:
    """The area that two boxes share."""
    width, height = (max(min(one[i + 2], other[i + 2]) - max(one[i], other[i]), 0.0) for i in (0, 1))
    return width * height


def accent() -> tuple[float, float, float, float]:
    """The colour of what stands out in text, by the theme."""
    colour = imgui.get_style_color_vec4(imgui.Col_.check_mark)
    return colour.x, colour.y, colour.z, colour.w


def in_unit(text: str, unit: str) -> str:
    """A number with its unit, where it has one."""
    return text if unit == "1" else f"{text} {unit}"
