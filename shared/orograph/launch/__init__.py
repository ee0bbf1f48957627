"""How a mission is run: in one process, as processes, as a cluster; below services and the command line."""
