"""Scenes from what programs hold in memory: NumPy arrays (arrays), trimesh's meshes and scenes, and Mitsuba's scenes."""
