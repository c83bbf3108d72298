"""Pictures of bodies, by whichever library can draw here."""
