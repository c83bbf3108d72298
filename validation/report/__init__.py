"""Reports for people: one HTML file, its figures and tables."""
