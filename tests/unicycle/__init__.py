"""A flat world of boxes with one unicycle robot: the navigator's proving ground, without physics."""
