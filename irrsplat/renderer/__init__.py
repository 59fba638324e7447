"""The frame, and what callers of the library hold.

renderer: `Renderer` and `render`, all that is public. state: what a renderer shows, as one value. stages: the stages of a
picture, each drawn when an input has changed. frames: the frame and its round, in the paper's order, and the refinement of a
complete view.
"""

from irrsplat.renderer.renderer import Renderer, render

__all__ = ["Renderer", "render"]
