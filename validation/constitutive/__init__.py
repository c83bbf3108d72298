"""Is a law the one it states? Energy, stress and tangent, deformation by deformation."""
