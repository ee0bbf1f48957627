"""The wire: sessions, messages as bytes and back; the only files that import zenoh and msgpack."""
