"""``lidario completion``: the script that completes verbs, options and sources in a shell.

The script calls ``lidario`` again with the variable ``_LIDARIO_COMPLETE`` set, and click answers. It is printed and
never installed: which file a shell reads is the user's choice.
"""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from lidario.cli.errors import ExitCode
from lidario.cli.output import emit, message

__all__ = ["completion"]

_HOW = {
    "bash": "lidario completion bash > ~/.local/share/bash-completion/completions/lidario",
    "zsh": "lidario completion zsh > ~/.zfunc/_lidario   with ~/.zfunc in fpath, before compinit",
    "fish": "lidario completion fish > ~/.config/fish/completions/lidario.fish",
}


@click.command()
@click.argument("shell", type=click.Choice(list(_HOW)))
@click.pass_context
def completion(context: click.Context, shell: str) -> int:
    """Print the completion script of a shell: bash, zsh or fish."""
    kind = get_completion_class(shell)
    assert kind is not None
    script = kind(context.find_root().command, {}, "lidario", "_LIDARIO_COMPLETE")
    # Not script.source(): for bash that runs a bash to ask for its version.
    emit(script.source_template % script.source_vars() + "\n")
    message(f"to keep it: {_HOW[shell]}")
    return ExitCode.OK
