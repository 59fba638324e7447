"""The frame, and the public interface.

renderer: `Renderer` and `render`, the public interface. state: a renderer's state, as one value. stages: the stages of a
picture, each drawn when an input has changed. frames: the frame and its round, in the paper's order, and the refinement of a
complete view.
"""

from irrsplat.renderer.renderer import Renderer, render

__all__ = ["Renderer", "render"]
