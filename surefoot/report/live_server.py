"""The web server of the live page, on the loopback interface.

It answers only requests for its own host name, so that no page of another site reaches it through a name that was
bound to this machine (DNS rebinding), and takes commands only from its own page. Ours.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from perception.primitives import safe_input

HOST = "127.0.0.1"
PORT = 8080  # ours; another free one where it is taken
OWN_HOST = re.compile(rf"(localhost|{re.escape(HOST)})(:[0-9]{{1,5}})?", re.ASCII | re.IGNORECASE)
"""Any port: the page may come through a tunnel."""
LONGEST_COMMAND = 1000  # bytes


class LiveServer(ThreadingHTTPServer):
    """Serves a page, the moments of a run, and takes commands for a walk.

    Args:
        page: Its text.
        news: Gives the answer to a page that has so many moments; may wait for new ones.
        command: Takes a command; ValueError or TypeError if it is none.
        port: 0 for any free one.
    """

    daemon_threads = True
    request_queue_size = (
        1024  # ours: connections that wait; of 5 a browser's later ones wait for seconds
    )

    def __init__(
        self,
        page: str,
        news: Callable[[int], bytes],
        command: Callable[[dict[str, Any]], None],
        port: int = PORT,
    ) -> None:
        self.page, self.news, self.command = page, news, command
        try:
            super().__init__((HOST, port), _Handler)
        except OSError:  # taken by another program
            super().__init__((HOST, 0), _Handler)

    @property
    def address(self) -> str:
        """URL of the page."""
        return f"http://localhost:{self.server_port}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that went away is no error."""


class _Handler(BaseHTTPRequestHandler):
    server: LiveServer
    timeout = 60.0  # for a client that sends nothing

    def do_GET(self) -> None:
        if not self._is_own():
            return
        try:
            parts = urlsplit(self.path)
        except ValueError as error:
            self._refuse(400, str(error))
            return
        if parts.path == "/":
            self._answer(200, "text/html; charset=utf-8", self.server.page.encode())
        elif parts.path == "/moments":
            number = safe_input.whole(parse_qs(parts.query).get("from", [""])[0])
            if number is None:
                self._refuse(400, "from= takes the number of a moment")
                return
            self._answer(200, "application/json", self.server.news(number))
        else:
            self._refuse(404, "not here")

    def do_POST(self) -> None:
        if not self._is_own():
            return
        origin = self.headers.get("Origin")
        if origin is not None and origin != f"http://{self.headers.get('Host')}":
            self._refuse(403, "commands come from the page itself")
            return
        kind = self.headers.get("Content-Type", "")
        length = safe_input.whole(self.headers.get("Content-Length", ""))
        right = self.path == "/walk" and kind == "application/json"
        if not right or length is None or length > LONGEST_COMMAND:
            self._refuse(400, "expected a JSON object for /walk")
            return
        try:
            self.server.command(safe_input.json(self.rfile.read(length)))
        except (ValueError, TypeError, AttributeError) as error:
            self._refuse(400, str(error))
            return
        self._answer(200, "application/json", b"{}")

    def _is_own(self) -> bool:
        hosts = self.headers.get_all("Host", [])
        if len(hosts) == 1 and OWN_HOST.fullmatch(hosts[0]):
            return True
        self._refuse(403, f"this page answers as localhost only, not as {', '.join(hosts)!r}")
        return False

    def _refuse(self, code: int, words: str) -> None:
        self._answer(code, "text/plain; charset=utf-8", f"{words}\n".encode())

    def _answer(self, code: int, kind: str, content: bytes) -> None:
        self.send_response(code)
        for name, value in (
            ("Content-Type", kind), ("Content-Length", str(len(content))), ("Cache-Control", "no-store"),
            ("X-Content-Type-Options", "nosniff"), ("X-Frame-Options", "DENY"), ("Referrer-Policy", "no-referrer"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
        ):  # fmt: skip
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *values: Any) -> None:
        """Nothing: the terminal belongs to the walk."""
