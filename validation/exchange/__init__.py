"""Files in, files out: how any simulator takes part."""
