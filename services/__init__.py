"""The services: one thin shell per container."""
