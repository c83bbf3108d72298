"""The judge of simulators: cases, metrics, gates, studies, benchmarks and reports."""
