"""The reference: finite-strain elasticity in UFL, solved on FEniCSx."""
