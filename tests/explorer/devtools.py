"""Headless Chromium, driven through its DevTools over a pipe: no server, no port, no driver to install."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from pmjoint_codegen.dossier.browser import QUIET

FLAGS: Final = (*QUIET, "--no-sandbox", "--remote-debugging-pipe")
HIGH: Final = 10  # file descriptors below it may be those that the shell moves
PATIENCE_S: Final = 30.0
KEYS: Final = {  # key -> its code for Windows, by which Chromium knows keys without text
    "Tab": 9,
    "Enter": 13,
    "Escape": 27,
    " ": 32,
    "PageUp": 33,
    "PageDown": 34,
    "End": 35,
    "Home": 36,
    "ArrowLeft": 37,
    "ArrowUp": 38,
    "ArrowRight": 39,
    "ArrowDown": 40,
}
TYPED: Final = {"Enter": "\r", " ": " "}
SHIFT: Final = 8


class Browser:
    """A running Chromium; messages are JSON that ends in a zero byte, on descriptors 3 and 4."""

    def __init__(self, requests: int, answers: int) -> None:
        self._requests, self._answers = requests, answers
        self._rest = b""
        self._asked = 0
        os.set_blocking(answers, False)

    def call(self, method: str, session: str | None = None, **params: Any) -> dict[str, Any]:
        """Send a command and give its result; events in between are dropped."""
        self._asked += 1
        asked = self._asked
        message = {"id": asked, "method": method, "params": params}
        if session is not None:
            message["sessionId"] = session
        os.write(self._requests, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + PATIENCE_S
        while time.monotonic() < until:
            for answer in self._received():
                if answer.get("id") == asked:
                    assert "error" not in answer, (method, answer["error"])
                    result: dict[str, Any] = answer["result"]
                    return result
            time.sleep(0.002)
        raise AssertionError(f"{method}: no answer within {PATIENCE_S} s")

    def _received(self) -> Iterator[dict[str, Any]]:
        try:
            while part := os.read(self._answers, 1 << 20):
                self._rest += part
        except BlockingIOError:
            pass
        *whole, self._rest = self._rest.split(b"\0")
        yield from map(json.loads, whole)

    def open(self, address: str, **screen: Any) -> Tab:
        """A new tab that shows an address, on a screen as `Tab.screen` takes it."""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        tab = Tab(self, target, session)
        if screen:
            tab.screen(**screen)
        tab.go(address)
        return tab


class Tab:
    """One page of a browser."""

    def __init__(self, browser: Browser, target: str, session: str) -> None:
        self.browser, self.target, self.session = browser, target, session

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        return self.browser.call(method, self.session, **params)

    def go(self, address: str) -> None:
        """Show an address, and wait until its explorer is ready."""
        self.call("Page.enable")
        self.call("Page.navigate", url=address)
        self.evaluate(
            "new Promise(done => { const look = () => document.documentElement?.dataset.ready"
            " ? done() : setTimeout(look, 5); look(); })"
        )

    def evaluate(self, expression: str) -> Any:
        """The value of an expression of JavaScript, as JSON; a promise is waited for."""
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def screen(self, width: int, height: int, *, phone: bool = False) -> None:
        """Give it a screen, px; a phone's has two device pixels for one of the page."""
        ratio = 2 if phone else 1
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=ratio,
            mobile=phone,
        )
        self.call("Emulation.setTouchEmulationEnabled", enabled=phone)

    def prefer(self, preferences: Mapping[str, str]) -> None:
        """Media features, such as ``{"prefers-color-scheme": "dark"}``."""
        features = [{"name": name, "value": value} for name, value in preferences.items()]
        self.call("Emulation.setEmulatedMedia", features=features)
        self.frame()

    def press(self, key: str, *, shift: bool = False) -> None:
        """Press and release a key of `KEYS`, and wait for a frame."""
        self.strike(key, shift=shift)
        self.frame()

    def strike(self, key: str, *, shift: bool = False) -> None:
        """Press and release a key, no more."""
        text = {"text": TYPED[key]} if key in TYPED else {}
        common = {"key": key, "code": key, "windowsVirtualKeyCode": KEYS[key], "modifiers": SHIFT * shift}
        self.call("Input.dispatchKeyEvent", type="keyDown", **common, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", **common)

    def mouse(self, kind: str, x: float, y: float, *, held: bool = False) -> None:
        """A mouse event such as ``mouseMoved`` at a place of the window, px."""
        button = {"button": "left", "buttons": 1, "clickCount": 1} if held else {}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **button)

    def frame(self) -> None:
        """Wait until what changed is drawn."""
        self.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done())))")

    def tree(self) -> list[dict[str, Any]]:
        """What a screen reader sees: nodes with role, name and properties; ignored ones are left out."""
        nodes = self.call("Accessibility.getFullAXTree")["nodes"]
        return [node for node in nodes if not node["ignored"]]

    def picture(self, file: Path, *, whole: bool = False) -> None:
        """Write what it shows as PNG; `whole` is the page beyond the screen too."""
        metrics = self.call("Page.getLayoutMetrics")
        area = metrics["cssContentSize" if whole else "cssVisualViewport"]
        places = ("x", "y") if whole else ("pageX", "pageY")
        sizes = ("width", "height") if whole else ("clientWidth", "clientHeight")
        keys = ("x", "y", "width", "height")
        clip = {key: area[name] for key, name in zip(keys, (*places, *sizes), strict=True)} | {"scale": 1}
        shot = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)
        file.write_bytes(base64.b64decode(shot["data"]))

    def close(self) -> None:
        self.browser.call("Target.closeTarget", targetId=self.target)


@contextmanager
def running(browser: str, folder: Path) -> Iterator[Browser]:
    """Start Chromium with a profile of its own, and end it."""
    ends = [os.pipe(), os.pipe()]
    requests, answers = (tuple(fcntl.fcntl(fd, fcntl.F_DUPFD, HIGH) for fd in pair) for pair in ends)
    for fd in (*ends[0], *ends[1]):
        os.close(fd)
    command = [browser, *FLAGS, f"--user-data-dir={folder / 'profile'}"]
    shell = ["bash", "-c", f'exec "$@" 3<&{requests[0]} 4>&{answers[1]}', "bash", *command]
    log = (folder / "chromium.log").open("wb")
    child = subprocess.Popen(
        shell, pass_fds=(requests[0], answers[1]), stdout=log, stderr=log, start_new_session=True
    )
    os.close(requests[0])
    os.close(answers[1])
    try:
        yield Browser(requests[1], answers[0])
    finally:
        os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        os.close(requests[1])
        os.close(answers[0])
        log.close()
