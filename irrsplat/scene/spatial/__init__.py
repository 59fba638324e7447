"""Searches among triangles on the CPU: the tree for rays, culling by parts of meshes, and points within solids."""
