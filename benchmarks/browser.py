"""A headless Chromium that is driven as a person would: keys, wheel, pointer, and a look at what is drawn.

It is spoken to by the DevTools protocol (https://chromedevtools.github.io/devtools-protocol/) over websockets, so
that nothing is needed but the browser itself. The tests of the page, its benchmark and the pictures of the README
use it.
"""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self
from urllib.request import Request, urlopen

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

NAMES: Final = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE_S: Final = 30.0
POLL_S: Final = 0.02
_KEYS: Final = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Tab": 9}


def find_browser() -> str | None:
    """Path of a Chromium on this machine, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """A browser with an empty profile; a context manager.

    Attributes:
        downloads: Folder in which saved files arrive.
    """

    def __init__(self) -> None:
        self._program = find_browser() or NAMES[0]
        self._profile = tempfile.TemporaryDirectory(prefix="lidario-browser-", ignore_cleanup_errors=True)
        self.downloads: Path = Path(self._profile.name) / "downloads"
        self._process: subprocess.Popen[bytes] | None = None
        self._pages: list[Page] = []
        self._address = ""

    def __enter__(self) -> Self:
        self.downloads.mkdir()
        self._process = subprocess.Popen(
            [self._program, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
             "--disable-background-networking", "--disable-component-update", "--disable-sync",
             "--disable-dev-shm-usage", "--hide-scrollbars", "--remote-debugging-port=0",
             f"--user-data-dir={self._profile.name}", "about:blank"],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        port = Path(self._profile.name) / "DevToolsActivePort"
        deadline = time.monotonic() + PATIENCE_S
        while not (port.is_file() and "\n" in port.read_text()):
            if self._process.poll() is not None or time.monotonic() > deadline:
                self.close()
                raise RuntimeError(f"{self._program} did not start")
            time.sleep(POLL_S)
        self._address = f"127.0.0.1:{port.read_text().splitlines()[0]}"
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the browser and remove its profile."""
        for page in self._pages:
            page.close()
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        self._profile.cleanup()

    def open(
        self, url: str, *, width: int = 1100, height: int = 700, dark: bool = False, phone: bool = False
    ) -> Page:
        """Open `url` in a new tab."""
        with urlopen(
            Request(f"http://{self._address}/json/new?about:blank", method="PUT"), timeout=PATIENCE_S
        ) as got:
            socket = json.load(got)["webSocketDebuggerUrl"]
        page = Page(socket)
        self._pages.append(page)
        page.call("Page.enable")
        page.call("Runtime.enable")
        page.call("Log.enable")
        page.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(self.downloads))
        page.resize(width, height, phone=phone)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        page.call("Emulation.setEmulatedMedia", features=[scheme])
        page.call("Page.navigate", url=url)
        page.until("document.readyState === 'complete'")
        return page


class Page:
    """A tab.

    Attributes:
        complaints: What the page wrote to the console as an error, and exceptions that nothing caught.
    """

    def __init__(self, address: str) -> None:
        self.complaints: list[str] = []
        self._held = ExitStack()
        self._socket = self._held.enter_context(connect(address, max_size=None, compression=None))
        self._number = 0
        self._closed = False

    def close(self) -> None:
        """Close the tab; harmless when done before."""
        if not self._closed:
            self._closed = True
            with suppress(ConnectionClosed):
                self.call("Page.close")
            self._held.close()

    def call(self, method: str, **arguments: Any) -> dict[str, Any]:
        """Call a method of the protocol, and return its result.

        Raises:
            RuntimeError: It failed.
        """
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": arguments}))
        while True:
            heard = json.loads(self._socket.recv(PATIENCE_S))
            if heard.get("id") == self._number:
                if "error" in heard:
                    raise RuntimeError(f"{method}: {heard['error']['message']}")
                result: dict[str, Any] = heard["result"]
                return result
            self._note(heard)

    def _note(self, event: dict[str, Any]) -> None:
        if event.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(event["params"]["exceptionDetails"]))
        elif event.get("method") == "Log.entryAdded" and event["params"]["entry"]["level"] == "error":
            self.complaints.append(event["params"]["entry"]["text"])

    def ask(self, expression: str) -> Any:
        """The value of a JavaScript expression; a promise is awaited.

        Raises:
            RuntimeError: It throws.
        """
        told = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in told:
            raise RuntimeError(f"{expression}: {told['exceptionDetails']}")
        return told["result"].get("value")

    def until(self, expression: str, patience_s: float = PATIENCE_S) -> Any:
        """Wait until an expression is true; returns its value.

        Raises:
            TimeoutError: It never was; says what the page shows.
        """
        deadline = time.monotonic() + patience_s
        while not (value := self.ask(expression)):
            if time.monotonic() > deadline:
                raise TimeoutError(
                    f"never true: {expression}; the page says {self.ask('document.body.innerText')!r}"
                )
            time.sleep(POLL_S)
        return value

    def resize(self, width: int, height: int, *, phone: bool = False) -> None:
        """Give the tab another size."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=2 if phone else 1, mobile=phone,
        )  # fmt: skip

    def key(self, key: str) -> None:
        """Press and release a key, as in ``KeyboardEvent.key``."""
        text = key if len(key) == 1 else ""
        code = _KEYS.get(key, ord(key[0].upper()))
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, text=text, windowsVirtualKeyCode=code)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, windowsVirtualKeyCode=code)

    def wheel(self, x: float, y: float, down: float) -> None:
        """Turn the wheel over a point."""
        self.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=down)

    def move(self, x: float, y: float) -> None:
        """Move the pointer to a point, with no button held."""
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, buttons=0)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press at a point, move to another, release."""
        for kind, (x, y) in (("mousePressed", start), ("mouseMoved", end), ("mouseReleased", end)):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def click(self, selector: str) -> None:
        """Click into the middle of an element."""
        box = self.ask(f"(({selector!r}), (r => [r.x + r.width / 2, r.y + r.height / 2])"
                       f"(document.querySelector({selector!r}).getBoundingClientRect()))")  # fmt: skip
        self.drag((box[0], box[1]), (box[0], box[1]))

    def text(self) -> str:
        """All words that the page shows."""
        return str(self.ask("document.body.innerText"))

    def picture(self) -> bytes:
        """What the tab looks like, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
