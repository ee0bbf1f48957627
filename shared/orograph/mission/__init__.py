"""The mission: the patrol shared out over the robots, and the phases of a run."""
