"""Script of the shell in use: the one that runs the command, else the user's own."""

import pytest
import shellingham

from quadctl.cli.completion import installation
from quadctl.services.runtime.errors import QuadctlError


@pytest.mark.parametrize(
    ("running", "own", "begins"),
    [
        ("zsh", "/bin/bash", "#compdef quadctl"),
        ("sh", "/usr/bin/fish", "complete --command quadctl"),
        (shellingham.ShellDetectionFailure(), "/bin/bash", "_quadctl_completion()"),
        (OSError("ps not found"), "/bin/bash", "_quadctl_completion()"),
        ("sh", "", "there is no completion for your shell"),
        ("sh", "/bin/tcsh", "there is no completion for tcsh"),
    ],
)
def test_the_shell_is_detected_or_the_users_own(
    running: str | Exception, own: str, begins: str,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
):  # fmt: skip
    def detect() -> tuple[str, str]:
        if isinstance(running, str):
            return running, f"/bin/{running}"
        raise running

    monkeypatch.setattr(shellingham, "detect_shell", detect)
    monkeypatch.setenv("SHELL", own)
    if begins.startswith("there is no"):
        with pytest.raises(QuadctlError, match=begins) as refused:
            installation.show()
        assert "bash, fish" in refused.value.hint
    else:
        installation.show()
        assert capsys.readouterr().out.startswith(begins)


def test_a_script_is_printed_for_a_shell_by_name(capsys: pytest.CaptureFixture[str]):
    installation.show("zsh")
    assert capsys.readouterr().out.startswith("#compdef quadctl")
    with pytest.raises(QuadctlError, match="no completion for tcsh"):
        installation.show("tcsh")
