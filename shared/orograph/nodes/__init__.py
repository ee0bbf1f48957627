"""One step object per service: messages in, messages out; the same in a container, a process, a simulation."""

from orograph.node import Node, Note, Send, text_array

__all__ = ["Node", "Note", "Send", "text_array"]
