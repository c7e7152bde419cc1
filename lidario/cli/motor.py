"""``lidario motor``: let the rotor turn, stop it, or choose its speed.

No request only turns the rotor on every device: some start it with the laser. So the verb starts a stream, waits
until the speed is measured, and ends the stream with the motor left on. A device whose motor stops with its laser
cannot do that. There ``start`` is refused, and ``speed`` sets what the next stream will have. Where that fails, or
is ended by a signal, laser and motor are off.
"""

from __future__ import annotations

from contextlib import suppress

import click

import lidario
from lidario.cli.output import dump, in_both_units
from lidario.cli.parameters import FiniteRange, json_option, source_argument
from lidario.cli.running import run
from lidario.cli.streams import emit


@click.group()
def motor() -> None:
    """Start or stop the motor, or set its speed."""


@motor.command()
@source_argument
@json_option
def start(source: str, as_json: bool) -> None:
    """Let the rotor turn, with the laser off."""
    _run(source, None, as_json)


@motor.command()
@source_argument
@json_option
def stop(source: str, as_json: bool) -> None:
    """Stop laser and motor, whatever an earlier program left running."""
    _refuse_motorless(source)
    _tell(as_json, run(lambda: _stop(source), f"stopping {source} …"), None)


@motor.command()
@click.argument("hertz", metavar="HZ", type=FiniteRange(min=0, min_open=True))
@source_argument
@json_option
def speed(hertz: float, source: str, as_json: bool) -> None:
    """Let the rotor turn at HZ revolutions a second.

    A device whose motor stops with its laser takes the speed when it scans next.
    """
    _run(source, hertz, as_json)


def _run(source: str, hertz: float | None, as_json: bool) -> None:
    _refuse_motorless(source)
    state, measured = run(lambda: _turn(source, hertz), "waiting for the rotor …")
    _tell(as_json, state, measured)


def _refuse_motorless(source: str) -> None:
    from lidario.recording.files import file_source

    if file_source(source) is not None:
        raise lidario.Unsupported("a recording has no motor")
    if source.startswith("zenoh:"):
        raise lidario.Unsupported(
            "the motor of another machine's lidar cannot be switched from here: its publisher drives it"
        )


def _tell(as_json: bool, state: str, hertz: float | None) -> None:
    if as_json:
        dump({"motor": state, "hertz": None if hertz is None else round(hertz, 3)})
    elif state == "turning":
        emit("the motor turns" + (f" at {in_both_units(hertz)}\n" if hertz is not None else "\n"))
    elif state == "set" and hertz is not None:
        emit(f"{in_both_units(hertz)} is set; the motor of this device turns only while it scans\n")
    elif state == "unstoppable":
        emit("the laser is off; the motor of this device turns while it has power\n")
    else:
        emit("laser and motor are off\n")


async def _turn(source: str, hertz: float | None) -> tuple[str, float | None]:
    """Returns what was done, and the speed in revolutions a second."""
    is_open = False
    try:
        async with lidario.open_lidar(source, keep_spinning=True) as lidar:
            is_open = True
            try:
                return "turning", await _speed_up(lidar, hertz)
            except BaseException:
                # Also behind Ctrl-C: what the verb does not bring about, it leaves still.
                with suppress(lidario.LidarError):
                    await lidar.stop(motor=True)
                raise
    except lidario.Unsupported as error:
        if is_open:
            raise
        if hertz is None:
            raise lidario.Unsupported(
                f"the motor of this lidar stops with its laser: `lidario scan -n 0 {source}` runs both until Ctrl-C"
            ) from error
    async with lidario.open_lidar(source) as lidar:
        return "set", await lidar.set_scan_frequency(hertz)


async def _speed_up(lidar: lidario.Lidar, hertz: float | None) -> float | None:
    """Let the rotor turn; returns the measured speed in revolutions a second."""
    async with lidar.scans() as scans:
        await anext(scans)
        if hertz is not None:
            await lidar.set_scan_frequency(hertz)
        return lidar.measured_scan_frequency


async def _stop(source: str) -> str:
    """Open and close: a session that ends writes the requests that stop laser and motor. Returns what was done."""
    async with lidario.open_lidar(source) as lidar:
        if not lidar.can_be_stopped:
            # The session has said why, when it was opened.
            raise lidario.Unsupported("nothing was stopped: the device only talks")
        await lidar.stop()
        return "stopped" if lidar.motor_can_be_stopped else "unstoppable"
