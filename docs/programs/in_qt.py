"""A host's widget: irrsplat draws into a QOpenGLWidget of PySide6, next to other widgets of Qt.

pip install PySide6-Essentials
python docs/programs/in_qt.py
"""

from __future__ import annotations

import sys

import moderngl
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QSurfaceFormat
from PySide6.QtOpenGLWidgets import QOpenGLWidget
from PySide6.QtWidgets import QApplication, QLabel, QMainWindow, QSlider, QVBoxLayout, QWidget

import irrsplat


class LitWidget(QOpenGLWidget):
    """A scene, refined as long as there is something to refine."""

    def __init__(self, scene: irrsplat.Scene) -> None:
        super().__init__()
        self.scene, self.renderer, self.still = scene, None, False
        self.timer = QTimer(self, interval=0, timeout=self.update)

    def initializeGL(self) -> None:
        """Qt's context is current here, in paintGL and in resizeGL; elsewhere, makeCurrent() makes it so."""
        self.ctx = moderngl.create_context(require=330)
        self.renderer = irrsplat.Renderer(self.scene, self.pixels, "preview", ctx=self.ctx, exposure=-0.5)  # dimmed is darker
        self.context().aboutToBeDestroyed.connect(self.free)
        self.timer.start()

    @property
    def pixels(self) -> tuple[int, int]:
        """Its size in the screen's pixels."""
        ratio = self.devicePixelRatio()
        return max(1, round(self.width() * ratio)), max(1, round(self.height() * ratio))

    def paintGL(self) -> None:
        """A tick: 30 ms of work at most, into the framebuffer that Qt has bound for this widget."""
        if self.renderer.size != self.pixels:
            self.renderer.resize(self.pixels)
        view, progress = self.renderer.frame(seconds=0.03)
        self.renderer.show(view, self.ctx.detect_framebuffer(self.defaultFramebufferObject()))
        self.still = progress.still
        if self.still:
            self.timer.stop()

    def dim(self, percent: int) -> None:
        """Light the scene by so much of its lamps; from a slider, so the context is not current."""
        factor = percent / 100.0
        lights = [
            irrsplat.Light(**{**vars(light), "color": tuple(factor * c for c in light.color)}) for light in self.scene.lights
        ]
        self.makeCurrent()
        self.renderer.relight(lights)
        self.doneCurrent()
        self.timer.start()

    def free(self) -> None:
        """Before Qt destroys the context, when the window closes."""
        self.timer.stop()
        self.makeCurrent()
        self.renderer.release()
        self.doneCurrent()


def window() -> tuple[QMainWindow, LitWidget]:
    """A window with the widget, and a slider for its lamps."""
    lit, slider = LitWidget(irrsplat.load("cornell")), QSlider(Qt.Orientation.Horizontal, minimum=0, maximum=200, value=100)
    slider.valueChanged.connect(lit.dim)
    layout = QVBoxLayout()
    for part in (lit, QLabel("brightness of the lamp"), slider):
        layout.addWidget(part, stretch=int(part is lit))
    main, middle = QMainWindow(), QWidget()
    middle.setLayout(layout)
    main.setCentralWidget(middle)
    main.setWindowTitle("irrsplat in a Qt widget")
    main.resize(480, 560)
    return main, lit


if __name__ == "__main__":
    wanted = QSurfaceFormat()
    wanted.setVersion(3, 3)
    wanted.setProfile(QSurfaceFormat.OpenGLContextProfile.CoreProfile)
    QSurfaceFormat.setDefaultFormat(wanted)
    application = QApplication(sys.argv)
    shown, _ = window()
    shown.show()
    sys.exit(application.exec())
