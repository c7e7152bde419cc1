"""``lidario completion``: the script that completes verbs, options and sources in a shell.

The script calls ``lidario`` again with the variable ``_LIDARIO_COMPLETE`` set, and click answers. It is printed and
never installed: which file a shell reads is the user's choice.

For bash the script is one of ours: bash divides words at ``:`` and ``=`` (``COMP_WORDBREAKS``), and click's script
takes the pieces of ``sim://MODEL`` for several words. Where nothing is offered, each shell completes names of
files, so that a recording can be named: bash by ``-o default``, the others because they are told ``file``.
"""

import click
from click.shell_completion import get_completion_class

from lidario.cli.streams import emit, message

_HOW = {
    "bash": "lidario completion bash > ~/.local/share/bash-completion/completions/lidario",
    "zsh": "lidario completion zsh > ~/.zfunc/_lidario   with ~/.zfunc in fpath, before compinit",
    "fish": "lidario completion fish > ~/.config/fish/completions/lidario.fish",
}


_BASH = r"""_lidario_completion() {
    local IFS=$'\n' word whole left response line words=() number=-1 at
    for ((at = 0; at <= COMP_CWORD; at++)); do
        word=${COMP_WORDS[at]}
        if ((number > 0)) && [[ $word == [:=]* || ${words[number]} == *[:=] ]]; then
            words[number]+=$word
        else
            words+=("$word")
            number=$((number + 1))
        fi
    done
    whole=${words[number]}
    # What bash replaces is the last piece of the word, and nothing of it where that is a ":" or "=".
    left=${whole%"$word"}
    [[ -n $word && -z ${word//[:=]/} ]] && left=$whole
    response=$(COMP_WORDS="${words[*]}" COMP_CWORD=$number _LIDARIO_COMPLETE=bash_complete "$1")
    COMPREPLY=()
    for line in $response; do
        [[ $line == file,* ]] && continue
        line=${line#*,}
        COMPREPLY+=("${line#"$left"}")
    done
}

complete -o default -o nosort -F _lidario_completion lidario
"""


@click.command()
@click.argument("shell", type=click.Choice(list(_HOW)))
@click.pass_context
def completion(context: click.Context, shell: str) -> None:
    """Print the completion script of a shell: bash, zsh or fish."""
    if shell == "bash":
        emit(_BASH)
    else:
        kind = get_completion_class(shell)
        assert kind is not None
        emit(kind(context.find_root().command, {}, "lidario", "_LIDARIO_COMPLETE").source() + "\n")
    message(f"to keep it: {_HOW[shell]}")
