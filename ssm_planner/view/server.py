"""Serve the page of the local view on the loopback interface, to this computer only.

`serve_view` is the entry. The server accepts requests only from its own page, which knows a secret
token.
"""

from __future__ import annotations

import hmac
import json
import secrets
import sys
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from ssm_planner.arguments import checked
from ssm_planner.errors import ProblemError, SsmPlannerError
from ssm_planner.loading import load_problem
from ssm_planner.problem import Problem
from ssm_planner.typing import JsonObject
from ssm_planner.view.jobs import PlanningJobs
from ssm_planner.view.page import ViewedProblem, view_page

ADDRESS = "127.0.0.1"
"""Address of the loopback interface, which other computers cannot reach."""
MAX_REQUEST_SIZE = 262144
"""Largest size of a request, bytes."""
SECURITY_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'self'; base-uri 'none'; form-action 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""Headers of all responses. They prevent access by other pages."""
CONTENT_TYPES = {"report": "text/html", "plan": "application/json"}
"""Content types of the documents of a planning run at /<document>/<run>."""
AnswerFunction = Callable[[JsonObject], JsonObject]
"""Function that answers a request of the page."""


class ViewServer(ThreadingHTTPServer):
    """Server of the local view of a problem on the loopback interface.

    Attributes
    ----------
    jobs : PlanningJobs
        The planning runs and the pages.
    token : str
        Secret that every POST request must contain.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> with ssm.serve_view() as server:
    ...     print(server.server_address[0])
    127.0.0.1
    """

    daemon_threads = True

    def __init__(self, problem: Problem | None, port: int = 0) -> None:
        """Open the socket.

        Parameters
        ----------
        problem : Problem or None
            Problem that the page shows. None shows the paper's mechanism.
        port : int
            Port of the server. 0 selects any free port.
        """
        # The jobs are created first, so that server_close works if the socket fails.
        self.jobs = PlanningJobs(ViewedProblem(problem))
        super().__init__((ADDRESS, port), RequestHandler)
        self.token = secrets.token_urlsafe(24)
        self.hosts = {f"{name}:{self.server_port}" for name in (ADDRESS, "localhost")}
        jobs = self.jobs
        self.answers: dict[str, AnswerFunction] = {
            "/workspace": lambda request: jobs.requested_page(request).workspace(request),
            "/ik": lambda request: jobs.requested_page(request).ik(request),
            "/plan": jobs.start,
            "/progress": jobs.progress,
            "/cancel": jobs.cancel,
            "/suggest": lambda request: jobs.requested_page(request).suggest(request),
            "/yaml": lambda request: jobs.requested_page(request).problem_file(request),
            "/edit": jobs.edit,
        }

    def server_close(self) -> None:
        """Close the server and kill the planner's process."""
        super().server_close()
        self.jobs.close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore closed connections, and report other errors."""
        if not isinstance(sys.exc_info()[1], (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{ADDRESS}:{self.server_port}/"


@checked
def serve_view(problem: Problem | str | Path | None = None, port: int = 0) -> ViewServer:
    """Return a server of the interactive page of a problem, on the loopback interface.

    Parameters
    ----------
    problem : Problem, str or Path, optional
        Problem or its file. Without it, the page shows the paper's mechanism and does not plan.
    port : int
        Port of the server. 0 selects any free port.

    Returns
    -------
    ViewServer
        Context manager with the address `url`. Its method `serve_forever()` answers the page.

    Raises
    ------
    ProblemError
        If the problem is invalid, or if the port cannot be used.

    Examples
    --------
    >>> import ssm_planner as ssm
    >>> with ssm.serve_view() as server:
    ...     print(server.url.rpartition(":")[0])
    http://127.0.0.1
    """
    if not 0 <= port <= 65535:
        raise ProblemError("invalid port", key="port", value=port, allowed="0 to 65535")
    if isinstance(problem, (str, Path)):
        problem = load_problem(problem)
    try:
        return ViewServer(problem, port)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ProblemError(f"{ADDRESS} cannot be used: {reason}", key="port", value=port) from error


class RequestHandler(BaseHTTPRequestHandler):
    """Handler of the requests of a browser.

    It answers GET for the page and for the documents of planning runs, and POST with JSON and the
    token of the page.
    """

    server: ViewServer
    protocol_version = "HTTP/1.1"
    timeout = 20
    server_version = "ssm-planner"
    sys_version = ""

    def do_GET(self) -> None:
        """Send the page, or the report or plan.json of a planning run."""
        if not self._known_host():
            return
        page = self.server.jobs.pages.get(self.path)
        if page is not None:
            self._send(HTTPStatus.OK, view_page(page, self.server.token), "text/html")
            return
        text_type, _, identity = self.path.removeprefix("/").partition("/")
        text = (
            self.server.jobs.document(text_type, identity) if text_type in CONTENT_TYPES else None
        )
        if text is None:
            self._refuse(HTTPStatus.NOT_FOUND, "page not found")
        else:
            self._send(HTTPStatus.OK, text, CONTENT_TYPES[text_type])

    def do_POST(self) -> None:
        """Answer a request of the page's script with JSON."""
        if not self._known_host():
            return
        answer = self.server.answers.get(self.path)
        if answer is None:
            self._refuse(HTTPStatus.NOT_FOUND, "page not found")
            return
        request = self._request()
        if request is None:
            return
        try:
            text = json.dumps(answer(request), allow_nan=False)
            self._send(HTTPStatus.OK, text, "application/json")
        except SsmPlannerError as error:
            key = reason = None
            if isinstance(error, ProblemError):
                key = error.key
                reason = error.reason
                if error.allowed:
                    reason += f" (allowed: {error.allowed})"
            self._refuse(HTTPStatus.BAD_REQUEST, str(error), key, reason)

    def _known_host(self) -> bool:
        """Return True if the browser used a name of this server. Otherwise, refuse the request.

        A page of another host can resolve its own name to this machine. This check prevents its
        access.
        """
        if self.headers.get("Host") in self.server.hosts:
            return True
        self._refuse(
            HTTPStatus.MISDIRECTED_REQUEST, "this server answers to 127.0.0.1 and localhost only"
        )
        return False

    def _request(self) -> JsonObject | None:
        """Read the JSON object of a POST request.

        Returns
        -------
        dict or None
            The object. None if the request was refused because of its headers or its content.
        """
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
        """Check the headers of a POST request, without reading its body.

        Returns
        -------
        tuple or None
            Status and reason of a refusal, or None if the headers are valid.
        """
        origin = self.headers.get("Origin")
        length = self.headers.get("Content-Length", "")
        token = self.headers.get("X-Token", "")
        content_type, _, _ = self.headers.get("Content-Type", "").partition(";")
        if origin is not None and origin.removeprefix("http://") not in self.server.hosts:
            return HTTPStatus.FORBIDDEN, "not from this server's page"
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            return HTTPStatus.FORBIDDEN, "the token of the page is missing; reload the page"
        if content_type.strip().lower() != "application/json":
            return HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "only application/json"
        if not (length.isascii() and length.isdigit()) or "Transfer-Encoding" in self.headers:
            return HTTPStatus.LENGTH_REQUIRED, "the length is missing"
        if len(length) > 9 or int(length) > MAX_REQUEST_SIZE:
            return HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"at most {MAX_REQUEST_SIZE} bytes"
        return None

    def _refuse(
        self, status: HTTPStatus, message: str, key: str | None = None, reason: str | None = None
    ) -> None:
        """Send an error.

        Parameters
        ----------
        status : HTTPStatus
            Status of the HTTP answer.
        message : str
            Reason for the refusal.
        key : str, optional
            Name of the wrong entry.
        reason : str, optional
            Its fault, without the name.
        """
        self.close_connection = True
        self._send(
            status, json.dumps({"error": message, "key": key, "reason": reason}), "application/json"
        )

    def _send(self, status: HTTPStatus, text: str, content_type: str) -> None:
        """Send a text with its content type and the security headers.

        Parameters
        ----------
        status : HTTPStatus
            Status of the HTTP answer.
        text : str
            Content of the answer.
        content_type : str
            Type of the content, such as "text/html".
        """
        body = text.encode("utf-8")
        self.send_response(status)
        for name, value in SECURITY_HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", f"{content_type}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Suppress the log of requests."""
