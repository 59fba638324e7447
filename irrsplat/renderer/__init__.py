"""The frame, and what callers of the library hold.

renderer: `Renderer` and `render`, all that is public. state: what a renderer shows, as one value. stages: the stages of a
picture, each drawn when what it depends on has changed. rounds: one round of a view, in the paper's order. frames: rounds and
pictures, and the refinement of a complete view.
"""

from irrsplat.renderer.renderer import Renderer, render

__all__ = ["Renderer", "render"]
