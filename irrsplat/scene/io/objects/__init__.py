"""Scenes from objects in memory: NumPy arrays (arrays), trimesh's meshes and scenes, and Mitsuba's scenes."""
