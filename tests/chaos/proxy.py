"""A TCP proxy that can be bad on demand, between services and the radio's router (what netem would do elsewhere).

It reads what to be from a file: `delay MS JITTER_MS`, `rate BYTES_PER_S`, `reset SECONDS`; empty: a plain wire.
"""

from __future__ import annotations

import asyncio
import random
import socket
import struct
import time
from pathlib import Path

LISTEN_PORT, TARGET = 7447, ("router-radio", 7447)
MODE = Path("/tmp/mode")
CHUNK_BYTES = 16_384
QUEUED_MAX = 64
draw = random.Random(1)


def mode() -> tuple[str, list[float]]:
    """The word and its numbers."""
    words = MODE.read_text().split() if MODE.exists() else []
    return (words[0], [float(w) for w in words[1:]]) if words else ("", [])


async def carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """One direction of one connection, in order; a full queue holds the sender up, as a slow link does."""
    queue: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(QUEUED_MAX)

    async def read() -> None:
        while chunk := await reader.read(CHUNK_BYTES):
            word, numbers = mode()
            late_s = (numbers[0] + draw.uniform(-1, 1) * numbers[1]) / 1000 if word == "delay" else 0.0
            await queue.put((time.monotonic() + late_s, chunk))
        await queue.put((0.0, b""))

    async def write() -> None:
        while (item := await queue.get())[1]:
            await asyncio.sleep(max(0.0, item[0] - time.monotonic()))
            writer.write(item[1])
            await writer.drain()
            word, numbers = mode()
            if word == "rate":
                await asyncio.sleep(len(item[1]) / numbers[0])

    await asyncio.gather(read(), write())


async def connection(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """One client until either end closes, or the mode resets it."""
    try:
        far_reader, far_writer = await asyncio.open_connection(*TARGET)
    except OSError:
        writer.close()
        return
    ways = [asyncio.create_task(carry(reader, far_writer)), asyncio.create_task(carry(far_reader, writer))]
    begin_s = time.monotonic()
    while not any(way.done() for way in ways):
        await asyncio.wait(ways, timeout=0.1, return_when=asyncio.FIRST_COMPLETED)
        word, numbers = mode()
        if word == "reset" and time.monotonic() - begin_s > numbers[0]:
            break
    for way in ways:
        way.cancel()
    await asyncio.gather(*ways, return_exceptions=True)
    for end in (writer, far_writer):
        abort(end)


def abort(writer: asyncio.StreamWriter) -> None:
    """Close with a reset."""
    end = writer.get_extra_info("socket")
    end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    writer.transport.abort()


async def main() -> None:
    """Serve until the container ends."""
    server = await asyncio.start_server(connection, "0.0.0.0", LISTEN_PORT)
    async with server:
        await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(main())
