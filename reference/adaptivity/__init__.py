"""The reference on meshes that are refined where its error comes from."""
