"""Simulators of others: adapters and their registry, benchmarks, scoreboard, frontier."""
