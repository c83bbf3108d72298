"""Schemes by which simulators step through time, each on the judged mesh and with its step."""
