"""One step object per service: messages in, messages out; the same in a container, a process, a simulation."""
