"""The command: its verbs, and the frame around them that maps every exception to an exit code."""

import sys
from collections.abc import Sequence
from typing import Any, TypeVar

import click
import rich  # noqa: F401  (imported here so that a missing package is reported before a verb starts)

from lidario import __version__
from lidario.cli.calibrate import calibrate
from lidario.cli.completion import completion
from lidario.cli.devices import devices, show
from lidario.cli.doctor import doctor
from lidario.cli.errors import ExitCode, exit_code, report
from lidario.cli.export import export
from lidario.cli.info import info
from lidario.cli.motor import motor
from lidario.cli.play import play
from lidario.cli.plot import plot
from lidario.cli.publish import publish
from lidario.cli.record import record
from lidario.cli.report import report_lidar
from lidario.cli.router import router
from lidario.cli.running import log_told
from lidario.cli.scan import scan
from lidario.cli.settings import Settings
from lidario.cli.sim import sim
from lidario.cli.stats import stats
from lidario.cli.streams import emit
from lidario.cli.udev import udev
from lidario.cli.view import view
from lidario.cli.watch import watch

CommandT = TypeVar("CommandT", bound=click.Command)


class Lidario(click.Group):
    """A click group whose errors are reported by `lidario.cli.errors`."""

    def run(self, arguments: Sequence[str]) -> int:
        """Run the verb that `arguments` name; returns its exit code, 0 where it returns none.

        An `ImportError` leaves it: who calls this tells of packages that cannot be loaded, now or before.
        """
        settings = Settings()
        try:
            with log_told():
                result = super().main(list(arguments), "lidario", standalone_mode=False, obj=settings)
            code = result if isinstance(result, int) else ExitCode.OK
        except ImportError:
            raise
        except (Exception, KeyboardInterrupt) as error:
            report(error, with_traceback=settings.traceback)
            code = exit_code(error)
        return int(code)

    def main(self, args: Sequence[str] | None = None, *_: object, **__: object) -> Any:
        """As `click.Command.main`, with our errors and exit codes."""
        sys.exit(self.run(sys.argv[1:] if args is None else args))


def _set_traceback(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    context.ensure_object(Settings).traceback |= wanted


def _show(context: click.Context, option: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        emit((context.get_help() if option.name == "help" else f"lidario {__version__}") + "\n")
        context.exit()


_COMMON_OPTIONS = (
    click.option("--traceback", is_flag=True, expose_value=False, is_eager=True, callback=_set_traceback,
                 help="Show where an error comes from."),
    click.option("-h", "--help", is_flag=True, expose_value=False, is_eager=True, callback=_show,
                 help="Show this message and exit."),
)  # fmt: skip


def _with_common_options(command: CommandT) -> CommandT:
    """Accept `--traceback` and `--help` after any verb as well as before it.

    click's own `--help` does not tell a stdout that cannot be written from a mistake of ours.
    """
    for option in _COMMON_OPTIONS:
        option(command)
    return command


@_with_common_options
@click.group(cls=Lidario, invoke_without_command=True)
@click.option("--version", is_flag=True, expose_value=False, is_eager=True, callback=_show,
              help="Show the version and exit.")  # fmt: skip
@click.pass_context
def cli(context: click.Context) -> int | None:
    """2D laser scanners: find them, ask them, read their scans, or simulate one.

    Without a verb: lists the lidars that are plugged in, and what to type next.

    A SOURCE is a serial port (/dev/ttyUSB0, COM3), tcp://host:port, udp://host:port (an Ethernet model),
    id:SERIAL (the lidar's own serial number), a simulator (sim://MODEL?world=room&fault=drop:1%; `lidario sim
    --list` names the models), a recording (run.mcap, raw.bin; run.mcap?rate=10&loop=1), another machine's lidar
    (zenoh:KEY), or auto, which is the default: the only lidar that responds.
    """
    return show((), as_json=False, next_steps=True) if context.invoked_subcommand is None else None


_VERBS: tuple[click.Command, ...] = (
    devices, info, scan, view, watch, plot, stats, record, play, export, publish, router, doctor, report_lidar,
    calibrate, udev, motor, sim, completion,
)  # fmt: skip

for _verb in _VERBS:
    cli.add_command(_with_common_options(_verb))
    for _part in _verb.commands.values() if isinstance(_verb, click.Group) else ():
        _with_common_options(_part)
