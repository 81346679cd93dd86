"""Terminal of the tests: a pty and its visible screen."""

import contextlib
import os
import pty
import re
import select
import signal
import struct
import termios
import time
from collections.abc import Callable
from fcntl import ioctl
from pathlib import Path

from tests.support.running import DEADLINE

_CONTROL = re.compile(r"\033\[(\?)?([0-9;]*)([A-Za-z])")


class Glass:
    """Screen of a terminal that knows the few control codes of our output."""

    def __init__(self) -> None:
        self.lines = [""]
        self._row = self._column = 0
        self._text = ""

    @property
    def seen(self) -> str:
        return "\n".join(line.rstrip() for line in self.lines)

    def feed(self, text: str) -> None:
        self._text += text
        while self._text:
            if self._text[0] == "\033":
                control = _CONTROL.match(self._text)
                if control is None:
                    return  # the rest has not arrived yet
                self._obey(control[2], control[3])
                self._text = self._text[control.end() :]
            else:
                self._put(self._text[0])
                self._text = self._text[1:]

    def _obey(self, number: str, letter: str) -> None:
        if letter == "A":
            self._row = max(self._row - int(number or 1), 0)
        elif letter == "K":
            self.lines[self._row] = self.lines[self._row][: self._column]
        elif letter == "J":
            self.lines[self._row] = self.lines[self._row][: self._column]
            del self.lines[self._row + 1 :]
        else:
            assert letter == "m", f"an unknown control: {number}{letter}"

    def _put(self, char: str) -> None:
        if char == "\r":
            self._column = 0
        elif char == "\n":
            self._row += 1
            self.lines += [""] * (self._row + 1 - len(self.lines))
        else:
            line = self.lines[self._row].ljust(self._column)
            self.lines[self._row] = line[: self._column] + char + line[self._column + 1 :]
            self._column += 1


class Terminal:
    """Terminal that runs a command in a pty with its own session."""

    def __init__(
        self, command: list[str], environment: dict[str, str], folder: Path, columns: int = 100
    ) -> None:
        self.glass, self.raw = Glass(), ""
        self.pid, self._fd = pty.fork()
        if self.pid == 0:
            os.chdir(folder)
            os.execvpe(command[0], command, environment)
        self.resize(columns)

    def resize(self, columns: int) -> None:
        """Set the width, with 40 rows; the screen's contents are kept."""
        ioctl(self._fd, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))

    def press(self, keys: str) -> None:
        os.write(self._fd, keys.encode())

    @property
    def screen(self) -> str:
        """Return the screen's text, including lines scrolled away."""
        return self.glass.seen

    def echoes(self) -> bool:
        """Return whether pressed keys are echoed."""
        return bool(termios.tcgetattr(self._fd)[3] & termios.ECHO)

    def until(self, condition: Callable[[str], object], within: float = DEADLINE) -> str:
        """Wait until the screen meets a condition, and return its text."""
        deadline = time.monotonic() + within
        while not condition(self.screen):
            left = deadline - time.monotonic()
            assert left > 0, f"not in {within:g} s:\n{self.screen}"
            self._read(left)
        return self.screen

    def wait(self, within: float = DEADLINE) -> int:
        """Wait for the end of the command and its output, and return the exit code."""
        deadline = time.monotonic() + within
        while self._read(deadline - time.monotonic()):
            assert time.monotonic() < deadline, self.screen
        _, status = os.waitpid(self.pid, 0)
        self.pid = 0
        return os.waitstatus_to_exitcode(status)

    def close(self) -> None:
        if self.pid:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
        os.close(self._fd)

    def _read(self, timeout: float) -> bool:
        if select.select([self._fd], [], [], max(timeout, 0))[0]:
            # On Linux, the end of a pty is an error.
            with contextlib.suppress(OSError):
                if chunk := os.read(self._fd, 1 << 16):
                    self.raw += chunk.decode(errors="replace")
                    self.glass.feed(chunk.decode(errors="replace"))
                    return True
            return False
        return True
