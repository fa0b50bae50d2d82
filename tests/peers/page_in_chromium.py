"""Opens a page in headless Chromium and says, as JSON, what happened there.

    page_in_chromium.py URL [FOLDER]

For each of two widths, light and dark: errors on the console, whether the page is wider than the
window, how far the first animation went in 1.5 s (up to 30 s where it stands still) and whether its picture changed. Screenshots go to
FOLDER. Speaks the DevTools protocol over Chromium's own pipe, so it needs Python alone.
"""

import hashlib
import json
import os
import pathlib
import select
import shutil
import subprocess
import sys
import tempfile
import time
from base64 import b64decode

FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--remote-debugging-pipe",
]


class Chromium:
    def __init__(self, profile):
        program = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
        if program is None:
            sys.exit("chromium: found none on the PATH, wanted one (or CHROMIUM)")
        their_in, self.out = os.pipe()
        self.into, their_out = os.pipe()

        def fds():
            # Through high numbers first: 3 and 4 may be among ours.
            a, b = os.dup2(their_in, 60), os.dup2(their_out, 61)
            os.dup2(a, 3), os.dup2(b, 4)

        self.process = subprocess.Popen(
            [program, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=fds, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )
        self.buffer, self.count, self.events, self.session = b"", 0, [], None

    def read(self, until):
        while b"\0" not in self.buffer:
            ready, _, _ = select.select([self.into], [], [], max(0.0, until - time.monotonic()))
            if not ready:
                return None
            chunk = os.read(self.into, 1 << 20)
            if not chunk:
                sys.exit("chromium ended")
            self.buffer += chunk
        message, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(message)

    def call(self, method, **params):
        self.count += 1
        request = {"id": self.count, "method": method, "params": params}
        if self.session:
            request["sessionId"] = self.session
        os.write(self.out, json.dumps(request).encode() + b"\0")
        until = time.monotonic() + 60
        while (message := self.read(until)) is not None:
            if message.get("id") == self.count:
                if "error" in message:
                    sys.exit(f"{method}: {message['error']}")
                return message["result"]
            self.events.append(message)
        sys.exit(f"{method}: no answer within 60 s")

    def wait(self, seconds):
        until = time.monotonic() + seconds
        while (message := self.read(until)) is not None:
            self.events.append(message)

    def value(self, expression):
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def errors(self):
        found = []
        for event in self.events:
            method, params = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown":
                details = params["exceptionDetails"]
                found.append(details.get("exception", {}).get("description", details["text"]))
            elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "assert"):
                found.append(str([argument.get("value") for argument in params["args"]]))
            elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
                found.append(params["entry"]["text"])
        self.events.clear()
        return found


# Visible words of one figure whose boxes share more than a sliver.
OVERLAPS = """
[...document.querySelectorAll('figure.plate svg')].filter(svg => svg.getClientRects().length).flatMap(svg => {
  const boxes = [...svg.querySelectorAll('text')].map(text => [text.textContent, text.getBoundingClientRect()]);
  const found = [];
  boxes.forEach(([a, p], i) => boxes.slice(i + 1).forEach(([b, q]) => {
    const wide = Math.min(p.right, q.right) - Math.max(p.left, q.left);
    const high = Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top);
    if (wide > 2 && high > 4) found.push(`${svg.getAttribute('aria-label')}: ${a} | ${b}`);
  }));
  const edge = svg.getBoundingClientRect();
  for (const [a, p] of boxes)
    if (p.left < edge.left - 3 || p.right > edge.right + 3) found.push(`${svg.getAttribute('aria-label')}: ${a} is cut off`);
  return found;
})
"""


def look(chromium, url, width, scheme, folder):
    chromium.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1,
                  mobile=width < 600)
    chromium.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    chromium.call("Page.navigate", url=url)
    chromium.wait(1.0)
    # A page may build what can be watched when it comes near.
    chromium.value("document.getElementById('courses')?.scrollIntoView()")
    chromium.wait(0.5)
    show = "document.querySelector('canvas.scene').scrollIntoView({block: 'center', behavior: 'instant'})"
    chromium.value(show)
    chromium.wait(0.7)
    tick = "Number(document.querySelector('section[data-tick]').dataset.tick)"
    picture = "document.querySelector('canvas.scene').toDataURL()"
    first, before = chromium.value(tick), chromium.value(picture)
    chromium.wait(1.5)
    last, after = chromium.value(tick), chromium.value(picture)
    # On a machine that has no time for a browser, what is built late moves the scene out of view.
    until = time.monotonic() + 30
    while after == before and time.monotonic() < until:
        chromium.value(show)
        chromium.wait(0.5)
        last, after = chromium.value(tick), chromium.value(picture)
    overflow = chromium.value("document.documentElement.scrollWidth - innerWidth")
    if folder:
        chromium.value("scrollTo({top: 0, behavior: 'instant'})")
        height = min(chromium.value("document.documentElement.scrollHeight"), 16000)
        for top in range(0, height, 1800):
            clip = {"x": 0, "y": top, "width": width, "height": min(1800, height - top), "scale": 1}
            shot = chromium.call("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)["data"]
            (pathlib.Path(folder) / f"page-{width}-{scheme}-{top:05}.png").write_bytes(b64decode(shot))
    digest = lambda text: hashlib.sha256(str(text).encode()).hexdigest()
    return {
        "width": width, "scheme": scheme, "ticks": [first, last], "moved": digest(before) != digest(after),
        "overflow_px": overflow, "sections": chromium.value("document.querySelectorAll('section').length"),
        "overlaps": chromium.value(OVERLAPS), "errors": chromium.errors(),
    }


def main():
    url, folder = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        chromium = Chromium(profile)
        try:
            targets = chromium.call("Target.getTargets")["targetInfos"]
            page = next(target for target in targets if target["type"] == "page")
            chromium.session = chromium.call("Target.attachToTarget", targetId=page["targetId"], flatten=True)["sessionId"]
            for domain in ("Runtime", "Log", "Page"):
                chromium.call(f"{domain}.enable")
            looks = [look(chromium, url, width, scheme, folder) for width in (390, 1280) for scheme in ("light", "dark")]
        finally:
            chromium.process.terminate()
            chromium.process.wait()
    print(json.dumps(looks))


main()
