"""A page in a headless browser, driven over the DevTools protocol."""

import asyncio
import base64
import json
import re
import shutil
import subprocess
import tempfile
from contextlib import contextmanager

from tornado.httpclient import AsyncHTTPClient
from tornado.websocket import websocket_connect

CHROMIUM = shutil.which("chromium")
_PATIENCE = 60.0  # s, for an answer


class Browser:
    """One tab; what it says on the console and what it asks the network for is kept."""

    def __init__(self, port):
        self._loop, self._count, self._port = asyncio.new_event_loop(), 0, port
        self.complaints, self.requests = [], []
        self._socket = self._loop.run_until_complete(self._connect())
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.ask(f"{domain}.enable")

    async def _connect(self):
        found = await AsyncHTTPClient().fetch(
            f"http://127.0.0.1:{self._port}/json/new?about:blank", method="PUT", body=""
        )
        return await websocket_connect(json.loads(found.body)["webSocketDebuggerUrl"], max_message_size=1 << 28)

    def ask(self, method, until="", **parameters):
        """The answer to a command; with `until`, once an event of that name has come too."""
        return self._loop.run_until_complete(asyncio.wait_for(self._ask(method, until, parameters), _PATIENCE))

    async def _ask(self, method, until, parameters):
        self._count += 1
        await self._socket.write_message(json.dumps({"id": self._count, "method": method, "params": parameters}))
        answer = None
        while answer is None or until:
            told = json.loads(await self._socket.read_message())
            self._note(told)
            if told.get("id") == self._count:
                answer = told
            if told.get("method") == until:
                until = ""
        assert "error" not in answer, answer
        return answer["result"]

    def _note(self, told):
        method, parameters = told.get("method"), told.get("params", {})
        if method == "Network.requestWillBeSent":
            self.requests.append(parameters["request"]["url"])
        if method == "Runtime.exceptionThrown" or (
            method == "Runtime.consoleAPICalled" and parameters["type"] == "error"
        ):
            self.complaints.append(parameters)
        if method == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
            self.complaints.append(parameters["entry"]["text"])

    def open(self, page, width, dark):
        """Show a file at a width, in the reader's light or dark setting."""
        self.resize(width, dark)
        self.ask("Page.navigate", until="Page.loadEventFired", url=page.as_uri())

    def resize(self, width, dark, height=900):
        """Show what is shown at another width, or in the other setting."""
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
        self.ask("Emulation.setEmulatedMedia", features=scheme)
        # what watches its size is told with the next frame
        self.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done())))")

    def evaluate(self, script):
        """The value of an expression in the page."""
        found = self.ask("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def picture(self, whole=True):
        """A PNG of the page."""
        return base64.b64decode(self.ask("Page.captureScreenshot", captureBeyondViewport=whole)["data"])

    def pdf(self):
        """The page as it prints."""
        return base64.b64decode(self.ask("Page.printToPDF", preferCSSPageSize=True, printBackground=True)["data"])


@contextmanager
def browser():
    """A headless browser, without a network to fall back on."""
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", "--no-first-run"]
    options += ["--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1"]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        command = [CHROMIUM, *options, f"--user-data-dir={folder}", "about:blank"]
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
            try:
                line = next(line for line in process.stderr if "DevTools listening" in line)
                yield Browser(int(re.search(r":(\d+)/", line)[1]))
            finally:
                process.terminate()
