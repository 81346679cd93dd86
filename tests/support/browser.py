"""Headless Chromium, driven through its DevTools protocol as by a user of the page."""

import base64
import contextlib
import itertools
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

from tests.support import abilities
from tests.support.running import DEADLINE, eventually

_FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-default-apps",
    "--disable-dev-shm-usage", "--disable-extensions", "--mute-audio", "--disable-background-timer-throttling", "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows", "--hide-scrollbars",
    "--remote-debugging-port=0", "--remote-allow-origins=*", "about:blank",
)  # fmt: skip
DESKTOP, PHONE = (1100, 800), (390, 844)


class Browser:
    """Chromium process; each `Tab` is a window with its own size."""

    def __init__(self, folder: Path) -> None:
        name = abilities.browser()
        assert name is not None, abilities.ABILITIES["browser"].remedy
        self._folder = folder
        # Chromium's helper processes would survive a plain kill: the whole group is killed.
        self._popen = subprocess.Popen(
            [name, f"--user-data-dir={folder}", *_FLAGS],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self.address = eventually(self._address)

    def _address(self) -> str:
        assert self._popen.poll() is None, "Chromium ended at once"
        with contextlib.suppress(FileNotFoundError):
            port, _, path = (self._folder / "DevToolsActivePort").read_text().partition("\n")
            return f"ws://127.0.0.1:{port}{path.strip()}" if path else ""
        return ""

    def tab(self, url: str, size: tuple[int, int] = DESKTOP) -> "Tab":
        return Tab(self, url, size)

    def end(self) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._popen.pid, 9)
        self._popen.wait()


class Tab:
    """One page; `requests` has every requested address, `errors` the page's errors."""

    def __init__(self, browser: Browser, url: str, size: tuple[int, int]) -> None:
        self.requests: list[str] = []
        self.errors: list[str] = []
        self._numbers = itertools.count(1)
        self._open = contextlib.ExitStack()
        # Nobody reads between two commands, so nobody would see the browser's answer to a ping.
        self._socket = self._open.enter_context(
            connect(browser.address, max_size=None, ping_interval=None)
        )
        self._session = ""
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        attached = self._ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self._ask(f"{domain}.enable")
        width, height = size
        self._ask(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=size == PHONE,
        )  # fmt: skip
        self._target = target
        self.go(url)

    def go(self, url: str) -> None:
        self._ask("Page.navigate", url=url)

    def js(self, code: str) -> Any:
        """Return the value of an expression on the page."""
        answer = self._ask(
            "Runtime.evaluate", expression=code, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def front(self) -> None:
        """Bring the tab to the front: a hidden one draws nothing, and its notes never leave."""
        self._ask("Page.bringToFront")

    def text(self, selector: str) -> str:
        return str(self.js(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''"))

    def until(self, code: str, within: float = DEADLINE) -> Any:
        """Wait until an expression is true on the page, and return its value."""
        return eventually(lambda: self.js(code), within)

    def reads(self, selector: str, *parts: str, within: float = DEADLINE) -> str:
        """Wait until an element's text contains all the parts."""

        def read() -> str:
            text = self.text(selector)
            return text if all(part in text for part in parts) else ""

        try:
            return eventually(read, within)
        except AssertionError:
            raise AssertionError(f"{selector} is {self.text(selector)!r}, not {parts}") from None

    def click(self, x: float, y: float) -> None:
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self._ask(
                "Input.dispatchMouseEvent", type=kind, x=x, y=y, clickCount=1,
                button="none" if kind == "mouseMoved" else "left",
            )  # fmt: skip

    def press(self, selector: str) -> None:
        """Click in the middle of an element, as soon as it exists and is enabled."""
        find = f"""(() => {{ const e = document.querySelector({json.dumps(selector)});
            if (!e || e.ariaDisabled === "true") return null; e.scrollIntoView({{block: "center"}});
            const r = e.getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; }})()"""
        self.click(*self.until(find))

    def floor(self, x: float, y: float) -> None:
        """Click on the floor of the scene at x, y (m)."""
        self.js("document.querySelector('.scene').scrollIntoView({block: 'center'})")
        scene = "getElement(Number(document.querySelector('.scene').id.slice(1)))"
        self.click(*self.js(f"{scene}.where({x}, {y}, 0)"))

    def key(self, name: str) -> None:
        code = {"key": name, "code": name, "windowsVirtualKeyCode": 13 if name == "Enter" else 0}
        for kind in ("keyDown", "keyUp"):
            self._ask("Input.dispatchKeyEvent", type=kind, **code)

    def type(self, text: str) -> None:
        self._ask("Input.insertText", text=text)

    def picture(self, file: Path, *, whole: bool = False) -> None:
        shot = self._ask("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        file.write_bytes(base64.b64decode(shot["data"]))

    def close(self) -> None:
        session, self._session = self._session, ""
        if session:
            self._ask("Target.closeTarget", targetId=self._target)
            self._open.close()

    def _ask(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        self._socket.send(json.dumps(message))
        deadline = time.monotonic() + 30
        while True:
            answer = json.loads(self._socket.recv(timeout=max(deadline - time.monotonic(), 0)))
            if answer.get("id") == number:
                assert "error" not in answer, (method, answer["error"])
                found: dict[str, Any] = answer["result"]
                return found
            self._note(answer)

    def _note(self, event: dict[str, Any]) -> None:
        params = event.get("params", {})
        match event.get("method"):
            case "Network.requestWillBeSent":
                self.requests.append(params["request"]["url"])
            case "Network.webSocketCreated":
                self.requests.append(params["url"])
            case "Runtime.exceptionThrown":
                self.errors.append(str(params["exceptionDetails"]))
            case "Log.entryAdded" if params["entry"]["level"] == "error":
                self.errors.append(str(params["entry"]))


@contextlib.contextmanager
def browser() -> Iterator[Browser]:
    """Run a browser with an empty profile."""
    folder = Path(tempfile.mkdtemp(prefix="qb", dir="/tmp"))
    made = Browser(folder)
    try:
        yield made
    finally:
        made.end()
        shutil.rmtree(folder, ignore_errors=True)
