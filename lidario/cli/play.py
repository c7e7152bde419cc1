"""``lidario play``: a recording as a device for any driver, on a pseudo-terminal or a TCP port.

The only line on stdout is what a client opens. It ends with the recording, or with Ctrl-C.
"""

import asyncio
from collections import Counter
from pathlib import Path

import click

from lidario.cli.parameters import FiniteRange, complete_file
from lidario.cli.running import run_until_stopped
from lidario.cli.sim import announce, pty_option, server_of, tcp_option
from lidario.cli.streams import message

POLL_S = 0.1
LINGER_S = 0.5
"""After the last byte, so that a client has read it."""


@click.command()
@click.argument("file", shell_complete=complete_file)
@click.option("--rate", type=FiniteRange(min=0.001, max=1000), default=1.0, show_default=True,
              metavar="FACTOR", help="How many times as fast as it was recorded.")  # fmt: skip
@click.option("--loop", is_flag=True, help="Begin anew at the end.")
@pty_option
@tcp_option
def play(file: str, rate: float, loop: bool, pty: bool, tcp: str | None) -> None:
    """Play a recording as a device, for any driver.

    It responds as the recorded device had responded, and scans when it is asked to in the same way.
    """
    from lidario.recording.files import FileSource, file_source, open_stored
    from lidario.recording.played import PlayedDevice

    if pty and tcp is not None:
        raise click.UsageError("--pty and --tcp exclude each other")
    source = file_source(file) or FileSource(Path(file))
    if source.played:
        raise click.BadParameter(f"{source.played[0]}= means nothing here: --rate and --loop do", param_hint="FILE")
    recording = open_stored(source.path, source.known)
    if not recording.responses:
        message("note: the recording holds no responses, so a driver that asks what the device is gets none")
    device = PlayedDevice(recording, rate=rate, loop=loop)
    server = server_of(device, pty=pty, tcp=tcp)
    speed = f" at {device.baudrate} baud" if device.baudrate else ""

    async def work() -> None:
        await announce(server, f"{file}{speed}, until its end or Ctrl-C")
        while not device.finished:  # noqa: ASYNC110 - the server is a thread, and has no event to await
            await asyncio.sleep(POLL_S)
        await asyncio.sleep(LINGER_S)

    with server:
        if run_until_stopped(work):
            if device.error is not None:
                raise device.error
            message("the recording is at its end")
    for (name, why), count in Counter((each.name, each.why) for each in device.log if not each.obeyed).items():
        message(f"  no response to {name} ({count}): {why}")
