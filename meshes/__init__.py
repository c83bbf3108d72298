"""Common ground: meshes, shapes, files and plain problem data; no mechanics."""
