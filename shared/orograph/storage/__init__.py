"""Files and SQLite: the run folder, scenario files, the Map Manager's store."""
