"""The only files that import msgpack, zenoh, prometheus_client, os.environ and sqlite3."""
