"""The judge: cases, metrics, gates, studies, benchmarks and reports."""
