"""One step object per service: messages in, messages out. The same objects run in a container, a process or a simulation."""

from orograph.node import Node, Note, Send, text_array

__all__ = ["Node", "Note", "Send", "text_array"]
