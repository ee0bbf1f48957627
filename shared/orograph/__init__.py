"""Orograph: robots with 3D lasers build one layered 2.5D map together, over links that drop."""
