"""What all rooms share: meshes, shapes, files and problems as plain data; no mechanics."""
