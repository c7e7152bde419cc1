"""``lidario completion``, and what a shell is told when it asks."""

import pytest
from click.shell_completion import get_completion_class

from lidario.cli.main import cli
from tests.cli.processes import invoke


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_each_shell(shell: str) -> None:
    ended = invoke("completion", shell, code=0)
    assert f"_LIDARIO_COMPLETE={shell}_complete" in ended.stdout
    assert "lidario completion" in ended.stderr


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("lidario ", {"devices", "stats", "doctor", "motor", "completion"}),
        ("lidario st", {"stats"}),
        ("lidario motor ", {"start", "stop", "speed"}),
        ("lidario stats --", {"--json", "--mode", "--time"}),
        ("lidario stats sim://rplidar-s", {"sim://rplidar-s1", "sim://rplidar-s2", "sim://rplidar-s3"}),
        ("lidario doctor au", {"auto"}),
        ("lidario scan au", {"auto"}),
        ("lidario info au", {"auto"}),
        ("lidario record au", {"auto"}),
    ],
)
def test_what_is_offered(words: str, offered: set[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(words.count(" ")))
    shell = get_completion_class("bash")
    assert shell is not None
    told = shell(cli, {}, "lidario", "_LIDARIO_COMPLETE").complete()
    assert offered <= {line.partition(",")[2] for line in told.splitlines()}
