"""Missions: dividing the patrol, and driving it (pose, planning, following)."""
