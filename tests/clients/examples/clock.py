"""The clock by which the examples wait: the vehicle's, which a test serves at port CLOCK, or the wall's."""

import asyncio
import os
import socket
import time

PORT = int(os.environ.get("CLOCK", "0"))


def after(seconds):
    """The time when so many seconds have passed."""
    if not PORT:
        time.sleep(seconds)
        return time.monotonic()
    with socket.create_connection(("127.0.0.1", PORT)) as link, link.makefile("rw") as lines:
        lines.write(f"{seconds}\n")
        lines.flush()
        return float(lines.readline())


def now():
    return after(0.0)


def wait(seconds):
    after(seconds)


async def wait_async(seconds):
    await asyncio.to_thread(after, seconds)
