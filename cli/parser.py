"""Parser of a command line, from the declarations of the commands.

Importing Typer takes 45 ms, more than all that `quadctl status` does. A line means what it means to
Typer, except that a word such as `-1` is a number where a command takes numbers.
"""

from collections.abc import Callable
from typing import Any

from quadctl.cli import commands, output
from quadctl.cli.declarations import Parameter, ParsedCommand, is_number, takes_signed
from quadctl.services.runtime.errors import UsageError

_ACTIONS = {"help", "version", "install_completion", "show_completion"}
"""Options that are carried out in place of a command."""


def read(words: list[str]) -> ParsedCommand:
    """Return a parsed line; raise UsageError, or SystemExit after help, version or completion."""
    line, path = [*words], ""
    common: dict[str, Any] = {}
    while True:
        level = _Level(path, line)
        for name in level.given:
            if name in _ACTIONS:
                _act(path, name, as_json="json" in level.given)
        common |= {
            word.name: level.value(word)
            for word in commands.COMMON_WORDS
            if word.name in level.given
        }
        if level.is_command:
            return ParsedCommand(commands.command(path), common, level.own_values())
        if not path and level.placed == ["help"]:
            line = [*(text for text in line if not text.startswith("-")), "--help"]
        elif level.placed:
            path = level.inner_path()
        elif common.get("json"):
            raise level.refused("Missing command.")
        else:
            _print_help(path, output.note)
            raise SystemExit(2)


def _act(path: str, name: str, *, as_json: bool) -> None:
    if name == "help":
        _print_help(path, output.line)
    elif name == "version":
        from importlib.metadata import version

        found = version("quadctl")
        output.document({"version": found}) if as_json else output.line(f"quadctl {found}")
    else:
        from quadctl.cli.completion import installation

        installation.show() if name == "show_completion" else installation.install()
    raise SystemExit


def _print_help(path: str, write: Callable[[str], None]) -> None:
    from quadctl.cli.help_pages import page

    write(page(path))


class _Level:
    """Words of a line that belong to one command or group."""

    def __init__(self, path: str, line: list[str]) -> None:
        """Take the words from a line; raise UsageError for an unknown option."""
        self._path, self._command = path, f"quadctl {path}".rstrip()
        self.is_command = path in commands.COMMANDS
        self.given: dict[str, list[str]] = {}  # texts of the options, by the name of the word
        self.placed: list[str] = []  # a command's other words, or the name of what a group has
        self._words = commands.words_at(path)
        self._named = {name: word for word in self._words if word.is_option for name in word.names}
        self._take(line)

    def _take(self, line: list[str]) -> None:
        signed, ended = takes_signed(self._words), False
        while line and (self.is_command or not self.placed):
            text = line.pop(0)
            is_value = signed and is_number(text) and text[:2] not in self._named
            if ended or is_value or text[:1] != "-" or text == "-":
                self.placed.append(text)
            elif text == "--":
                ended = True
            else:
                self._take_options(text, line)

    def _take_options(self, text: str, line: list[str]) -> None:
        """Take the options of one word, with values from it or from the line."""
        name, joined, value = text.partition("=")
        if text[1] != "-":
            name, joined, value = text[:2], text[2:], text[2:]
            while value and name in self._named and self._named[name].type is bool:
                self._give(self._named[name], [""])  # -dn3 means -d -n 3
                name, joined, value = f"-{value[0]}", value[1:], value[1:]
        if name not in self._named:
            raise self._unknown(name)
        word = self._named[name]
        if word.type is bool:
            if joined:
                raise self.refused(f"Option '{name}' does not take a value.")
            line.insert(0, "")
        elif joined or word.is_left_out(line):
            line.insert(0, value)
        if len(line) < word.count:
            many = "an argument" if word.count == 1 else f"{word.count} arguments"
            raise self.refused(f"Option '{name}' requires {many}.")
        self._give(word, line[: word.count])
        del line[: word.count]

    def _give(self, word: Parameter, texts: list[str]) -> None:
        self.given.setdefault(word.name, []).extend(texts)

    def inner_path(self) -> str:
        """Return the path of the command or group that the last word names; raise UsageError."""
        (name,), known = self.placed, commands.inside(self._path)
        if name in known:
            return known[name]
        from difflib import get_close_matches

        from quadctl.cli.habits import instead

        hint = instead(f"{self._path} {name}".lstrip())
        alike = [] if hint else get_close_matches(name, known)
        more = f" Did you mean {', '.join(map(repr, alike))}?" if alike else ""
        raise self.refused(f"No such command '{name}'.{more}", hint)

    def own_values(self) -> dict[str, Any]:
        """Return the values of the command's own words; raise UsageError."""
        own = self._words[: -len(commands.COMMON_WORDS) - 1]
        for word in own:
            if not word.is_option:
                count = len(self.placed) if word.many else 1
                self._give(word, self.placed[:count])
                del self.placed[:count]
        values = {word.name: self.value(word) for word in own}
        if self.placed:
            raise self.refused(f"Got unexpected extra argument(s) ({' '.join(self.placed)})")
        return values

    def value(self, word: Parameter) -> Any:
        """Return the value of a word, in its type; raise UsageError."""
        texts = self.given.get(word.name)
        if not texts:
            if word.required:
                raise self.refused(f"Missing argument '{word.placeholder}'.")
            return word.default
        if word.type is bool:
            return True
        values = [self._converted(word, text) for text in texts[0 if word.many else -word.count :]]
        if word.many:
            return values
        return tuple(values) if word.count > 1 else values[0]

    def _converted(self, word: Parameter, text: str) -> Any:
        names = word.names if word.is_option else (word.placeholder,)
        wrong = f"Invalid value for {' / '.join(map(repr, names))}"
        has_separator = "_" in text and word.type in {int, float}  # as 1_0, to Python ten
        try:
            value = word.type("" if has_separator else text)
        except ValueError as error:
            from quadctl.cli.habits import instead_of_number

            problem = f"{wrong}: '{text}' is not a valid {word.type.__name__}."
            raise self.refused(problem, instead_of_number(self._path, text)) from error
        least = getattr(word.declaration, "min", None)
        if least is not None and value < least:
            raise self.refused(f"{wrong}: {value} is not in the range x>={least}.")
        return value

    def refused(self, message: str, hint: str = "") -> UsageError:
        """Return the error for a line; the default hint names the help."""
        return UsageError(message, hint or f"`{self._command} --help`")

    def _unknown(self, name: str) -> UsageError:
        from difflib import get_close_matches

        from quadctl.cli.habits import instead_of_option

        alike = get_close_matches(name, [known for known in self._named if known[1] == "-"])
        more = f" (Possible options: {', '.join(sorted(alike))})" if alike else ""
        hint = instead_of_option(self._path, name)
        if not hint and takes_signed(self._words):
            hint = f"`{self._command} --help`; a word after -- is never an option"
        return self.refused(f"No such option: {name}{more}", hint)
