"""The truth: Saint-Venant-Kirchhoff solves in UFL on FEniCSx."""
