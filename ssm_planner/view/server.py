"""A local server for one page: loopback only, no login, and it accepts nothing that the page does not send."""

from __future__ import annotations

import hmac
import json
import secrets
import sys
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.view.jobs import Jobs
from ssm_planner.view.page import Study, view_page

ADDRESS = "127.0.0.1"
LONGEST = 4096
"""Bytes that a request may hold."""
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'self'; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
KINDS = {"report": "text/html", "plan": "application/json"}
"""What a finished plan has, at /<kind>/<job>."""
Answer = Callable[[Mapping[str, Any]], dict[str, Any]]


class ViewServer(ThreadingHTTPServer):
    """Serves the view of a study on the loopback interface; port 0: any free one."""

    daemon_threads = True

    def __init__(self, study: Study, port: int = 0) -> None:
        self.jobs = Jobs(study)  # a socket that cannot be had is closed with them
        super().__init__((ADDRESS, port), Handler)
        self.study = study
        self.token = secrets.token_urlsafe(24)
        self.hosts = {f"{name}:{self.server_port}" for name in (ADDRESS, "localhost")}
        self.answers: dict[str, Answer] = {
            "/workspace": study.workspace,
            "/ik": study.ik,
            "/plan": self.jobs.start,
            "/progress": self.jobs.progress,
            "/cancel": self.jobs.cancel,
            "/suggest": study.suggest,
            "/yaml": lambda request: study.problem_file(self.jobs.wanted(request)),
        }

    def server_close(self) -> None:
        """The planner ends with its server."""
        super().server_close()
        self.jobs.close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that hangs up is no news."""
        if not isinstance(sys.exc_info()[1], (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)

    @property
    def url(self) -> str:
        return f"http://{ADDRESS}:{self.server_port}/"


class Handler(BaseHTTPRequestHandler):
    """GET of the page and of finished reports; POST of JSON with the page's token."""

    server: ViewServer
    protocol_version = "HTTP/1.1"
    timeout = 20
    server_version = "ssm-planner"
    sys_version = ""

    def do_GET(self) -> None:
        if not self._known_host():
            return
        if self.path == "/":
            self._send(
                HTTPStatus.OK, view_page(self.server.study.start(), self.server.token), "text/html"
            )
            return
        kind, _, identity = self.path.removeprefix("/").partition("/")
        text = self.server.jobs.text(kind, identity) if kind in KINDS else None
        if text is None:
            self._refuse(HTTPStatus.NOT_FOUND, "nothing is here")
        else:
            self._send(HTTPStatus.OK, text, KINDS[kind])

    def do_POST(self) -> None:
        if not self._known_host():
            return
        answer = self.server.answers.get(self.path)
        if answer is None:
            self._refuse(HTTPStatus.NOT_FOUND, "nothing is here")
            return
        request = self._request()
        if request is None:
            return
        try:
            self._send(
                HTTPStatus.OK, json.dumps(answer(request), allow_nan=False), "application/json"
            )
        except SsmPlannerError as error:
            key = reason = None
            if isinstance(error, ProblemError):
                key, reason = (
                    error.key,
                    error.reason + (f" (allowed: {error.allowed})" if error.allowed else ""),
                )
            self._refuse(HTTPStatus.BAD_REQUEST, str(error), key, reason)

    def _known_host(self) -> bool:
        """The browser reached this server by its own name: a page elsewhere cannot point a name of its own here."""
        if self.headers.get("Host") in self.server.hosts:
            return True
        self._refuse(
            HTTPStatus.MISDIRECTED_REQUEST, "this server answers to 127.0.0.1 and localhost only"
        )
        return False

    def _request(self) -> dict[str, Any] | None:
        """The JSON object of a request from this server's own page, or None after refusing."""
        fault = self._fault()
        if fault is not None:
            self._refuse(*fault)
            return None
        try:
            request = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict):
            self._refuse(HTTPStatus.BAD_REQUEST, "not a JSON object")
            return None
        return request

    def _fault(self) -> tuple[HTTPStatus, str] | None:
        """What is wrong with the headers of a POST, before anything of its body is read."""
        origin, length = self.headers.get("Origin"), self.headers.get("Content-Length", "")
        if origin is not None and origin.removeprefix("http://") not in self.server.hosts:
            return HTTPStatus.FORBIDDEN, "not from this server's page"
        if not hmac.compare_digest(
            self.headers.get("X-Token", "").encode(), self.server.token.encode()
        ):
            return HTTPStatus.FORBIDDEN, "the token of the page is missing; reload the page"
        if (
            self.headers.get("Content-Type", "").partition(";")[0].strip().lower()
            != "application/json"
        ):
            return HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "only application/json"
        if not (length.isascii() and length.isdigit()) or "Transfer-Encoding" in self.headers:
            return HTTPStatus.LENGTH_REQUIRED, "the length is missing"
        if len(length) > 9 or int(length) > LONGEST:
            return HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"at most {LONGEST} bytes"
        return None

    def _refuse(
        self, status: HTTPStatus, message: str, key: str | None = None, reason: str | None = None
    ) -> None:
        """key: of the field that is wrong, whose fault the reason is without its name."""
        self.close_connection = True
        self._send(
            status, json.dumps({"error": message, "key": key, "reason": reason}), "application/json"
        )

    def _send(self, status: HTTPStatus, text: str, kind: str) -> None:
        body = text.encode("utf-8")
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """The terminal stays quiet."""
