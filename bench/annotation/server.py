"""The server of the review page: this machine alone, one page, a fixed set of questions.

It listens on 127.0.0.1. A random token stands in the address behind `#`, which no browser sends or logs by itself; the
page sends it as a header with every question. Questions name recordings, sweeps, images and cameras by number, never by
path. Answers are the page, JSON, and bytes of sweeps and images; nothing is loaded from elsewhere.
"""

from __future__ import annotations

import json
import re
import secrets
from collections.abc import Callable, Sequence
from functools import lru_cache
from hmac import compare_digest
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from threading import Lock
from typing import Any

from bench.annotation.session import ChangedFileError, Session
from bench.errors import BenchError, DataError, OutputError

ADDRESS = "127.0.0.1"
TOKEN_HEADER = "X-Review-Token"
LARGEST_BODY_BYTES = 1_000_000
LONGEST_PATH = 100
IDLE_S = 30
OPENED = 2  # drives that are held at once
NOTHING = "there is no such thing"
QUESTION = re.compile(r"/drives/([0-9]{1,6})(?:/([a-z]{1,10})((?:/[0-9]{1,9}){0,2}))?")
POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; img-src blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


class Refused(Exception):  # noqa: N818 - an answer, not a fault
    """A question that is not answered."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class ReviewServer(ThreadingHTTPServer):
    """Serves the page and its questions until it is closed.

    Args:
        names: of the recordings, in the order of the list.
        open_session: opens one by its name.
        port: to listen on; 0 for any that is free.
    """

    daemon_threads = True

    def __init__(self, names: Sequence[str], open_session: Callable[[str], Session], *, port: int = 0) -> None:
        self.names, self.token = tuple(names), secrets.token_urlsafe(32)
        self._open = lru_cache(maxsize=OPENED)(open_session)
        self._opening = Lock()
        super().__init__((ADDRESS, port), Handler)

    @property
    def url(self) -> str:
        """The address to open, with the token."""
        return f"http://{ADDRESS}:{self.server_port}/#{self.token}"

    def session(self, index: int) -> Session:
        """The drive of an index, opened when it is first asked for; IndexError where there is none."""
        with self._opening:
            return self._open(self.names[index])


class Handler(BaseHTTPRequestHandler):
    """Answers one connection."""

    server: ReviewServer
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "fisheye-bench", ""
    timeout = IDLE_S
    disable_nagle_algorithm = True  # it would hold the second part of each answer back for 40 ms

    def do_GET(self) -> None:
        """The page, lists, sweeps, images and lenses."""
        self._answer_or_refuse()

    def do_POST(self) -> None:
        """Decisions, lassos, what was watched, and the reference of a box that is being moved."""
        self._answer_or_refuse()

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""

    def _answer_or_refuse(self) -> None:
        try:
            self._refuse_foreign()
            if (self.command, self.path) == ("GET", "/"):
                self._send_page()
            else:
                self._refuse_without_token()
                self._answer()
        except Refused as refused:
            self._refuse(refused.status, refused.reason)
        except IndexError:
            self._refuse(HTTPStatus.NOT_FOUND, NOTHING)
        except (ChangedFileError, OutputError) as error:
            self._refuse(HTTPStatus.CONFLICT, str(error))
        except DataError as error:
            self._refuse(HTTPStatus.BAD_REQUEST if self.command == "POST" else HTTPStatus.NOT_FOUND, str(error))
        except BenchError as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        except (ConnectionError, TimeoutError):
            self.close_connection = True

    def _refuse_foreign(self) -> None:
        hosts = {f"{ADDRESS}:{self.server.server_port}", f"localhost:{self.server.server_port}"}
        given = self.headers.get_all("Host") or []
        if len(given) != 1 or given[0] not in hosts:
            raise Refused(HTTPStatus.FORBIDDEN, "expected this machine as host")
        origin = self.headers.get("Origin")
        if origin is not None and origin not in {f"http://{host}" for host in hosts}:
            raise Refused(HTTPStatus.FORBIDDEN, "expected this page as origin")
        if len(self.path) > LONGEST_PATH:
            raise Refused(HTTPStatus.REQUEST_URI_TOO_LONG, "expected a short address")

    def _refuse_without_token(self) -> None:
        given = self.headers.get(TOKEN_HEADER, "")
        if not compare_digest(given.encode(errors="replace"), self.server.token.encode()):
            raise Refused(HTTPStatus.FORBIDDEN, "expected the token of this review; open the address that was printed")

    def _answer(self) -> None:
        content = self._body() if self.command == "POST" else b""
        if (self.command, self.path) == ("GET", "/drives"):
            self._send_json({"drives": self.server.names})
            return
        match = QUESTION.fullmatch(self.path)
        if match is None:
            raise Refused(HTTPStatus.NOT_FOUND, NOTHING)
        session = self.server.session(int(match[1]))
        match self.command, match[2] or "", [int(number) for number in (match[3] or "").split("/")[1:]]:
            case "GET", "", []:
                self._send_json(session.drive())
            case "GET", "sweep", [index]:
                self._send(session.sweep(index), "application/octet-stream")
            case "GET", "lens", [camera]:
                self._send(session.lens(camera), "application/octet-stream")
            case "GET", "image", [camera, index]:
                image, pose = session.image(camera, index)
                self._send(image, "image/jpeg", {"X-Pose": json.dumps(pose)})
            case "POST", "decide", []:
                self._send_json(session.decide(content))
            case "POST", "draw", []:
                self._send_json(session.draw(content))
            case "POST", "watched", []:
                self._send_json(session.watch(content))
            case "POST", "outline", [camera, image_index]:
                self._send_json(session.outline(content, camera, image_index))
            case _:
                raise Refused(HTTPStatus.NOT_FOUND, NOTHING)

    def _body(self) -> bytes:
        if self.headers.get_content_type() != "application/json":
            raise Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected JSON")
        length = self.headers.get("Content-Length", "")
        if not re.fullmatch(r"[0-9]{1,12}", length) or self.headers.get("Transfer-Encoding") is not None:
            raise Refused(HTTPStatus.LENGTH_REQUIRED, "expected the length of the question")
        if int(length) > LARGEST_BODY_BYTES:
            raise Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected at most {LARGEST_BODY_BYTES} bytes")
        content = self.rfile.read(int(length))
        if len(content) < int(length):
            raise ConnectionError("the question ended early")
        return content

    def _send_page(self) -> None:
        nonce = secrets.token_urlsafe(16)
        page = files("bench.annotation").joinpath("review.html").read_text(encoding="utf-8").replace("NONCE", nonce)
        headers = {"Content-Security-Policy": POLICY.format(nonce=nonce), "X-Frame-Options": "DENY"}
        self._send(page.encode(), "text/html; charset=utf-8", headers)

    def _send_json(self, values: dict[str, Any]) -> None:
        self._send(json.dumps(values, allow_nan=False).encode(), "application/json")

    def _refuse(self, status: HTTPStatus, reason: str) -> None:
        self.close_connection = True  # a body that was not read must not be taken for the next question
        self._send(json.dumps({"error": reason}).encode(), "application/json", {"Connection": "close"}, status)

    def _send(
        self, content: bytes, kind: str, headers: dict[str, str] | None = None, status: HTTPStatus = HTTPStatus.OK
    ) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, **(headers or {}), "Content-Type": kind, "Content-Length": len(content)}.items():
            self.send_header(name, str(value))
        self.end_headers()
        self.wfile.write(content)
