"""The map protocol (protocol.md) as sans-I/O step objects: messages in, messages out, time and seed given."""
