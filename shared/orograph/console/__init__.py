"""The page on which a run is seen, live or played again: reads, never steps. viser is known here only."""
